"""Synchronous templates for statements about items."""

from __future__ import annotations

from dataclasses import replace

from lilgym_mp.corpus.generator.conditions import BoxConditionTemplates
from lilgym_mp.corpus.generator.lexicon import Phrase, pluralised
from lilgym_mp.corpus.generator.phrases import (
    ANYTHING,
    AttributeWords,
    NounTemplate,
    TrainingPair,
    box_items,
    item_set,
)
from lilgym_mp.corpus.generator.program_text import ALL_ITEMS, BOX, boxes_where, quantity_test
from lilgym_mp.corpus.generator.quantities import NONE, SOME, Quantity, at_least, at_most, exactly


class ItemTemplates(BoxConditionTemplates):
    """Statements about items of both appearances."""

    def existential(self, phrase: Phrase) -> str:
        """An existential statement: "there are two circles", "two circles can be seen"."""
        text, plural = phrase
        draw = self.rng.random()
        if draw < 0.72:
            there = "there are" if plural else "there is"
            if self.style.sloppy and self.chance(0.3):
                there = self.pick("there is", "there is", "there", "there are", "there have", "there exists")
            elif self.chance(0.06):
                there = self.pick("there's", "there exists", "there can be seen", "here is") if not plural else there
            return f"{there} {text}"
        if draw < 0.84:
            return text
        if draw < 0.92:
            be = self.be(plural)
            return self.pick(
                f"{text} {be} present", f"{text} can be seen", f"{text} {be} in the {self.style.picture}",
                f"{text} {be} shown", f"{text} {self.verb('exists', plural)}",
            )  # fmt: skip
        subject = self.pick(
            "we can see", "i see", "you can see", f"the {self.style.picture} has", f"the {self.style.picture} contains",
            f"the {self.style.picture} shows", "we have", f"in the {self.style.picture} there {self.be(plural)}",
        )  # fmt: skip
        return f"{subject} {text}"

    def redundant_adverbial(self) -> str:
        """Mostly empty, sometimes words that add nothing: "in total", "in the picture"."""
        if self.chance(0.88):
            return ""
        boxes = pluralised(self.style.box)
        return self.pick(
            " in total", " in all", " altogether", f" in the {self.style.picture}", f" in the {boxes}",
            f" in the three {boxes}", " overall", " total",
        )  # fmt: skip

    def item_count(self) -> TrainingPair:
        noun = NounTemplate(self.attributes())
        quantity = self.quantity(7)
        return TrainingPair(
            self.existential(self.quantified(quantity, noun)) + self.redundant_adverbial(),
            quantity_test(quantity, item_set(noun)),
        )

    def total_count(self) -> TrainingPair:
        number = self.pick(2, 3, 4, 5, 5, 6, 6, 7, 7, 8, 8, 9, 10)
        quantity = self.pick(exactly(number), exactly(number), at_least(number), at_most(number))
        return TrainingPair(
            self.existential(self.quantified(quantity, ANYTHING)) + self.redundant_adverbial(),
            quantity_test(quantity, ALL_ITEMS),
        )

    def number_is(self) -> TrainingPair:
        """ "the number of blue blocks is three" """
        noun, number = NounTemplate(self.attributes()), self.pick(1, 2, 2, 3, 3, 4, 5, 6)
        adverb, quantity = self.pick(
            ("", exactly(number)), ("exactly ", exactly(number)), ("at least ", at_least(number)),
            ("at most ", at_most(number)), ("more than ", at_least(number + 1)), ("less than ", at_most(number - 1)),
        )  # fmt: skip
        total = self.pick("the number of", "the total number of", "number of", "the count of", "total number of")
        text = f"{total} {self.noun(noun, plural=True)} is {adverb}{self.number(number)}"
        return TrainingPair(text, quantity_test(quantity, item_set(noun)))

    def items_with_predicate(self) -> TrainingPair:
        """Items with one or two predicates."""
        noun = self.noun_with_predicates()
        return self.with_main_predicate(self.quantity(4, none=0.06), noun)

    def noun_with_predicates(self) -> NounTemplate:
        noun = NounTemplate(self.attributes(), (self.predicate(),))
        if self.chance(0.12):
            second = self.predicate()
            if second.kind != noun.predicates[0].kind:
                noun = noun.such_that(second)
        return noun

    def with_main_predicate(self, quantity: Quantity, noun: NounTemplate) -> TrainingPair:
        """A count of items, with the last predicate as a modifier, verb phrase or "one of the ..."."""
        program = quantity_test(quantity, item_set(noun))
        draw = self.rng.random()
        *rest, last = noun.predicates
        subject_noun = NounTemplate(noun.attributes, tuple(rest))
        if draw < 0.6:
            return TrainingPair(self.existential(self.quantified(quantity, noun)), program)
        if draw < 0.63 and quantity == SOME:
            there = self.existential(Phrase(self.indefinite(subject_noun), plural=False))
            conjunction = self.pick(" and it", ", and it", " and that", f" and the {self.style.item}", ". it")
            return TrainingPair(f"{there}{conjunction} {self.verb_phrase(last, plural=False)}", program)
        if quantity == NONE and draw < 0.85:
            none = self.pick("none of the", "none of the", "not one of the", "no one of the")
            text = f"{none} {self.noun(subject_noun, plural=True)} {self.verb_phrase(last, plural=self.chance(0.4))}"
            return TrainingPair(text, program)
        if draw < 0.74 and quantity.low == 1 and quantity.high in (1, None):
            one = self.partitive(quantity)
            text = f"{one} {self.noun(subject_noun, plural=True)} {self.verb_phrase(last, plural=False)}"
            return TrainingPair(text, program)
        if draw < 0.82 and quantity.low > 1 and not quantity.vague:
            words = self.determiner(quantity)
            if not words.text.endswith((" of", "total")):
                of_the = f"{words.text} of the {self.noun(subject_noun, plural=True)}"
                return TrainingPair(f"{of_the} {self.verb_phrase(last, words.plural)}", program)
        subject = self.quantified(quantity, subject_noun)
        there = self.existential(subject) if self.chance(0.3) else subject.text
        text = f"{subject.text} {self.verb_phrase(last, subject.plural)}"
        if there != subject.text and last.positive:
            text = f"{there} {self.modifier(last, subject.plural)}"
        return TrainingPair(text, program)

    def partitive(self, quantity: Quantity) -> str:
        if quantity == exactly(1):
            if self.style.bare_number_is_bound:
                return "one of the"
            return self.pick("exactly one of the", "only one of the", "just one of the", "exactly 1 of the")
        if self.style.bare_number_is_bound:
            return self.pick("at least one of the", "at least 1 of the", "some of the")
        return self.pick("one of the", "one of the", "at least one of the", "at least 1 of the", "some of the")

    def definite(self) -> TrainingPair:
        """ "the black triangle is touching a wall": read as "there is one that does"."""
        noun = self.noun_with_predicates()
        *rest, last = noun.predicates
        named = NounTemplate(noun.attributes, tuple(rest))
        the = self.pick("the", "the", "the", "", "a")
        if the == "a":
            text = f"{self.indefinite(named)} {self.verb_phrase(last, plural=False)}"
        else:
            text = f"{the} {self.noun(named, plural=False)} {self.verb_phrase(last, plural=False)}".strip()
        return TrainingPair(text, quantity_test(SOME, item_set(noun)))

    def only_item_with_predicate(self) -> TrainingPair:
        """Exactly one such item exists, and it satisfies the predicate."""
        noun, predicate = NounTemplate(self.attributes()), self.predicate()
        all_of_them = item_set(noun)
        program = f"count({all_of_them}) == 1 and exist({item_set(noun.such_that(predicate))})"
        one = self.quantified(exactly(1), noun).text
        verb_phrase = self.verb_phrase(predicate, plural=False)
        text = self.pick(
            f"the only {self.noun(noun, plural=False)} {verb_phrase}",
            f"there is {one} and it {verb_phrase}",
            f"there is {one} and that {verb_phrase}",
            f"there is {one}, and it {verb_phrase}",
            f"there is {one} and this {self.style.item} {verb_phrase}",
        )
        return TrainingPair(text, program)

    def partitive_count(self) -> TrainingPair:
        """A count of items and a count of those among them that satisfy a predicate."""
        noun, predicate = NounTemplate(self.attributes()), self.predicate()
        total = self.pick(2, 2, 3, 3, 4)
        part = self.pick("all", "none", *(exactly(n) for n in range(1, total)))
        total_test = f"count({item_set(noun)}) == {total}"
        named = self.quantified(exactly(total), noun).text
        conjunction = self.pick(" and", ",", ", and", " of which", " out of which")
        of_them = "" if "which" in conjunction else " of them"
        if part == "all":
            words = self.pick("both", "all") if total == 2 else self.pick("all", "all", f"all {self.number(total)}")
            subject, plural = f"{words}{of_them}", True
            quantity = exactly(total)
        elif part == "none":
            words = "neither" if total == 2 else "none"
            subject, plural, quantity = f"{words}{of_them}", False, NONE
        else:
            assert isinstance(part, Quantity)
            words = self.pick("", "exactly ", "only ") + self.number(part.low)
            subject, plural, quantity = f"{words}{of_them}", part.low > 1, part
        part_test = quantity_test(quantity, item_set(noun.such_that(predicate)))
        text = f"there {self.be(True)} {named}{conjunction} {subject} {self.verb_phrase(predicate, plural)}"
        return TrainingPair(text, f"{total_test} and {part_test}")

    def every_item(self) -> TrainingPair:
        """There are such items, and all satisfy the predicate."""
        noun, predicate = self.pick(ANYTHING, *[NounTemplate(self.attributes())] * 4), self.predicate()
        if self.chance(0.2):
            noun, predicate = self.noun_with_predicates(), self.attribute_predicate(AttributeWords(self.colour()))
            noun = NounTemplate(AttributeWords(shape=noun.attributes.shape, size=noun.attributes.size), noun.predicates)
        program = f"All({item_set(noun)}, lambda x: {predicate.signed_test('x')})"
        nouns, singular = self.noun(noun, plural=True), self.noun(noun, plural=False)
        the_nouns = f"all the {nouns}" if nouns == singular else f"the {nouns}"
        text = self.pick(
            f"all {nouns} {self.verb_phrase(predicate, plural=True)}",
            f"all the {nouns} {self.verb_phrase(predicate, plural=True)}",
            f"all of the {nouns} {self.verb_phrase(predicate, plural=True)}",
            f"every {singular} {self.verb_phrase(predicate, plural=False)}",
            f"each {singular} {self.verb_phrase(predicate, plural=False)}",
            f"each of the {nouns} {self.verb_phrase(predicate, plural=False)}",
            f"{the_nouns} {self.verb_phrase(predicate, plural=True)}",
            f"{the_nouns} {self.be(True)} all {predicate.main_complement or predicate.complement}"
            if predicate.positive
            else f"the {nouns} {self.verb_phrase(predicate, plural=True)}",
        )
        return TrainingPair(text, program)

    def not_every_item(self) -> TrainingPair:
        noun, predicate = NounTemplate(self.attributes()), self.predicate()
        if not predicate.positive:
            predicate = replace(predicate, positive=True)
        program = f"exist({item_set(noun.such_that(replace(predicate, positive=False)))})"
        nouns, singular = self.noun(noun, plural=True), self.noun(noun, plural=False)
        text = self.pick(
            f"not all {nouns} {self.verb_phrase(predicate, plural=True)}",
            f"not all the {nouns} {self.verb_phrase(predicate, plural=True)}",
            f"not all of the {nouns} {self.verb_phrase(predicate, plural=True)}",
            f"not every {singular} {self.verb_phrase(predicate, plural=False)}",
            f"at least one {singular} {self.verb_phrase(replace(predicate, positive=False), plural=False)}",
        )
        return TrainingPair(text, program)

    def only_these(self) -> TrainingPair:
        """ "only blue circles are touching a wall": something does, and everything that does is a blue circle."""
        attributes, predicate = self.attributes(), replace(self.predicate(), positive=True)
        verb_phrase = self.verb_phrase(predicate, plural=True)
        attribute_predicate = self.attribute_predicate(attributes)
        program = (
            f"All({item_set(NounTemplate(predicates=(predicate,)))}, lambda x: {attribute_predicate.signed_test('x')})"
        )
        nouns = self.described_noun(attributes, plural=True)
        text = self.pick(
            f"only {nouns} {verb_phrase}",
            f"only the {nouns} {verb_phrase}",
            f"every {self.style.item} {self.modifier(predicate, False)} is {attribute_predicate.complement}",
            f"all {pluralised(self.style.item)} {self.modifier(predicate, True)} are "
            f"{nouns if attributes.shape else attribute_predicate.complement}",
            f"no {self.style.item} other than {nouns} {self.verb_phrase(predicate, False)}",
        )
        return TrainingPair(text, program)

    def shared_value(self) -> TrainingPair:
        """All such items have the same value of an attribute, or not all do."""
        attribute = self.attribute_name()
        noun = NounTemplate(self.attributes_without(attribute))
        if self.chance(0.3):
            noun = noun.such_that(replace(self.predicate(), positive=True))
        nouns = self.noun(noun, plural=True)
        program = f"all_same_{attribute}({item_set(noun)})"
        if self.chance(0.3):
            text = self.pick(
                f"not all {nouns} {self.have_same(attribute)}",
                f"not all of the {nouns} {self.have_same(attribute)}",
                f"there are {nouns} of different {attribute}s",
                f"the {nouns} have different {attribute}s",
                f"the {nouns} {self.pick('are not', 'do not have')} the same {attribute}".replace(
                    "are not the same", "are not of the same"
                ),
            )
            values = f"get_set_{attribute}s({item_set(noun)})"
            return TrainingPair(text, f"ge(count({values}), 2)")
        text = self.pick(
            f"all {nouns} {self.have_same(attribute)}",
            f"all the {nouns} {self.have_same(attribute)}",
            f"all of the {nouns} {self.have_same(attribute)}",
            f"the {nouns} {self.have_same(attribute)}",
            f"the {nouns} all {self.have_same(attribute)}",
            f"every {self.noun(noun, plural=False)} has the same {attribute}",
        )
        return TrainingPair(text, program)

    def scene_variety(self) -> TrainingPair:
        """The number of different colours, shapes or sizes in the picture."""
        attribute = self.attribute_name()
        number = self.pick(1, 2, 2, 3, 3)
        values = f"get_set_{attribute}s({ALL_ITEMS})"
        words = self.variety_words(attribute, number)
        nouns = pluralised(self.style.item)
        there = self.pick(
            f"there are {nouns}", nouns, f"the {self.style.picture} has {nouns}",
            f"the {pluralised(self.style.box)} have {nouns}", f"there is {nouns}",
        )  # fmt: skip
        named = f"there {self.be(number > 1)} {words} in the {self.style.picture}"
        if attribute == "shape" and "different" not in words:
            named = f"{nouns} of {words} are in the {self.style.picture}"
        text = self.pick(f"{there} {self.pick('of', 'of', 'with', 'in')} {words}", named)
        return TrainingPair(text, f"count({values}) == {number}")

    def count_comparison(self) -> TrainingPair:
        """A comparison of two counts of items."""
        first, second = self.two_disjoint_nouns()
        order, margin = self.pick("more", "more", "fewer", "equal", "more", "fewer", "equal", "at least"), None
        if order == "more" and self.chance(0.15):
            margin = self.pick(1, 1, 2, 3)
        words = self.comparison(first, second, order, margin)
        text = self.pick(
            f"there are {words}", f"there are {words}", f"the {self.style.picture} has {words}", f"there is {words}",
            words,
        )  # fmt: skip
        if order == "equal" and self.chance(0.3):
            text = self.pick(
                f"the number of {self.noun(first, True)} {self.pick('is the same as', 'equals', 'is equal to')} "
                f"the number of {self.noun(second, True)}",
                f"the number of {self.noun(first, True)} and {self.noun(second, True)} is "
                f"{self.pick('the same', 'equal')}",
                f"number of {self.noun(first, True)} and number of {self.noun(second, True)} are "
                f"{self.pick('the same', 'equal', 'same')}",
            )
        if order in ("more", "fewer") and margin is None and self.chance(0.2):
            greater = ("more than", "greater than", "bigger than", "higher than")
            less = ("less than", "fewer than", "smaller than", "lower than")
            comparative = self.choice(greater if order == "more" else less)
            number = self.pick("the number of", "number of", "the total number of")
            text = f"{number} {self.noun(first, True)} is {comparative} {number} {self.noun(second, True)}"
        return TrainingPair(text, self.comparison_test(first, second, order, margin, ALL_ITEMS))

    def compound(self) -> TrainingPair:
        """A conjunction or disjunction of two statements."""
        one, other = self.simple_statement(), self.simple_statement()
        words, operator = self.pick(
            (" and ", "and"), (", and ", "and"), (" and ", "and"), (", but ", "and"), (" or ", "or"),
            (", while ", "and"), (". also ", "and"),
        )  # fmt: skip
        second = other.statement
        if one.statement.startswith("there ") and second.startswith(("there is ", "there are ")) and self.chance(0.5):
            second = second.split(" ", 2)[2]
        either = "either " if operator == "or" and self.chance(0.3) else ""
        return TrainingPair(either + one.statement + words + second, f"({one.program}) {operator} ({other.program})")

    def simple_statement(self) -> TrainingPair:
        return self.pick(self.item_count, self.items_with_predicate, self.box_count)()

    def two_item_counts(self) -> TrainingPair:
        """ "there are two circles and one black square" """
        first_noun, second_noun = self.two_disjoint_nouns()
        first, second = self.quantity(4, none=0), self.quantity(4, none=0.2)
        opening = self.existential(self.quantified(first, first_noun))
        conjunction = (
            "but" if second == NONE and self.chance(0.6) else self.pick("and", "and", "and", ", and", "as well as")
        )
        text = f"{opening} {conjunction} {self.quantified(second, second_noun).text}".replace(" ,", ",")
        return TrainingPair(
            text, f"({quantity_test(first, item_set(first_noun))}) and ({quantity_test(second, item_set(second_noun))})"
        )

    # Boxes

    def both_items(self) -> TrainingPair:
        """ "both black triangles touch a wall" """
        noun, predicate = NounTemplate(self.attributes()), self.predicate()
        nouns = self.noun(noun, plural=True)
        negative = self.chance(0.2)
        predicate = replace(predicate, positive=True) if negative else predicate
        if negative:
            text = f"neither of the {self.pick('two ', '')}{nouns} {self.verb_phrase(predicate, plural=False)}"
            predicate = replace(predicate, positive=False)
        else:
            both = self.pick("both", "both the", "both of the", "the two")
            text = f"{both} {nouns} {self.verb_phrase(predicate, plural=True)}"
        every = f"All({item_set(noun)}, lambda x: {predicate.signed_test('x')})"
        return TrainingPair(text, f"count({item_set(noun)}) == 2 and {every}")

    def all_but_some(self) -> TrainingPair:
        """ "all items except one are blue" """
        noun = ANYTHING if self.chance(0.5) else NounTemplate(AttributeWords(shape=self.attributes().shape))
        predicate = (
            self.attribute_predicate(AttributeWords(self.colour()))
            if self.chance(0.6)
            else replace(self.predicate(), positive=True)
        )
        number = self.pick(1, 1, 1, 2)
        nouns, count = self.noun(noun, plural=True), self.number(number)
        verb_phrase = self.verb_phrase(predicate, plural=True)
        text = self.pick(
            f"all {nouns} except {count} {verb_phrase}", f"all the {nouns} but {count} {verb_phrase}",
            f"all but {count} of the {nouns} {verb_phrase}", f"all {nouns} {verb_phrase} except {count}",
            f"all except {count} of the {nouns} {verb_phrase}", f"all the {nouns} {verb_phrase} except for {count}",
        )  # fmt: skip
        others = item_set(noun.such_that(replace(predicate, positive=False)))
        return TrainingPair(text, f"exist({item_set(noun.such_that(predicate))}) and count({others}) == {number}")

    def most_items(self) -> TrainingPair:
        """ "most circles are blue" """
        noun, predicate = NounTemplate(self.attributes()), replace(self.predicate(), positive=True)
        if self.chance(0.5):
            predicate = self.attribute_predicate(AttributeWords(self.colour()))
            noun = NounTemplate(AttributeWords(shape=noun.attributes.shape))
        nouns = self.noun(noun, plural=True)
        verb_phrase = self.verb_phrase(predicate, plural=True)
        most = self.pick("most of the", "most", "most of", "a majority of the", "more than half of the")
        text = f"{most} {nouns} {verb_phrase}"
        others = item_set(noun.such_that(replace(predicate, positive=False)))
        return TrainingPair(text, f"count({item_set(noun.such_that(predicate))}) > count({others})")

    def no_two_items_alike(self) -> TrainingPair:
        """ "no two items are the same color" """
        attribute = self.attribute_name()
        noun = NounTemplate(self.attributes_without(attribute))
        nouns = self.noun(noun, plural=True)
        text = self.pick(
            f"no two {nouns} {self.have_same(attribute)}", f"no two {nouns} have the same {attribute}",
            f"all the {nouns} have different {attribute}s", f"all {nouns} are of different {attribute}s",
            f"there are no two {nouns} of the same {attribute}",
        )  # fmt: skip
        values = f"get_set_{attribute}s({item_set(noun)})"
        return TrainingPair(text, f"exist({item_set(noun)}) and count({item_set(noun)}) == count({values})")

    def items_in_same_box(self) -> TrainingPair:
        """ "all the circles are in the same box", "a circle and a square are in the same box" """
        box = self.box_word()
        same = self.pick(f"in the same {box}", f"in one {box}", f"in the same {box}", f"in a single {box}")
        if self.chance(0.5):
            noun = NounTemplate(self.attributes())
            nouns = self.noun(noun, plural=True)
            text = self.pick(
                f"all {nouns} are {same}", f"all the {nouns} are {same}", f"the {nouns} are all {same}",
                f"all of the {nouns} are {same}", f"only one {box} has {nouns}",
            )  # fmt: skip
            boxes = boxes_where(f"exist({box_items(noun, BOX)})")
            return TrainingPair(text, quantity_test(exactly(1), boxes))
        first_noun, second_noun = self.two_disjoint_nouns()
        first, second = self.quantity_in_box(3), self.quantity_in_box(3)
        things = f"{self.quantified(first, first_noun).text} and {self.quantified(second, second_noun).text}"
        text = self.pick(f"there are {things} {same}", f"{things} are {same}", f"there is {things} {same}")
        first_test = quantity_test(first, box_items(first_noun, BOX))
        second_test = quantity_test(second, box_items(second_noun, BOX))
        return TrainingPair(text, quantity_test(SOME, boxes_where(f"{first_test} and {second_test}")))
