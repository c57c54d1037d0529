"""Synchronous templates for statements about items."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from lilgym_mp.corpus.generator.conditions import BoxConditions
from lilgym_mp.corpus.generator.fragments import BOX, NONE, SOME, Quantity, at_least, at_most, boxes_where, exactly
from lilgym_mp.corpus.generator.writer import ANYTHING, Attributes, Noun, Predicate, TrainingPair


def all_are(noun: Noun, predicate: Predicate) -> str:
    """Program text: all items that the noun phrase denotes satisfy the predicate."""
    return f"All({noun.items()}, lambda x: {predicate.signed_test('x')})"


class ItemStatements(BoxConditions):
    """Statements about items of both appearances."""

    def box_count(self) -> TrainingPair:
        """Draws a statement about the number of boxes that meet conditions."""
        raise NotImplementedError

    def existential(self, text: str, plural: bool) -> str:
        """An existential statement: "there are two circles", "two circles can be seen"."""
        draw = self.rng.random()
        if draw < 0.72:
            there = "there are" if plural else "there is"
            if self.style.sloppy and self.chance(0.3):
                there = self.say("there_is_sloppy")
            elif self.chance(0.06) and not plural:
                there = self.say("there_is_rare")
            return f"{there} {text}"
        if draw < 0.84:
            return text
        if draw < 0.92:
            return self.say("is_seen", text=text, be=self.be(plural), exists=self.verb("exists", plural))
        return f"{self.say('we_see', be=self.be(plural))} {text}"

    def redundant_adverbial(self) -> str:
        """Mostly empty, sometimes words that add nothing: "in total", "in the picture"."""
        return "" if self.chance(0.88) else self.say("in_total")

    def item_count(self) -> TrainingPair:
        """Draws a statement about the number of items with some attributes."""
        noun = self.some_noun()
        quantity = self.quantity(7)
        text = self.existential(*self.quantified(quantity, noun)) + self.redundant_adverbial()
        return TrainingPair(text, quantity.test(noun.items()))

    def total_count(self) -> TrainingPair:
        """Draws a statement about the number of all items."""
        number = self.pick(2, 3, 4, 5, 5, 6, 6, 7, 7, 8, 8, 9, 10)
        quantity = self.pick(exactly(number), exactly(number), at_least(number), at_most(number))
        text = self.existential(*self.quantified(quantity, ANYTHING)) + self.redundant_adverbial()
        return TrainingPair(text, quantity.test(ANYTHING.items()))

    def number_is(self) -> TrainingPair:
        """ "the number of blue blocks is three" """
        noun = self.some_noun()
        number = self.pick(1, 2, 2, 3, 3, 4, 5, 6)
        adverb, quantity = self.pick(
            ("", exactly(number)),
            ("exactly ", exactly(number)),
            ("at least ", at_least(number)),
            ("at most ", at_most(number)),
            ("more than ", at_least(number + 1)),
            ("less than ", at_most(number - 1)),
        )
        text = f"{self.say('the_number_of')} {self.noun(noun, plural=True)} is {adverb}{self.number(number)}"
        return TrainingPair(text, quantity.test(noun.items()))

    def items_with_predicate(self) -> TrainingPair:
        """Items with one or two predicates."""
        noun = self.noun_with_predicates()
        return self.with_main_predicate(self.quantity(4, none=0.06), noun)

    def noun_with_predicates(self) -> Noun:
        """Draws a noun with one predicate or, rarely, two of different kinds."""
        noun = Noun(self.some_attributes(), (self.predicate(),))
        if self.chance(0.12):
            second = self.predicate()
            if second.kind != noun.predicates[0].kind:
                noun = noun.such_that(second)
        return noun

    def with_main_predicate(self, quantity: Quantity, noun: Noun) -> TrainingPair:
        """A count of items, with the last predicate as a modifier, verb phrase or "one of the ..."."""
        return TrainingPair(self._with_last_predicate(quantity, noun), quantity.test(noun.items()))

    def _with_last_predicate(self, quantity: Quantity, noun: Noun) -> str:
        draw = self.rng.random()
        *rest, last = noun.predicates
        subject_noun = Noun(noun.attributes, tuple(rest))
        if draw < 0.6:
            return self.existential(*self.quantified(quantity, noun))
        if draw < 0.63 and quantity == SOME:
            there = self.existential(self.indefinite(subject_noun), plural=False)
            return f"{there}{self.say('and_it')} {self.verb_phrase(last, plural=False)}"
        if quantity == NONE and draw < 0.85:
            none = self.say("none_of_the")
            return f"{none} {self.noun(subject_noun, plural=True)} {self.verb_phrase(last, plural=self.chance(0.4))}"
        if draw < 0.74 and quantity.low == 1 and quantity.high in (1, None):
            one = self.partitive(quantity)
            return f"{one} {self.noun(subject_noun, plural=True)} {self.verb_phrase(last, plural=False)}"
        if draw < 0.82 and quantity.low > 1 and not quantity.vague:
            words = self.determiner(quantity)
            if not words.text.endswith((" of", "total")):
                of_the = f"{words.text} of the {self.noun(subject_noun, plural=True)}"
                return f"{of_the} {self.verb_phrase(last, words.plural)}"
        subject = self.quantified(quantity, subject_noun)
        there = self.existential(*subject) if self.chance(0.3) else subject.text
        text = f"{subject.text} {self.verb_phrase(last, subject.plural)}"
        if there != subject.text and last.positive:
            text = f"{there} {self.modifier(last, subject.plural)}"
        return text

    def partitive(self, quantity: Quantity) -> str:
        """The words before a plural noun: "exactly one of the" or "at least one of the"."""
        if self.style.bare_number_is_bound:
            return "one of the" if quantity == exactly(1) else self.say("at_least_one_of_the")
        return self.say("exactly_one_of_the" if quantity == exactly(1) else "one_of_the")

    def definite(self) -> TrainingPair:
        """ "the black triangle is touching a wall": read as "there is one that does"."""
        noun = self.noun_with_predicates()
        *rest, last = noun.predicates
        named = Noun(noun.attributes, tuple(rest))
        the = self.pick("the", "the", "the", "", "a")
        subject = self.indefinite(named) if the == "a" else f"{the} {self.noun(named, plural=False)}"
        text = f"{subject} {self.verb_phrase(last, plural=False)}".strip()
        return TrainingPair(text, SOME.test(noun.items()))

    def only_item_with_predicate(self) -> TrainingPair:
        """Exactly one such item exists, and it satisfies the predicate."""
        noun = self.some_noun()
        predicate = self.predicate()
        one = self.quantified(exactly(1), noun).text
        does = self.verb_phrase(predicate, plural=False)
        text = self.say("only_item", exactly_one=one, does=does, noun=self.noun(noun, plural=False))
        return TrainingPair(text, f"{exactly(1).test(noun.items())} and {SOME.test(noun.such_that(predicate).items())}")

    def partitive_count(self) -> TrainingPair:
        """A count of items and a count of those among them that satisfy a predicate."""
        noun = self.some_noun()
        predicate = self.predicate()
        total = self.pick(2, 2, 3, 3, 4)
        part = self.pick(total, 0, *range(1, total))
        named = self.quantified(exactly(total), noun).text
        conjunction = self.say("of_these")
        if part == total:
            words = self.pick("both", "all") if total == 2 else self.pick("all", "all", f"all {self.number(total)}")
        elif part == 0:
            words = "neither" if total == 2 else "none"
        else:
            words = self.pick("", "exactly ", "only ") + self.number(part)
        subject = words if "which" in conjunction else f"{words} of them"
        text = f"there {self.be(True)} {named}{conjunction} {subject} {self.verb_phrase(predicate, part > 1)}"
        part_test = exactly(part).test(noun.such_that(predicate).items())
        return TrainingPair(text, f"{exactly(total).test(noun.items())} and {part_test}")

    def every_item(self) -> TrainingPair:
        """There are such items, and all satisfy the predicate."""
        noun = self.pick(ANYTHING, *[self.some_noun()] * 4)
        predicate = self.predicate()
        if self.chance(0.2):
            noun = self.noun_with_predicates()
            predicate = self.attribute_predicate(Attributes(self.colour()))
            noun = Noun(Attributes(shape=noun.attributes.shape, size=noun.attributes.size), noun.predicates)
        nouns = self.noun(noun, plural=True)
        singular = self.noun(noun, plural=False)
        the_nouns = f"all the {nouns}" if nouns == singular else f"the {nouns}"
        does = partial(self.verb_phrase, predicate)
        complement = predicate.main_complement or predicate.complement

        def all_do(plural: bool) -> str:
            return f"{self.be(True)} all {complement}" if predicate.positive else does(plural)

        they = the_nouns if predicate.positive else f"the {nouns}"
        words = {"nouns": nouns, "noun": singular, "the_nouns": the_nouns, "they": they}
        return TrainingPair(self.say("every_item", does=does, all_do=all_do, **words), all_are(noun, predicate))

    def not_every_item(self) -> TrainingPair:
        """Draws a statement that some item lacks a property."""
        noun = self.some_noun()
        predicate = replace(self.predicate(), positive=True)
        negated = replace(predicate, positive=False)
        nouns = self.noun(noun, plural=True)
        singular = self.noun(noun, plural=False)
        does = partial(self.verb_phrase, predicate)
        does_not = partial(self.verb_phrase, negated)
        text = self.say("not_every_item", nouns=nouns, noun=singular, does=does, does_not=does_not)
        return TrainingPair(text, SOME.test(noun.such_that(negated).items()))

    def only_these(self) -> TrainingPair:
        """ "only blue circles are touching a wall": something does, and everything that does is a blue circle."""
        attributes = self.some_attributes()
        predicate = replace(self.predicate(), positive=True)
        do = self.verb_phrase(predicate, plural=True)
        attribute_predicate = self.attribute_predicate(attributes)
        what = attribute_predicate.complement
        nouns = self.described_noun(attributes, plural=True)
        words = {"do": do, "nouns": nouns, "what": what, "whats": nouns if attributes.shape else what}
        does = partial(self.verb_phrase, predicate)
        doing = partial(self.modifier, predicate)
        text = self.say("only_these", does=does, doing=doing, **words)
        return TrainingPair(text, all_are(Noun(predicates=(predicate,)), attribute_predicate))

    def shared_value(self) -> TrainingPair:
        """All such items have the same value of an attribute, or not all do."""
        attribute = self.attribute_name()
        noun = Noun(self.attributes_without(attribute))
        if self.chance(0.3):
            noun = noun.such_that(replace(self.predicate(), positive=True))
        nouns = self.noun(noun, plural=True)
        is_shared = not self.chance(0.3)
        text = self.say(
            "alike" if is_shared else "not_alike",
            nouns=nouns,
            noun=partial(self.noun, noun),
            attribute=attribute,
            same=lambda _: self.have_same(attribute),
        )
        items = noun.items()
        program = f"all_same_{attribute}({items})" if is_shared else f"ge(count(get_set_{attribute}s({items})), 2)"
        return TrainingPair(text, program)

    def scene_variety(self) -> TrainingPair:
        """The number of different colours, shapes or sizes in the picture."""
        attribute = self.attribute_name()
        number = self.pick(1, 2, 2, 3, 3)
        words = self.say(f"variety_{number}", attribute=attribute)
        there = self.say("there_are_items")
        picture = self.word("picture")
        named = f"there {self.be(number > 1)} {words} in the {picture}"
        if attribute == "shape" and "different" not in words:
            named = f"{self.word('items')} of {words} are in the {picture}"
        text = self.pick(f"{there} {self.pick('of', 'of', 'with', 'in')} {words}", named)
        return TrainingPair(text, f"count(get_set_{attribute}s({ANYTHING.items()})) == {number}")

    def count_comparison(self) -> TrainingPair:
        """A comparison of two counts of items."""
        first, second = self.two_disjoint_nouns()
        order = self.pick("more", "more", "fewer", "equal", "more", "fewer", "equal", "at least")
        margin = None
        if order == "more" and self.chance(0.15):
            margin = self.pick(1, 1, 2, 3)
        text = self.say("there_is_comparison", words=self.comparison(first, second, order, margin))
        if order == "equal" and self.chance(0.3):
            text = self.say("equal_numbers", first=partial(self.noun, first), second=partial(self.noun, second))
        if order in ("more", "fewer") and margin is None and self.chance(0.2):
            comparative = self.say(f"number_is_{order}")
            number = self.pick("the number of", "number of", "the total number of")
            text = f"{number} {self.noun(first, True)} is {comparative} {number} {self.noun(second, True)}"
        return TrainingPair(text, self.comparison_test(first, second, order, margin))

    def compound(self) -> TrainingPair:
        """A conjunction or disjunction of two statements."""
        one = self.simple_statement()
        other = self.simple_statement()
        words, operator = self.pick(
            (" and ", "and"),
            (", and ", "and"),
            (" and ", "and"),
            (", but ", "and"),
            (" or ", "or"),
            (", while ", "and"),
            (". also ", "and"),
        )
        second = other.statement
        if one.statement.startswith("there ") and second.startswith(("there is ", "there are ")) and self.chance(0.5):
            second = second.split(" ", 2)[2]
        either = "either " if operator == "or" and self.chance(0.3) else ""
        return TrainingPair(either + one.statement + words + second, f"({one.program}) {operator} ({other.program})")

    def simple_statement(self) -> TrainingPair:
        """Draws a statement of one clause, as needed within longer ones."""
        return self.pick(self.item_count, self.items_with_predicate, self.box_count)()

    def two_item_counts(self) -> TrainingPair:
        """ "there are two circles and one black square" """
        first_noun, second_noun = self.two_disjoint_nouns()
        first = self.quantity(4, none=0)
        second = self.quantity(4, none=0.2)
        opening = self.existential(*self.quantified(first, first_noun))
        but = second == NONE and self.chance(0.6)
        conjunction = "but" if but else self.pick("and", "and", "and", ", and", "as well as")
        text = f"{opening} {conjunction} {self.quantified(second, second_noun).text}".replace(" ,", ",")
        return TrainingPair(text, f"({first.test(first_noun.items())}) and ({second.test(second_noun.items())})")

    def both_items(self) -> TrainingPair:
        """ "both black triangles touch a wall" """
        noun = self.some_noun()
        predicate = self.predicate()
        nouns = self.noun(noun, plural=True)
        if self.chance(0.2):
            two = self.pick("two ", "")
            positive = replace(predicate, positive=True)
            text = f"neither of the {two}{nouns} {self.verb_phrase(positive, plural=False)}"
            predicate = replace(predicate, positive=False)
        else:
            both = self.pick("both", "both the", "both of the", "the two")
            text = f"{both} {nouns} {self.verb_phrase(predicate, plural=True)}"
        return TrainingPair(text, f"{exactly(2).test(noun.items())} and {all_are(noun, predicate)}")

    def all_but_some(self) -> TrainingPair:
        """ "all items except one are blue" """
        noun = ANYTHING if self.chance(0.5) else Noun(Attributes(shape=self.some_attributes().shape))
        coloured = self.chance(0.6)
        predicate = self.attribute_predicate(Attributes(self.colour())) if coloured else self.predicate()
        predicate, negated = (replace(predicate, positive=positive) for positive in (True, False))
        number = self.pick(1, 1, 1, 2)
        nouns = self.noun(noun, plural=True)
        do = self.verb_phrase(predicate, plural=True)
        text = self.say("all_but_some", nouns=nouns, count=self.number(number), do=do)
        others = exactly(number).test(noun.such_that(negated).items())
        return TrainingPair(text, f"{SOME.test(noun.such_that(predicate).items())} and {others}")

    def most_items(self) -> TrainingPair:
        """ "most circles are blue" """
        noun = self.some_noun()
        predicate = replace(self.predicate(), positive=True)
        if self.chance(0.5):
            predicate = self.attribute_predicate(Attributes(self.colour()))
            noun = Noun(Attributes(shape=noun.attributes.shape))
        nouns = self.noun(noun, plural=True)
        verb_phrase = self.verb_phrase(predicate, plural=True)
        others = noun.such_that(replace(predicate, positive=False)).items()
        program = f"count({noun.such_that(predicate).items()}) > count({others})"
        return TrainingPair(f"{self.say('most')} {nouns} {verb_phrase}", program)

    def no_two_items_alike(self) -> TrainingPair:
        """ "no two items are the same color" """
        attribute = self.attribute_name()
        noun = Noun(self.attributes_without(attribute))
        nouns = self.noun(noun, plural=True)
        same = self.have_same(attribute)
        text = self.say("no_two_items_alike", nouns=nouns, attribute=attribute, same=same)
        items = noun.items()
        return TrainingPair(text, f"exist({items}) and count({items}) == count(get_set_{attribute}s({items}))")

    def items_in_same_box(self) -> TrainingPair:
        """ "all the circles are in the same box", "a circle and a square are in the same box" """
        box = self.box_word()
        same = self.say("in_same_box", place=box)
        if self.chance(0.5):
            noun = self.some_noun()
            text = self.say("all_in_same_box", nouns=self.noun(noun, plural=True), same=same, place=box)
            return TrainingPair(text, exactly(1).test(boxes_where(f"exist({noun.in_box(BOX)})")))
        nouns = self.two_disjoint_nouns()
        counts = list(zip((self.quantity_in_box(3), self.quantity_in_box(3)), nouns, strict=True))
        things = " and ".join(self.quantified(quantity, noun).text for quantity, noun in counts)
        text = self.say("both_in_same_box", things=things, same=same)
        tests = " and ".join(quantity.test(noun.in_box(BOX)) for quantity, noun in counts)
        return TrainingPair(text, SOME.test(boxes_where(tests)))
