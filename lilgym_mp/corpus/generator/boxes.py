"""Synchronous templates for statements about boxes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from lilgym_mp.corpus.generator.conditions import Condition
from lilgym_mp.corpus.generator.fragments import BOX, NONE, SOME, TOWERS, Quantity, at_least, boxes_where, exactly
from lilgym_mp.corpus.generator.items import ItemStatements
from lilgym_mp.corpus.generator.writer import Noun, TrainingPair, pluralised


class Statements(ItemStatements):
    """Statements about items and boxes, sampled by the weights in the phrase book."""

    def sample(self) -> TrainingPair:
        """A statement and its program from a random template."""
        (name,) = self.rng.choices(self.book.statements, cum_weights=self.book.cumulative_weights)
        return getattr(self, name)()

    def box_quantity(self) -> Quantity:
        """Draws how many boxes a statement speaks about."""
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
            if self.is_tower(word) and not {"three", "3"} & set(text.split(f" {pluralised(word)} ")[0].split()):
                condition_tests = " and ".join(condition.test(BOX) for condition in conditions)
                return TrainingPair(text, f"All({TOWERS}, lambda {BOX}: {condition_tests})")
            return TrainingPair(text, f"All(all_boxes, lambda {BOX}: {tests})")
        return TrainingPair(self.box_text(quantity, word, conditions), quantity.test(boxes_where(tests)))

    def is_tower(self, word: str) -> bool:
        """Whether the word for a box is that for a tower in this annotator's style."""
        return word == self.style.words.get("tower")

    def box_tests(self, word: str, conditions: Sequence[Condition], box: str = BOX) -> str:
        """Program text: whether the box meets all conditions, and is a tower if the word says so."""
        tests = [condition.test(box) for condition in conditions]
        return " and ".join([f"{box}.is_tower()", *tests] if self.is_tower(word) else tests)

    def box_text(self, quantity: Quantity, word: str, conditions: Sequence[Condition]) -> str:
        """Text about how many boxes meet the conditions, without the full stop."""
        draw = self.rng.random()
        nouns = pluralised(word)
        if quantity == NONE and draw < 0.4:
            return f"{self.say('no_box')} {nouns} {self.box_verb_phrase(conditions, plural=self.chance(0.5))}"
        if quantity.low >= 1 and draw < 0.22:
            of_the = self.partitive_boxes(quantity)
            if of_the.startswith("in "):
                contents = [condition.contents for condition in conditions if condition.contents]
                if len(contents) == len(conditions) and not any(condition.negative for condition in conditions):
                    return f"in one of the {nouns} there is {self.conjoined(contents, ())}"
                of_the = "one of the"
            return f"{of_the} {nouns} {self.box_verb_phrase(conditions, quantity.low > 1)}"
        words = self.determiner(quantity)
        plural = words.plural
        noun = pluralised(word) if plural else word
        text = f"{words.text} {noun}" if words.text != "a" else self.a(noun)
        alone = len(conditions) == 1 and not conditions[0].negative and conditions[0].kind != "either"
        only = conditions[0].contents if alone else None
        if quantity == SOME and only is not None and draw < 0.34:
            place = self.say("in_a_box", place=word, places=nouns)
            plural = not only.startswith(("a ", "an ", "one ", "1 ", "exactly one", "exactly 1", "only one", "no "))
            there = "there are" if plural and not self.style.sloppy else "there is"
            return self.pick(f"there is {only} {place}", f"{there} {only} {place}", f"{place} {there} {only}")
        if draw < 0.82:
            return self.existential(f"{text} {self.box_modifier(conditions, plural)}", plural)
        return f"{text} {self.box_verb_phrase(conditions, plural)}"

    def partitive_boxes(self, quantity: Quantity) -> str:
        """ "one of the", "exactly two of the" """
        if quantity == SOME:
            return self.say("at_least_one_box" if self.style.bare_number_is_bound else "one_box")
        if quantity == exactly(1):
            one = self.number(1)
            one = one if self.style.bare_number_is_bound else f"{self.pick('exactly', 'only', 'just', 'exactly')} {one}"
            return f"{one} of the"
        words = self.determiner(quantity).text
        return f"{self.number(quantity.low)} of the" if words.endswith(" of") else f"{words} of the"

    def every_box(self, word: str, conditions: Sequence[Condition]) -> str:
        """Text that says that every box meets the conditions."""
        nouns = pluralised(word)
        only = conditions[0].contents if len(conditions) == 1 and conditions[0].kind == "contains" else None
        if only is not None and only.startswith(("a ", "an ")) and self.chance(0.12):
            return f"there {self.pick(f'is no {word}', f'are no {nouns}')} without {only}"
        subject = self.say("every_box", place=word, places=nouns)
        return f"{subject} {self.box_verb_phrase(conditions, not subject.startswith(('each', 'every')))}"

    def named_box(self) -> TrainingPair:
        """Conditions of the left, middle or right box."""
        index = self.choice(range(3))
        word = self.box_word()
        conditions = self.conditions(self.pick(1, 1, 2))
        place = self.say(f"box_{index}")
        name = f"the {place} {word}" if place != "center" or self.chance(0.5) else f"the {word} in the {place}"
        if place in ("left", "right", "middle") and self.chance(0.15):
            name = f"the {word} {'in' if place == 'middle' else 'on'} the {place}"
        contents = conditions[0].contents
        if len(conditions) == 1 and contents and self.chance(0.25):
            text = self.say("there_in", contents=contents, name=name)
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
        text = self.say(
            "every_box_with",
            place=word,
            places=pluralised(word),
            also=self.pick("", "", " too", " as well"),
            contents=one.contents,
            does=partial(self.box_verb_phrase, [other]),
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
        return TrainingPair(text, SOME.test(boxes_where(tests)))

    def two_adjacent_boxes(self) -> TrainingPair:
        """ "the first two towers have a yellow base" """
        first, names = self.pick((0, "first_two"), (1, "last_two"))
        word = self.box_word()
        condition = self.conditions(1)[0]
        tests = [self.box_tests(word, [condition], f"all_boxes[{index}]") for index in (first, first + 1)]
        text = f"the {self.say(names)} {pluralised(word)} {self.box_verb_phrase([condition], plural=True)}"
        return TrainingPair(text, " and ".join(tests))

    def equal_counts(self) -> TrainingPair:
        """ "all boxes have the same number of blue items" """
        noun = Noun() if self.chance(0.4) else self.some_noun()
        word = self.box_word()
        words = {"place": word, "places": pluralised(word), "nouns": self.noun(noun, plural=True)}
        boxes = TOWERS if self.is_tower(word) else "all_boxes"
        if self.chance(0.6):
            text = self.say("equal_counts", **words)
            return TrainingPair(text, f"all_same_attribute({boxes}, lambda {BOX}: count({noun.in_box(BOX)}))")
        pairs = f"combinations({boxes}, 2)"
        first, second = (f"count({noun.in_box(f'p[{index}]')})" for index in (0, 1))
        if self.chance(0.5):
            program = f"exist(filter_obj({pairs}, lambda p: {first} == {second}))"
            return TrainingPair(self.say("two_equal_counts", **words), program)
        return TrainingPair(self.say("different_counts", **words), f"All({pairs}, lambda p: {first} != {second})")

    def largest_box(self) -> TrainingPair:
        """ "the box with the most circles has a blue square" """
        noun = Noun() if self.chance(0.4) else self.some_noun()
        word = self.box_word()
        condition = self.conditions(1)[0]
        most = self.chance(0.8)
        words = self.say("most_in_box" if most else "fewest_in_box")
        count, other_count = (f"count({noun.in_box(box)})" for box in (BOX, "c"))
        boxes = TOWERS if self.is_tower(word) else "all_boxes"
        is_extreme = f"count(filter_obj({boxes}, lambda c: {other_count} {'>=' if most else '<='} {count})) == 1"
        text = f"the {word} with {words} {self.noun(noun, True)} {self.box_verb_phrase([condition], plural=False)}"
        test = f"{is_extreme} and {condition.test(BOX)}"
        return TrainingPair(text, SOME.test(boxes_where(f"{BOX}.is_tower() and {test}" if boxes == TOWERS else test)))
