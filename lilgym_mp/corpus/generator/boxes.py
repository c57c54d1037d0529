"""Synchronous templates for statements about boxes."""

from __future__ import annotations

from collections.abc import Sequence

from lilgym_mp.corpus.generator.conditions import BOX_WORDS, ConditionTemplate
from lilgym_mp.corpus.generator.items import ItemTemplates
from lilgym_mp.corpus.generator.lexicon import Phrase, pluralised
from lilgym_mp.corpus.generator.phrases import NounTemplate, TrainingPair, box_items
from lilgym_mp.corpus.generator.program_text import BOX, TOWERS, boxes_where, quantity_test
from lilgym_mp.corpus.generator.quantities import NONE, SOME, Quantity, at_least, exactly

FIRST_TWO = (
    ((0, 1), ("first two", "two left", "left two", "first 2")),
    ((1, 2), ("last two", "two right", "right two")),
)


class StatementTemplates(ItemTemplates):
    """Statements about items and boxes, sampled by the weights in `weighted_statements`."""

    def sample(self) -> TrainingPair:
        """A statement and its program from a random template."""
        weights, templates = zip(*self.weighted_statements, strict=True)
        (make,) = self.rng.choices(templates, weights)
        return make()

    def box_quantity(self) -> Quantity:
        more = ((0.87, exactly(2)), (0.91, at_least(2)), (0.95, exactly(3)))
        return self.drawn((0.62, SOME), (0.76, exactly(1)), *more, (1, NONE))

    def box_count(self) -> TrainingPair:
        """A count of boxes that satisfy one to three conditions."""
        conditions = self.conditions(self.rng.choices((1, 2, 3), (62, 33, 5))[0])
        quantity = self.box_quantity()
        if quantity == NONE and (len(conditions) > 1 or conditions[0].negative or conditions[0].min_items == 0):
            quantity = SOME
        word = self.box_word()
        tests = self.box_tests(word, conditions)
        if quantity == exactly(3):
            text = self.every_box(word, conditions)
            if word == self.style.tower and not {"three", "3"} & set(text.split(f" {pluralised(word)} ")[0].split()):
                condition_tests = " and ".join(condition.test(BOX) for condition in conditions)
                return TrainingPair(text, f"All({TOWERS}, lambda {BOX}: {condition_tests})")
            return TrainingPair(text, f"All(all_boxes, lambda {BOX}: {tests})")
        return TrainingPair(self.box_text(quantity, word, conditions), quantity_test(quantity, boxes_where(tests)))

    def box_tests(self, word: str, conditions: Sequence[ConditionTemplate], box: str = BOX) -> str:
        tests = [condition.test(box) for condition in conditions]
        return " and ".join([f"{box}.is_tower()", *tests] if word == self.style.tower else tests)

    def box_text(self, quantity: Quantity, word: str, conditions: Sequence[ConditionTemplate]) -> str:
        draw = self.rng.random()
        nouns = pluralised(word)
        if quantity == NONE and draw < 0.4:
            none = self.pick("none of the", "no one of the", "not one of the")
            return f"{none} {nouns} {self.box_verb_phrase(conditions, plural=self.chance(0.5))}"
        if quantity.low >= 1 and draw < 0.22:
            of_the = self.partitive_boxes(quantity)
            if of_the.startswith("in "):
                contents = [condition.contents for condition in conditions]
                if None in contents or any(condition.negative for condition in conditions):
                    of_the = "one of the"
                else:
                    return f"in one of the {nouns} there is {self.conjoined([text for text in contents if text], ())}"
            return f"{of_the} {nouns} {self.box_verb_phrase(conditions, quantity.low > 1)}"
        words = self.determiner(quantity)
        plural = words.plural
        noun = pluralised(word) if plural else word
        text = f"{words.text} {noun}" if words.text != "a" else self.a(noun)
        alone = len(conditions) == 1 and not conditions[0].negative and conditions[0].kind != "either"
        only = conditions[0].contents if alone else None
        if quantity == SOME and only is not None and draw < 0.34:
            place = self.pick(
                f"in a {word}", f"in one of the {nouns}", f"in one {word}", f"in the same {word}", f"inside a {word}",
                f"in a {word}", f"in any {word}",
            )  # fmt: skip
            plural = not only.startswith(("a ", "an ", "one ", "1 ", "exactly one", "exactly 1", "only one", "no "))
            there = "there are" if plural and not self.style.sloppy else "there is"
            return self.pick(f"there is {only} {place}", f"{there} {only} {place}", f"{place} {there} {only}")
        if draw < 0.82:
            return self.existential(Phrase(f"{text} {self.box_modifier(conditions, plural)}", plural))
        return f"{text} {self.box_verb_phrase(conditions, plural)}"

    def partitive_boxes(self, quantity: Quantity) -> str:
        """ "one of the", "exactly two of the" """
        if quantity == SOME:
            if self.style.bare_number_is_bound:
                return self.pick("at least one of the", "at least 1 of the", "in one of the")
            return self.pick(
                "one of the", "one of the", "one of the", "at least one of the", "in one of the", "one of the three",
                "one out of three", "one of",
            )  # fmt: skip
        if quantity == exactly(1):
            one = self.number(1)
            one = one if self.style.bare_number_is_bound else f"{self.pick('exactly', 'only', 'just', 'exactly')} {one}"
            return f"{one} of the"
        words = self.determiner(quantity).text
        return f"{self.number(quantity.low)} of the" if words.endswith(" of") else f"{words} of the"

    def every_box(self, word: str, conditions: Sequence[ConditionTemplate]) -> str:
        nouns = pluralised(word)
        only = conditions[0].contents if len(conditions) == 1 and conditions[0].kind == "contains" else None
        if only is not None and only.startswith(("a ", "an ")) and self.chance(0.12):
            return f"there {self.pick(f'is no {word}', f'are no {nouns}')} without {only}"
        subject, plural = self.pick(
            (f"each {word}", False), (f"every {word}", False), (f"all {nouns}", True), (f"all the {nouns}", True),
            (f"all three {nouns}", True), (f"all the three {nouns}", True), (f"each of the {nouns}", False),
            (f"all of the {nouns}", True), (f"the three {nouns}", True), (f"all 3 {nouns}", True),
        )  # fmt: skip
        return f"{subject} {self.box_verb_phrase(conditions, plural)}"

    def named_box(self) -> TrainingPair:
        """Conditions of the left, middle or right box."""
        index = int(self.rng.random() * 3)
        word = self.box_word()
        conditions = self.conditions(self.pick(1, 1, 2))
        place = self.choice(BOX_WORDS[index])
        name = f"the {place} {word}" if place != "center" or self.chance(0.5) else f"the {word} in the {place}"
        if place in ("left", "right", "middle") and self.chance(0.15):
            name = f"the {word} {'in' if place == 'middle' else 'on'} the {place}"
        contents = conditions[0].contents
        if len(conditions) == 1 and contents and self.chance(0.25):
            text = self.pick(
                f"there is {contents} in {name}", f"in {name} there is {contents}", f"in {name}, there is {contents}"
            )
        else:
            text = f"{name} {self.box_verb_phrase(conditions, plural=False)}"
        return TrainingPair(text, self.box_tests(word, conditions, f"all_boxes[{index}]"))

    def every_box_with(self) -> TrainingPair:
        """ "every box with a circle has a square too" """
        one, other = self.two_conditions()
        word = self.box_word()
        if one.contents is None or one.negative or other.negative:
            return self.box_count()
        program = f"All({boxes_where(self.box_tests(word, [one]))}, lambda {BOX}: {other.test(BOX)})"
        nouns = pluralised(word)
        also = self.pick("", "", " too", " as well")
        text = self.pick(
            f"every {word} with {one.contents} {self.box_verb_phrase([other], False)}{also}",
            f"each {word} with {one.contents} {self.box_verb_phrase([other], False)}{also}",
            f"all {nouns} with {one.contents} {self.box_verb_phrase([other], True)}{also}",
            f"all the {nouns} with {one.contents} {self.box_verb_phrase([other], True)}",
        )
        return TrainingPair(text, program)

    def definite_box(self) -> TrainingPair:
        """ "the box with a circle has a square": read as "there is such a box"."""
        one, other = self.two_conditions()
        word = self.box_word()
        if one.contents is None:
            one, other = other, one
        if one.contents is None:
            return self.box_count()
        tests = self.box_tests(word, [one, other])
        the = self.pick("the", "the", "the", f"one of the {pluralised(word)}", "a")
        subject = the if the.startswith("one") else f"{the} {word}"
        text = f"{subject} with {one.contents} {self.box_verb_phrase([other], plural=False)}"
        return TrainingPair(text, quantity_test(SOME, boxes_where(tests)))

    def two_adjacent_boxes(self) -> TrainingPair:
        """ "the first two towers have a yellow base" """
        indices, names = self.choice(FIRST_TWO)
        word = self.box_word()
        condition = self.conditions(1)[0]
        tests = [self.box_tests(word, [condition], f"all_boxes[{index}]") for index in indices]
        text = f"the {self.choice(names)} {pluralised(word)} {self.box_verb_phrase([condition], plural=True)}"
        return TrainingPair(text, " and ".join(tests))

    def equal_counts(self) -> TrainingPair:
        """ "all boxes have the same number of blue items" """
        noun = NounTemplate() if self.chance(0.4) else NounTemplate(self.attributes())
        word = self.box_word()
        nouns = pluralised(word)
        named = self.noun(noun, plural=True)
        counts = f"lambda {BOX}: count({box_items(noun, BOX)})"
        boxes = TOWERS if word == self.style.tower else "all_boxes"
        if self.chance(0.6):
            text = self.pick(
                f"all {nouns} have the same number of {named}", f"all the {nouns} have the same number of {named}",
                f"each {word} has the same number of {named}", f"all three {nouns} have an equal number of {named}",
                f"there are the same number of {named} in each {word}",
                f"every {word} contains the same number of {named}",
                f"the number of {named} is the same in all {nouns}",
            )  # fmt: skip
            return TrainingPair(text, f"all_same_attribute({boxes}, {counts})")
        pairs = f"combinations({boxes}, 2)"
        first, second = (f"count({box_items(noun, f'p[{index}]')})" for index in (0, 1))
        if self.chance(0.5):
            text = self.pick(
                f"there are two {nouns} with the same number of {named}",
                f"two {nouns} have the same number of {named}",
                f"at least two {nouns} have the same number of {named}",
            )  # fmt: skip
            return TrainingPair(text, f"exist(filter_obj({pairs}, lambda p: {first} == {second}))")
        text = self.pick(
            f"all {nouns} have a different number of {named}", f"each {word} has a different number of {named}",
            f"no two {nouns} have the same number of {named}",
        )  # fmt: skip
        return TrainingPair(text, f"All({pairs}, lambda p: {first} != {second})")

    def largest_box(self) -> TrainingPair:
        """ "the box with the most circles has a blue square" """
        noun = NounTemplate() if self.chance(0.4) else NounTemplate(self.attributes())
        word = self.box_word()
        condition = self.conditions(1)[0]
        most = self.chance(0.8)
        superlatives = (
            ("the most", "most", "the highest number of", "the greatest number of")
            if most
            else ("the fewest", "the least", "the least number of")
        )
        words = self.choice(superlatives)
        count, other_count = (f"count({box_items(noun, box)})" for box in (BOX, "c"))
        is_extreme = f"count(filter_obj(all_boxes, lambda c: {other_count} {'>=' if most else '<='} {count})) == 1"
        text = f"the {word} with {words} {self.noun(noun, True)} {self.box_verb_phrase([condition], plural=False)}"
        return TrainingPair(text, quantity_test(SOME, boxes_where(f"{is_extreme} and {condition.test(BOX)}")))
