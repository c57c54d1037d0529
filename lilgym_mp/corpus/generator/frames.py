"""Whole statements with their programs: what people say of three boxes, whatever lies in them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from lilgym_mp.corpus.generator.meanings import NONE, SOME, Quantity
from lilgym_mp.corpus.generator.phrases import pluralised
from lilgym_mp.corpus.generator.speech import (
    ALL_ITEMS,
    ANYTHING,
    COLOURS,
    Look,
    Noun,
    Phrase,
    Speech,
    Test,
    Trait,
    exactly,
    filtered,
    items,
    numbered,
)

BOX = "b"
TRIES = 12  # to find conditions that go together
PLACES = (("left", "first", "left most"), ("middle", "second", "center"), ("right", "third", "last"))
ATTRIBUTES = ("color", "shape", "size")
ORDERS = {"more": ">", "fewer": "<", "equal": "=="}
TWO_COLOURS = (("yellow", "black"), ("yellow", "blue"), ("black", "blue"))


class Said(NamedTuple):
    """A statement in lower case and its program."""

    text: str
    program: str


@dataclass(frozen=True, slots=True)
class Condition:
    """What a box may be asked for. At least `has` or `verbs` is there."""

    test: Test  # of a variable that names a box
    has: str | None = None  # after "has" or "with"
    after: str | None = None  # right after the noun: "of three blocks"
    verbs: tuple[str, str] | None = None  # third person singular and plural
    lacks: bool = False  # comes last, after "but"
    kind: str = "has"
    look: Look | None = None  # of the items that are counted
    least: int = 0  # items that the box needs for it
    most: int | None = None  # items that it allows


Family = tuple[float, Callable[[], Said]]


def in_box(box: str) -> str:
    return f"{box}.all_items_in_box()"


class Frames(Speech):
    """What both appearances share. `families` lists the kinds of statements with their weights."""

    most_in_box = 6  # items that statements ask of one box

    def said(self) -> Said:
        """A statement of a random kind."""
        families = self.families()
        (make,) = self.rng.choices([make for _, make in families], [weight for weight, _ in families])
        return make()

    def families(self) -> Sequence[Family]:
        raise NotImplementedError

    def look(self) -> Look:
        raise NotImplementedError

    def trait(self) -> Trait:
        raise NotImplementedError

    def condition(self) -> Condition:
        raise NotImplementedError

    def colour(self) -> tuple[str, ...]:
        return (self.one(COLOURS),)

    def two_looks(self) -> tuple[Look, Look]:
        """Two looks of which no item has both."""
        while True:
            one, other = self.look(), self.look()
            if _apart(one, other):
                return one, other

    # Items of the picture

    def existential(self, phrase: Phrase) -> str:
        """There being so many of something, in one of many ways."""
        text, plural = phrase
        draw = self.rng.random()
        if draw < 0.72:
            there = "there are" if plural else "there is"
            if self.voice.sloppy and self.chance(0.3):
                there = self.pick("there is", "there is", "there", "there are", "there have", "there exists")
            elif self.chance(0.06):
                there = self.pick("there's", "there exists", "there can be seen", "here is") if not plural else there
            return f"{there} {text}"
        if draw < 0.84:
            return text
        if draw < 0.92:
            be = self.be(plural)
            return self.pick(
                f"{text} {be} present", f"{text} can be seen", f"{text} {be} in the {self.voice.picture}",
                f"{text} {be} shown", f"{text} {self.verb('exists', plural)}",
            )  # fmt: skip
        subject = self.pick("we can see", "i see", "you can see", f"the {self.voice.picture} has",
                            f"the {self.voice.picture} contains", f"the {self.voice.picture} shows", "we have",
                            f"in the {self.voice.picture} there {self.be(plural)}")  # fmt: skip
        return f"{subject} {text}"

    def somewhere(self) -> str:
        """Words that add nothing: wherever in the picture."""
        if self.chance(0.88):
            return ""
        boxes = pluralised(self.voice.box)
        return self.pick(" in total", " in all", " altogether", f" in the {self.voice.picture}", f" in the {boxes}",
                         f" in the three {boxes}", " overall", " total")  # fmt: skip

    def counted(self) -> Said:
        noun = Noun(self.look())
        quantity = self.quantity(7)
        return Said(
            self.existential(self.quantified(quantity, noun)) + self.somewhere(), numbered(quantity, items(noun))
        )

    def total(self) -> Said:
        number = self.pick(2, 3, 4, 5, 5, 6, 6, 7, 7, 8, 8, 9, 10)
        quantity = self.pick(exactly(number), exactly(number), Quantity(number, None), Quantity(0, number))
        return Said(
            self.existential(self.quantified(quantity, ANYTHING)) + self.somewhere(),
            numbered(quantity, ALL_ITEMS),
        )

    def number_told(self) -> Said:
        """ "the number of blue blocks is three" """
        noun, number = Noun(self.look()), self.pick(1, 2, 2, 3, 3, 4, 5, 6)
        adverb, quantity = self.pick(
            ("", exactly(number)), ("exactly ", exactly(number)), ("at least ", Quantity(number, None)),
            ("at most ", Quantity(0, number)), ("more than ", Quantity(number + 1, None)),
            ("less than ", Quantity(0, number - 1)),
        )  # fmt: skip
        total = self.pick("the number of", "the total number of", "number of", "the count of", "total number of")
        text = f"{total} {self.noun(noun, plural=True)} is {adverb}{self.number(number)}"
        return Said(text, numbered(quantity, items(noun)))

    def with_trait(self) -> Said:
        """Items with one or two traits."""
        noun = self.traited()
        return self.saying(self.quantity(4, none=0.06), noun)

    def traited(self) -> Noun:
        noun = Noun(self.look(), (self.trait(),))
        if self.chance(0.12):
            second = self.trait()
            if second.kind != noun.traits[0].kind:
                noun = noun.also(second)
        return noun

    def saying(self, quantity: Quantity, noun: Noun) -> Said:
        """So many items with traits: existence, subject first, or "one of the ..."."""
        program = numbered(quantity, items(noun))
        draw = self.rng.random()
        *rest, last = noun.traits
        subject_noun = Noun(noun.look, tuple(rest))
        if draw < 0.62:
            return Said(self.existential(self.quantified(quantity, noun)), program)
        if quantity == NONE and draw < 0.85:
            none = self.pick("none of the", "none of the", "not one of the", "no one of the", "neither of the")
            text = f"{none} {self.noun(subject_noun, plural=True)} {self.predicate(last, plural=self.chance(0.4))}"
            return Said(text, program)
        if draw < 0.74 and quantity.low == 1 and quantity.high in (1, None):
            one = self.of_the(quantity)
            text = f"{one} {self.noun(subject_noun, plural=True)} {self.predicate(last, plural=False)}"
            return Said(text, program)
        if draw < 0.82 and quantity.low > 1 and not quantity.soft:
            words = self.determiner(quantity)
            if not words.text.endswith((" of", "total")):
                of_the = f"{words.text} of the {self.noun(subject_noun, plural=True)}"
                return Said(f"{of_the} {self.predicate(last, words.plural)}", program)
        subject = self.quantified(quantity, subject_noun)
        there = self.existential(subject) if self.chance(0.3) else subject.text
        text = f"{subject.text} {self.predicate(last, subject.plural)}"
        if there != subject.text and last.holds:
            text = f"{there} {self.modifier(last, subject.plural)}"
        return Said(text, program)

    def of_the(self, quantity: Quantity) -> str:
        if quantity == exactly(1):
            return self.pick("exactly one of the", "only one of the", "just one of the", "exactly 1 of the")
        return self.pick("one of the", "one of the", "at least one of the", "at least 1 of the", "some of the")

    def definite(self) -> Said:
        """ "the black triangle is touching a wall": taken as one being there that does."""
        noun = self.traited()
        *rest, last = noun.traits
        named = Noun(noun.look, tuple(rest))
        the = self.pick("the", "the", "the", "", "a")
        if the == "a":
            text = f"{self.some(named)} {self.predicate(last, plural=False)}"
        else:
            text = f"{the} {self.noun(named, plural=False)} {self.predicate(last, plural=False)}".strip()
        return Said(text, numbered(SOME, items(noun)))

    def the_only(self) -> Said:
        """There being just one, and it has a trait."""
        noun, trait = Noun(self.look()), self.trait()
        all_of_them = items(noun)
        program = f"count({all_of_them}) == 1 and exist({items(noun.also(trait))})"
        one = self.quantified(exactly(1), noun).text
        predicate = self.predicate(trait, plural=False)
        text = self.pick(
            f"the only {self.noun(noun, plural=False)} {predicate}",
            f"there is {one} and it {predicate}",
            f"there is {one} and that {predicate}",
            f"there is {one}, and it {predicate}",
            f"there is {one} and this {self.voice.item} {predicate}",
        )
        return Said(text, program)

    def shared(self) -> Said:
        """So many items, of which so many have a trait."""
        noun, trait = Noun(self.look()), self.trait()
        total = self.pick(2, 2, 3, 3, 4)
        part = self.pick("all", "none", *(exactly(n) for n in range(1, total)))
        number = f"count({items(noun)}) == {total}"
        named = self.quantified(exactly(total), noun).text
        joint = self.pick(" and", ",", ", and", " of which", " out of which")
        of_them = "" if "which" in joint else " of them"
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
        having = numbered(quantity, items(noun.also(trait)))
        text = f"there {self.be(True)} {named}{joint} {subject} {self.predicate(trait, plural)}"
        return Said(text, f"{number} and {having}")

    def every(self) -> Said:
        """All such items have the trait, and there are some."""
        noun, trait = Noun(self.look()), self.trait()
        if self.chance(0.2):
            noun, trait = self.traited(), self.look_trait(Look(self.colour()))
            noun = Noun(Look(shape=noun.look.shape, size=noun.look.size), noun.traits)
        program = f"All({items(noun)}, lambda x: {trait.tested('x')})"
        several, single = self.noun(noun, plural=True), self.noun(noun, plural=False)
        text = self.pick(
            f"all {several} {self.predicate(trait, plural=True)}",
            f"all the {several} {self.predicate(trait, plural=True)}",
            f"all of the {several} {self.predicate(trait, plural=True)}",
            f"every {single} {self.predicate(trait, plural=False)}",
            f"each {single} {self.predicate(trait, plural=False)}",
            f"each of the {several} {self.predicate(trait, plural=False)}",
            f"the {several} {self.predicate(trait, plural=True)}",
            f"the {several} {self.be(True)} all {trait.told or trait.core}" if trait.holds else
            f"the {several} {self.predicate(trait, plural=True)}",
        )  # fmt: skip
        return Said(text, program)

    def not_every(self) -> Said:
        noun, trait = Noun(self.look()), self.trait()
        if not trait.holds:
            trait = replace(trait, holds=True)
        program = f"exist({items(noun.also(replace(trait, holds=False)))})"
        several, single = self.noun(noun, plural=True), self.noun(noun, plural=False)
        text = self.pick(
            f"not all {several} {self.predicate(trait, plural=True)}",
            f"not all the {several} {self.predicate(trait, plural=True)}",
            f"not all of the {several} {self.predicate(trait, plural=True)}",
            f"not every {single} {self.predicate(trait, plural=False)}",
            f"at least one {single} {self.predicate(replace(trait, holds=False), plural=False)}",
        )
        return Said(text, program)

    def only_those(self) -> Said:
        """ "only blue circles are touching a wall": something does, and all that do are such."""
        look, trait = self.look(), replace(self.trait(), holds=True)
        predicate = self.predicate(trait, plural=True)
        all_look = self.look_trait(look)
        program = f"All({items(Noun(traits=(trait,)))}, lambda x: {all_look.tested('x')})"
        several = self.plain_noun(look, plural=True)
        text = self.pick(
            f"only {several} {predicate}",
            f"only the {several} {predicate}",
            f"every {self.voice.item} {self.modifier(trait, False)} is {all_look.core}",
            f"all {pluralised(self.voice.item)} {self.modifier(trait, True)} are "
            f"{several if look.shape else all_look.core}",
            f"no {self.voice.item} other than {several} {self.predicate(trait, False)}",
        )
        return Said(text, program)

    def same_all(self) -> Said:
        """All such items share an attribute, or do not."""
        attribute = self.attribute()
        noun = Noun(self.look_free_of(attribute))
        if self.chance(0.3):
            noun = noun.also(replace(self.trait(), holds=True))
        several = self.noun(noun, plural=True)
        program = f"all_same_{attribute}({items(noun)})"
        if self.chance(0.3):
            text = self.pick(
                f"not all {several} {self.have_same(attribute)}",
                f"not all of the {several} {self.have_same(attribute)}",
                f"there are {several} of different {attribute}s",
                f"the {several} have different {attribute}s",
                f"the {several} {self.pick('are not', 'do not have')} the same {attribute}".replace(
                    "are not the same", "are not of the same"
                ),
            )
            values = f"get_set_{attribute}s({items(noun)})"
            return Said(text, f"ge(count({values}), 2)")
        text = self.pick(
            f"all {several} {self.have_same(attribute)}",
            f"all the {several} {self.have_same(attribute)}",
            f"all of the {several} {self.have_same(attribute)}",
            f"the {several} {self.have_same(attribute)}",
            f"the {several} all {self.have_same(attribute)}",
            f"every {self.noun(noun, plural=False)} has the same {attribute}",
        )
        return Said(text, program)

    def have_same(self, attribute: str) -> str:
        return self.pick(
            f"have the same {attribute}", f"are the same {attribute}", f"are of the same {attribute}",
            f"are of same {attribute}", f"share the same {attribute}", f"have same {attribute}",
            f"are in the same {attribute}" if attribute == "color" else f"are of one {attribute}",
            f"have only one {attribute}",
        )  # fmt: skip

    def attribute(self) -> str:
        raise NotImplementedError

    def look_free_of(self, attribute: str) -> Look:
        """A look that leaves the attribute open."""
        raise NotImplementedError

    def variety(self) -> Said:
        """How many colours, shapes or sizes the picture has."""
        attribute = self.attribute()
        number = self.pick(1, 2, 2, 3, 3)
        values = f"get_set_{attribute}s({ALL_ITEMS})"
        words = self.variety_words(attribute, number)
        several = pluralised(self.voice.item)
        there = self.pick(f"there are {several}", several, f"the {self.voice.picture} has {several}",
                          f"the {pluralised(self.voice.box)} have {several}", f"there is {several}")  # fmt: skip
        text = self.pick(f"{there} {self.pick('of', 'of', 'with', 'in')} {words}",
                         f"there {self.be(number > 1)} {words} in the {self.voice.picture}")  # fmt: skip
        return Said(text, f"count({values}) == {number}")

    def variety_words(self, attribute: str, number: int) -> str:
        name = f"{attribute}s"
        if number == 1:
            return self.pick(f"only one {attribute}", f"a single {attribute}", f"the same {attribute}",
                             f"only 1 {attribute}", f"one {attribute}", f"just one {attribute}")  # fmt: skip
        word = self.number(number)
        if number == 3:
            return self.pick(
                f"all three {name}", f"all 3 {name}", f"three different {name}", f"all the {name}", f"all {name}",
                f"all the three {name}", f"{word} {name}", f"all the different {name}", f"every {attribute}",
                f"all different {name}", f"each {attribute}", f"three {name}", f"all 3 different {name}",
            )  # fmt: skip
        return self.pick(
            f"{word} different {name}", f"exactly {word} {name}", f"only {word} {name}", f"{word} {name}",
            f"only {word} different {name}", f"exactly {word} different {name}",
        )  # fmt: skip

    def compared(self) -> Said:
        """More of these than of those."""
        one, other = self.two_looks()
        first, second = Noun(one), Noun(other)
        order, margin = self.pick("more", "more", "fewer", "equal"), None
        if order == "more" and self.chance(0.15):
            margin = self.pick(1, 1, 2, 3)
        words = self.comparison(first, second, order, margin)
        text = self.pick(
            f"there are {words}", f"there are {words}", f"the {self.voice.picture} has {words}", f"there is {words}",
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
        return Said(text, self.comparison_test(first, second, order, margin, ALL_ITEMS))

    def comparison(self, one: Noun, other: Noun, order: str, margin: int | None) -> str:
        first, second = self.noun(one, plural=True), self.noun(other, plural=True)
        same_shape = one.look.shape == other.look.shape and not one.traits and not other.traits
        if same_shape and other.look.colours and not other.look.size and self.chance(0.5):
            second = self.pick(f"{self.colours(other.look.colours)} ones", self.colours(other.look.colours))
        if order == "equal":
            return self.pick(
                f"as many {first} as {second}", f"the same number of {first} and {second}",
                f"the same number of {first} as {second}", f"an equal number of {first} and {second}",
                f"same number of {first} and {second}", f"equal number of {first} and {second}",
                f"equal numbers of {first} and {second}", f"the same amount of {first} and {second}",
            )  # fmt: skip
        if margin is not None:
            return f"{self.pick('', 'exactly ')}{self.number(margin)} more {first} than {second}"
        word = "more" if order == "more" else self.pick("fewer", "less")
        return f"{word} {first} than {second}"

    def comparison_test(self, one: Noun, other: Noun, order: str, margin: int | None, source: str) -> str:
        first, second = f"count({items(one, source)})", f"count({items(other, source)})"
        if margin is not None:
            return f"{first} == {second} + {margin}"
        return f"{first} {ORDERS[order]} {second}"

    def joined(self) -> Said:
        """Two statements in one."""
        one, other = self.short(), self.short()
        words, operator = self.pick(
            (" and ", "and"), (", and ", "and"), (" and ", "and"), (", but ", "and"), (" or ", "or"),
            (", while ", "and"), (". also ", "and"),
        )  # fmt: skip
        second = other.text
        if one.text.startswith("there ") and second.startswith(("there is ", "there are ")) and self.chance(0.5):
            second = second.split(" ", 2)[2]
        either = "either " if operator == "or" and self.chance(0.3) else ""
        return Said(either + one.text + words + second, f"({one.program}) {operator} ({other.program})")

    def short(self) -> Said:
        return self.pick(self.counted, self.with_trait, self.boxes_with)()

    def two_counted(self) -> Said:
        """ "there are two circles and one black square" """
        one, other = self.two_looks()
        first, second = self.quantity(4, none=0), self.quantity(4, none=0.2)
        nouns = Noun(one), Noun(other)
        opening = self.existential(self.quantified(first, nouns[0]))
        joint = "but" if second == NONE and self.chance(0.6) else self.pick("and", "and", "and", ", and", "as well as")
        text = f"{opening} {joint} {self.quantified(second, nouns[1]).text}".replace(" ,", ",")
        return Said(text, f"({numbered(first, items(nouns[0]))}) and ({numbered(second, items(nouns[1]))})")

    # Boxes

    def box_word(self) -> str:
        raise NotImplementedError

    def conditions(self, number: int) -> list[Condition]:
        """Different conditions, what is lacking last; seldom fewer, where no more go together."""
        found: list[Condition] = []
        for _ in range(TRIES):
            if len(found) == number:
                break
            condition = self.condition()
            if not any(_clash(condition, other) for other in found):
                found.append(condition)
        return sorted(found, key=lambda condition: (condition.lacks, condition.after is None))

    def two_conditions(self) -> tuple[Condition, Condition]:
        while len(found := self.conditions(2)) < 2:
            pass
        return found[0], found[1]

    def box_quantity(self) -> Quantity:
        draw = self.rng.random()
        if draw < 0.62:
            return SOME
        if draw < 0.76:
            return exactly(1)
        if draw < 0.87:
            return exactly(2)
        if draw < 0.91:
            return Quantity(2, None)
        if draw < 0.95:
            return exactly(3)
        return NONE

    def boxes_with(self) -> Said:
        """So many boxes with one to three conditions."""
        conditions = self.conditions(self.rng.choices((1, 2, 3), (62, 33, 5))[0])
        quantity = self.box_quantity()
        if quantity == NONE and (len(conditions) > 1 or conditions[0].lacks or conditions[0].least == 0):
            quantity = SOME
        word = self.box_word()
        tests = self.box_tests(word, conditions)
        boxes = f"filter_obj(all_boxes, lambda {BOX}: {tests})"
        if quantity == exactly(3):
            return Said(self.each_box(word, conditions), f"All(all_boxes, lambda {BOX}: {tests})")
        return Said(self.box_text(quantity, word, conditions), numbered(quantity, boxes))

    def box_tests(self, word: str, conditions: Sequence[Condition]) -> str:
        tests = [condition.test(BOX) for condition in conditions]
        return " and ".join([f"{BOX}.is_tower()", *tests] if word == self.voice.tower else tests)

    def box_text(self, quantity: Quantity, word: str, conditions: Sequence[Condition]) -> str:
        draw = self.rng.random()
        several = pluralised(word)
        if quantity == NONE and draw < 0.4:
            none = self.pick("none of the", "no one of the", "not one of the")
            return f"{none} {several} {self.having(conditions, plural=self.chance(0.5))}"
        if quantity.low >= 1 and draw < 0.22:
            if quantity == SOME:
                of_the = self.pick("one of the", "one of the", "at least one of the", "in one of the",
                    "one of the three",
                                   "one out of three", "one of")  # fmt: skip
            else:
                words = self.determiner(quantity)
                of_the = f"{words.text} of the" if not words.text.endswith(" of") else "two of the"
            if of_the.startswith("in "):
                has = [condition.has for condition in conditions]
                if None in has or any(condition.lacks for condition in conditions):
                    of_the = "one of the"
                else:
                    return f"in one of the {several} there is {self.strung([text for text in has if text], ())}"
            return f"{of_the} {several} {self.having(conditions, quantity.low > 1)}"
        words = self.determiner(quantity)
        plural = words.plural
        noun = pluralised(word) if plural else word
        text = f"{words.text} {noun}" if words.text != "a" else self.a(noun)
        if draw < 0.82:
            return self.existential(Phrase(f"{text} {self.described(conditions, plural)}", plural))
        return f"{text} {self.having(conditions, plural)}"

    def each_box(self, word: str, conditions: Sequence[Condition]) -> str:
        several = pluralised(word)
        only = conditions[0].has if len(conditions) == 1 and conditions[0].kind == "has" else None
        if only is not None and only.startswith(("a ", "an ")) and self.chance(0.12):
            return f"there {self.pick(f'is no {word}', f'are no {several}')} without {only}"
        subject, plural = self.pick(
            (f"each {word}", False), (f"every {word}", False), (f"all {several}", True), (f"all the {several}", True),
            (f"all three {several}", True), (f"all the three {several}", True), (f"each of the {several}", False),
            (f"all of the {several}", True), (f"the three {several}", True), (f"all 3 {several}", True),
        )  # fmt: skip
        return f"{subject} {self.having(conditions, plural)}"

    def having(self, conditions: Sequence[Condition], plural: bool) -> str:
        """Conditions as a verb phrase: "has two circles but no triangle"."""
        verb = self.pick("has", "has", "has", "contains", "contains", "includes", "holds")
        parts: list[str] = []
        last_has = False
        for condition in conditions:
            if condition.has is None or (condition.verbs is not None and self.chance(0.4)):
                assert condition.verbs is not None
                parts.append(condition.verbs[plural])
                last_has = False
            else:
                parts.append(condition.has if last_has else f"{self.verb(verb, plural)} {condition.has}")
                last_has = True
        return self.strung(parts, conditions)

    def described(self, conditions: Sequence[Condition], plural: bool) -> str:
        """Conditions after the noun: "with two circles", "that has only blue blocks"."""
        first, *others = conditions
        if first.after is not None and (first.has is None or self.chance(0.5)):
            rest = [condition for condition in others if condition.has is not None]
            if len(rest) == len(others):
                tail = self.strung([text for condition in others if (text := condition.has)], others)
                return f"{first.after} {self.pick('with', 'with', 'and', 'that has')} {tail}" if tail else first.after
        if any(condition.has is None for condition in conditions) or self.chance(0.25):
            which = self.pick("that", "that", "which", "which")
            return f"{which} {self.having(conditions, plural)}"
        opening = self.pick("with", "with", "with", "with", "with", "with", "containing", "having", "that contains",
                            "consisting of", "in which there is", "where there is")  # fmt: skip
        if opening == "that contains":
            opening = f"that {self.verb('contains', plural)}"
        if opening in ("consisting of", "in which there is", "where there is") and any(c.lacks for c in conditions):
            opening = "with"
        return f"{opening} {self.strung([condition.has for condition in conditions if condition.has], conditions)}"

    def strung(self, parts: Sequence[str], conditions: Sequence[Condition]) -> str:
        """Parts joined by "and", "but", commas."""
        text = parts[0] if parts else ""
        for place, part in enumerate(parts[1:], start=1):
            lacking = place < len(conditions) and conditions[place].lacks
            if lacking:
                joint = self.pick(" but ", " and ", ", but ")
            elif place < len(parts) - 1:
                joint = self.pick(", ", " and ")
            else:
                joint = self.pick(" and ", " and ", " and ", ", and ", " and also ", " as well as ")
            text += joint + part
        return text

    def named_box(self) -> Said:
        """What the left, middle or right box has."""
        index = int(self.rng.random() * 3)
        word = self.box_word()
        conditions = self.conditions(self.pick(1, 1, 2))
        tests = [condition.test(f"all_boxes[{index}]") for condition in conditions]
        if word == self.voice.tower:
            tests = [f"all_boxes[{index}].is_tower()", *tests]
        place = self.one(PLACES[index])
        name = f"the {place} {word}" if place != "center" or self.chance(0.5) else f"the {word} in the {place}"
        if place in ("left", "right", "middle") and self.chance(0.15):
            name = f"the {word} {'in' if place == 'middle' else 'on'} the {place}"
        has = conditions[0].has
        if len(conditions) == 1 and has and self.chance(0.25):
            text = self.pick(f"there is {has} in {name}", f"in {name} there is {has}", f"in {name}, there is {has}")
        else:
            text = f"{name} {self.having(conditions, plural=False)}"
        return Said(text, " and ".join(tests))

    def conditional_boxes(self) -> Said:
        """ "every box with a circle has a square too" """
        one, other = self.two_conditions()
        word = self.box_word()
        if one.has is None or one.lacks or other.lacks:
            return self.boxes_with()
        test = one.test(BOX) if word != self.voice.tower else f"{BOX}.is_tower() and {one.test(BOX)}"
        program = f"All(filter_obj(all_boxes, lambda {BOX}: {test}), lambda {BOX}: {other.test(BOX)})"
        several = pluralised(word)
        also = self.pick("", "", " too", " as well")
        text = self.pick(
            f"every {word} with {one.has} {self.having([other], False)}{also}",
            f"each {word} with {one.has} {self.having([other], False)}{also}",
            f"all {several} with {one.has} {self.having([other], True)}{also}",
            f"all the {several} with {one.has} {self.having([other], True)}",
        )
        return Said(text, program)

    def box_with_definite(self) -> Said:
        """ "the box with a circle has a square": taken as there being such a box."""
        one, other = self.two_conditions()
        word = self.box_word()
        if one.has is None:
            one, other = other, one
        if one.has is None:
            return self.boxes_with()
        tests = self.box_tests(word, [one, other])
        the = self.pick("the", "the", "the", f"one of the {pluralised(word)}", "a")
        subject = the if the.startswith("one") else f"{the} {word}"
        text = f"{subject} with {one.has} {self.having([other], plural=False)}"
        return Said(text, numbered(SOME, f"filter_obj(all_boxes, lambda {BOX}: {tests})"))

    # Conditions that both appearances have

    def has_some(self, look: Look | None = None) -> Condition:
        noun, quantity = Noun(look or self.look()), self.few()
        return self.has_condition(quantity, noun)

    def has_condition(self, quantity: Quantity, noun: Noun) -> Condition:
        text = self.quantified(quantity, noun).text
        kind = "traited" if noun.traits else "has"
        return Condition(
            lambda box: numbered(quantity, items(noun, in_box(box))),
            text,
            kind=kind,
            look=noun.look,
            least=quantity.low,
        )

    def has_none(self) -> Condition:
        noun = Noun(self.look())
        text = self.noun(noun, plural=self.chance(0.5))
        does = (f"does not {self.pick('have', 'contain')}", f"do not {self.pick('have', 'contain')}")
        anything = self.pick("any ", "any ", "") + self.noun(noun, plural=True)
        without = f"without {self.pick('any ' + text, self.a(self.noun(noun, False)), self.noun(noun, True))}"
        verbs = (f"{does[0]} {anything}", f"{does[1]} {anything}")
        return Condition(
            lambda box: numbered(NONE, items(noun, in_box(box))),
            f"no {text}",
            without,
            verbs,
            lacks=True,
            look=noun.look,
        )

    def has_traited(self) -> Condition:
        trait = self.trait()
        while trait.kind == "box":
            trait = self.trait()
        return self.has_condition(self.few(3), Noun(self.look(), (trait,)))

    def purely(self) -> Condition:
        look = self.look()
        trait = self.look_trait(look)
        several = self.plain_noun(look, plural=True)
        has = self.pick(f"only {several}", f"only {several}", f"nothing but {several}", f"only {several} in it")
        after = None
        verbs = None
        if look.shape is None and look.size is None:
            all_items = f"all {pluralised(self.voice.item)} {trait.core}"
            has = self.pick(
                has, f"only {trait.core} {pluralised(self.voice.item)}", all_items, f"only {trait.core} color"
            )
            after = self.pick(None, f"made up of only {several}",
                f"where all {pluralised(self.voice.item)} are {trait.core}",
                              f"that is all {trait.core}", f"consisting of only {several}")  # fmt: skip
            verbs = self.pick(None, (f"is made of only {several}", f"are made of only {several}"))
        return Condition(
            lambda box: f"All({in_box(box)}, lambda x: {trait.tested('x')})", has, after, verbs, kind="purely"
        )

    def varied(self) -> Condition:
        attribute, number = self.attribute(), self.pick(1, 2, 2, 3, 3)
        words = self.variety_words(attribute, number)
        several = pluralised(self.voice.item)
        has = f"{several} {self.pick('of', 'of', 'in', 'with')} {words}"
        if number > 1 and self.chance(0.4):
            has = words
        if number == 1 and self.chance(0.4):
            has = self.pick(f"all {several} of the same {attribute}", f"all {several} in the same {attribute}",
                            f"only one {attribute}", f"{several} of same {attribute}")  # fmt: skip
        return Condition(
            lambda box: f"count(get_set_{attribute}s({in_box(box)})) == {number}", has, kind="varied", least=number
        )

    def has_compared(self) -> Condition:
        one, other = self.two_looks()
        order = self.pick("more", "more", "fewer", "equal")
        words = self.comparison(Noun(one), Noun(other), order, None)
        return Condition(lambda box: self.comparison_test(Noun(one), Noun(other), order, None, in_box(box)), words,
                         kind="compared")  # fmt: skip

    def has_total_of_which(self) -> Condition:
        """ "four items of which two are blue" """
        look = self.look()
        total = self.pick(2, 3, 3, 4, 4, self.most_in_box)
        part = 1 + int(self.rng.random() * (total - 1))
        trait = self.look_trait(look)
        named = self.quantified(exactly(total), ANYTHING).text
        which = self.pick("of which", "of which", "out of which", "where", "and", "in which")
        exact = self.pick("", "", "exactly ", "only ")
        core = self.plain_noun(look, part > 1) if look.shape else trait.core
        if look.shape and part == 1:
            core = self.a(core)
        text = f"{named} {which} {exact}{self.number(part)} {self.be(part > 1)} {core}"
        noun = Noun(look)
        return Condition(
            lambda box: f"count({in_box(box)}) == {total} and count({items(noun, in_box(box))}) == {part}",
            text, kind="total", least=total, most=total,
        )  # fmt: skip

    def all_of_box(self) -> Condition:
        """ "all circles touching a wall" """
        noun, trait = Noun(self.look()), self.trait()
        while trait.kind == "box":
            trait = self.trait()
        several = self.noun(noun, plural=True)
        has = self.pick(f"all {several} {self.negated(trait)}", f"all the {several} {self.negated(trait)}",
                        f"all its {several} {self.negated(trait)}")  # fmt: skip
        return Condition(lambda box: f"All({items(noun, in_box(box))}, lambda x: {trait.tested('x')})", has, kind="all")

    def only_item(self) -> Condition:
        """ "only one item, which is blue" """
        look = self.look()
        trait = self.look_trait(look)
        one = self.quantified(exactly(1), ANYTHING).text
        text = self.pick(f"{one} which is {trait.core}", f"{one} and it is {trait.core}",
            f"{one}, which is {trait.core}",
                         f"{one} that is {trait.core}", f"{one} and it's {trait.core}")  # fmt: skip
        return Condition(
            lambda box: f"count({in_box(box)}) == 1 and exist({items(Noun(look), in_box(box))})",
            text, kind="total", least=1, most=1,
        )  # fmt: skip

    def total_in_box(self, most: int) -> Condition:
        number = 1 + int(self.rng.random() * most)
        quantity = self.pick(exactly(number), exactly(number), exactly(number), Quantity(number, None),
                             Quantity(0, number) if number > 1 else exactly(1))  # fmt: skip
        text = self.quantified(quantity, ANYTHING).text
        after = self.pick(None, f"of {text}", f"made of {text}", f"consisting of {text}")
        return Condition(lambda box: numbered(quantity, in_box(box)), text, after, kind="total",
                         least=quantity.low, most=quantity.high)  # fmt: skip

    def two_alike(self) -> Condition:
        """ "two circles of the same color" """
        attribute = self.attribute()
        noun, number = Noun(self.look_free_of(attribute)), self.pick(2, 2, 2, 3)
        text = (
            f"{self.pick('', '', 'at least ')}{self.number(number)} {self.noun(noun, True)} "
            f"{self.pick('of the same', 'of the same', 'of same', 'with the same', 'in the same')} {attribute}"
        )
        return Condition(
            lambda box: (
                f"exist(filter_obj(combinations({items(noun, in_box(box))}, {number}), "
                f"lambda p: all_same_{attribute}(p)))"
            ),
            text, kind="alike", least=number,
        )  # fmt: skip


def _apart(one: Look, other: Look) -> bool:
    """Whether the looks differ in just what both say, so that comparing them makes sense."""
    if one == other:
        return False
    colours = one.colours and other.colours and not set(one.colours) & set(other.colours)
    shapes = one.shape and other.shape and one.shape != other.shape
    sizes = one.size and other.size and one.size != other.size
    return bool(colours or shapes or sizes)


ALONE = frozenset({"purely", "compared", "varied", "alike"})  # go with numbers of anything only
PLACES_OF_BLOCKS = frozenset({"top", "bottom", "second", "third", "middle", "ends", "same ends", "alternating"})
COLOUR_KINDS = PLACES_OF_BLOCKS | ALONE | {"has", "traited"}


def _clash(one: Condition, other: Condition) -> bool:
    """Whether the two contradict each other, say the same twice, or read oddly side by side."""
    kinds = {one.kind, other.kind}
    if len(kinds) == 1 and one.kind not in ("has", "traited"):
        return True
    if kinds & ALONE and kinds <= COLOUR_KINDS:
        return "purely" in kinds or "compared" in kinds or len(kinds & ALONE) > 1
    if ("ends" in kinds and kinds & {"top", "bottom", "same ends", "middle"}) or {"same ends", "top"} == kinds:
        return True
    if one.look is not None and one.look == other.look:
        return True
    if one.lacks and other.lacks:
        return True
    return any(_crowded(a, b) for a, b in ((one, other), (other, one)))


def _crowded(one: Condition, other: Condition) -> bool:
    """Whether `one` allows too few items for `other`, or just so many that it says too much."""
    if one.most is None:
        return False
    return other.least > one.most or (other.least == one.most and other.kind not in PLACES_OF_BLOCKS)


__all__ = ["ANYTHING", "BOX", "Condition", "Family", "Frames", "Said", "filtered", "in_box"]
