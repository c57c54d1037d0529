"""Synchronous templates for phrases: each part has its words and its program text.

They imitate how many people write about pictures. The words may be chosen freely because every part carries its own
program text.
"""

from __future__ import annotations

import random
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

from lilgym_mp.corpus.generator.lexicon import NUMBER_WORDS, Phrase, Style, article, conjugated, pluralised
from lilgym_mp.corpus.generator.program_text import ALL_ITEMS, items_in_box
from lilgym_mp.corpus.generator.quantities import NONE, SOME, Quantity, at_least, at_most, exactly

HOLE = "@"  # in the program text of a test: the item or box to test; "@@" is the variable of a lambda inside
VARIABLES = "xyzuvw"  # names of lambda parameters, by nesting depth
Option = TypeVar("Option")

COLOURS = ("yellow", "black", "blue")
SHAPES = ("circle", "square", "triangle")
SIZES = {
    "small": ("small", "small", "small", "tiny", "little", "small sized"),
    "medium": ("medium", "medium", "medium sized", "medium-sized", "mid-sized"),
    "big": ("big", "big", "large", "large", "big sized"),
}


class TrainingPair(NamedTuple):
    """A statement and the program that decides its truth."""

    statement: str
    program: str


@dataclass(frozen=True, slots=True)
class AttributeWords:
    """The attribute words of a noun phrase; several colours are alternatives."""

    colours: tuple[str, ...] = ()
    shape: str | None = None
    size: str | None = None

    def tests(self) -> tuple[str, ...]:
        colours = [f"is_{colour}({HOLE})" for colour in COLOURS if colour in self.colours]
        either = f"({' or '.join(colours)})" if len(colours) > 1 else "".join(colours)
        return tuple(filter(None, (either, *(f"is_{name}({HOLE})" for name in (self.size, self.shape) if name))))


@dataclass(frozen=True, slots=True)
class PredicateTemplate:
    """A predicate of items: its words and its test."""

    complement: str  # follows "is"
    program: str  # test of the positive predicate
    verb_forms: tuple[str, str] | None = None  # singular and plural: "touches a wall", "touch a wall"
    positive: bool = True
    negated_complement: str | None = None  # follows "not", where it differs
    follows_noun: bool = True  # whether the complement can follow the noun without "that is"
    kind: str = "attributes"  # a noun phrase has at most one predicate of each kind
    main_complement: str | None = None  # follows "is" in a main clause, where it differs

    def signed_test(self, variable: str = HOLE) -> str:
        return bound(self.program if self.positive else f"NOT({self.program})", variable)


@dataclass(frozen=True, slots=True)
class NounTemplate:
    """A noun phrase without determiner: attribute words and predicates."""

    attributes: AttributeWords = AttributeWords()
    predicates: tuple[PredicateTemplate, ...] = ()

    def tests(self) -> tuple[str, ...]:
        return (*self.attributes.tests(), *(predicate.signed_test() for predicate in self.predicates))

    def such_that(self, *predicates: PredicateTemplate) -> NounTemplate:
        return NounTemplate(self.attributes, (*self.predicates, *predicates))


ANYTHING = NounTemplate()


def bound(test: str, variable: str) -> str:
    """The program text of a test of this variable."""

    def name(holes: re.Match[str]) -> str:
        depth = len(holes[0]) - 1
        return variable + HOLE * depth if HOLE in variable else VARIABLES[VARIABLES.index(variable) + depth]

    return re.sub(f"{HOLE}+", name, test)


def filter_items(source: str, tests: Sequence[str], variable: str = "x") -> str:
    """Program text: the items of `source` that pass all tests."""
    if not tests:
        return source
    return f"filter_obj({source}, lambda {variable}: {' and '.join(bound(test, variable) for test in tests)})"


def item_set(noun: NounTemplate, source: str = ALL_ITEMS, variable: str = "x") -> str:
    """Program text: the items of `source` that the noun phrase denotes."""
    attributes = noun.attributes
    if not noun.predicates and attributes == AttributeWords(attributes.colours) and len(attributes.colours) == 1:
        return f"filter_color({source}, Color.{attributes.colours[0].upper()})"
    if not noun.predicates and attributes == AttributeWords(shape=attributes.shape) and attributes.shape is not None:
        return f"filter_shape({source}, Shape.{attributes.shape.upper()})"
    return filter_items(source, noun.tests(), variable)


def box_items(noun: NounTemplate, box: str = HOLE) -> str:
    """Program text: the items of the box that the noun phrase denotes."""
    return item_set(noun, items_in_box(box))


class PhraseTemplates:
    """Random phrases in the style of one writer."""

    style_words: Mapping[str, Sequence[str]]  # words to choose a style's from; repeated ones are more likely

    def __init__(self, rng: random.Random) -> None:
        self.rng = rng
        self.style = self.random_style()

    def random_style(self) -> Style:
        words = {name: self.rng.choice(choices) for name, choices in self.style_words.items()}
        picture = self.rng.choice(("picture", "image", "picture", "image"))
        digits, sloppy = self.chance(0.4), self.chance(0.2)
        return Style(**words, picture=picture, digits=digits, sloppy=sloppy, bare_number_is_bound=False)

    def pick(self, *options: Option) -> Option:
        return self.choice(options)

    def choice(self, options: Sequence[Option]) -> Option:
        return options[int(self.rng.random() * len(options))]

    def chance(self, probability: float) -> bool:
        return self.rng.random() < probability

    def drawn(self, *options: tuple[float, Option]) -> Option:
        """The first option whose bound is above a random number; the last bound is 1."""
        draw = self.rng.random()
        return next(option for bound, option in options if draw < bound)

    def be(self, plural: bool) -> str:
        if self.style.sloppy and self.chance(0.25):
            return "is"
        return "are" if plural else "is"

    def verb(self, verb: str, plural: bool) -> str:
        """The form of a verb given in the third person singular."""
        if self.style.sloppy and self.chance(0.2):
            return verb
        return conjugated(verb, plural)

    def number(self, value: int) -> str:
        return str(value) if self.style.digits or value >= len(NUMBER_WORDS) else NUMBER_WORDS[value]

    def a(self, text: str) -> str:
        return text if self.style.sloppy and self.chance(0.3) else article(text)

    # Quantities

    def quantity(self, max_count: int = 5, *, none: float = 0.05) -> Quantity:
        """Mostly existence and exact counts; zero with probability `none`."""
        if self.chance(none):
            return NONE
        number = min(max_count, self.pick(1, 1, 1, 1, 2, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 5, 6, 7))
        either, bounded = Quantity(number, number + 1), ((0.92, at_least(number)), (0.97, at_most(number)))
        found = self.drawn((0.38, SOME), (0.72, exactly(number)), *bounded, (0.985, None), (1, either))
        if found is None:
            return Quantity(self.pick(2, 3, 3, 4), None, vague=True) if max_count >= 4 else either
        return found

    def quantity_in_box(self, max_count: int = 4) -> Quantity:
        """A quantity of items in one box."""
        number = min(max_count, self.pick(1, 1, 1, 2, 2, 2, 2, 3, 3, 4))
        return self.drawn((0.35, SOME), (0.78, exactly(number)), (0.96, at_least(number)), (1, at_most(number)))

    def determiner(self, quantity: Quantity) -> Phrase:
        """The determiner for a quantity; "a" also where the noun needs "an"."""
        low, high, vague = quantity
        if vague:
            words = {
                2: ("multiple",),
                3: ("several", "several", "a few", "quite a few"),
                4: ("many", "a lot of", "lots of"),
            }[low]
            return Phrase(self.choice(words), plural=True)
        if quantity == NONE:
            return Phrase("no", plural=self.chance(0.5))
        if quantity == SOME:
            if self.style.bare_number_is_bound and self.chance(0.08):
                return Phrase(self.number(1), plural=False)
            if self.chance(0.75):
                return Phrase("a", plural=False)
            return Phrase(f"{self.at_least_words()} {self.number(1)}", plural=False)
        if high is None:
            if low == 1:
                return Phrase(f"{self.at_least_words()} {self.number(1)}", plural=False)
            return Phrase(self.lower_bound(low), plural=low != 2 or self.chance(0.95))
        if low == high:
            return Phrase(self.exact(low), plural=low > 1)
        if low == 0:
            number, next_number = self.number(high), self.number(high + 1)
            text = self.pick(
                "at most {0}", "at most {0}", "no more than {0}", "not more than {0}", "less than {1}",
                "fewer than {1}", "maximum {0}",
            )  # fmt: skip
            return Phrase(text.format(number, next_number), plural=high > 1 or "than" in text)
        return Phrase(f"{self.number(low)} or {self.number(high)}", plural=True)

    def at_least_words(self) -> str:
        return self.pick("at least", "at least", "at least", "at least", "atleast", "minimum", "not less than")

    def lower_bound(self, low: int) -> str:
        number, before = self.number(low), self.number(low - 1)
        if self.style.bare_number_is_bound and self.chance(0.5):
            return number
        draw = self.rng.random()
        if draw < 0.65:
            return f"{self.at_least_words()} {number}"
        if draw < 0.8:
            return f"more than {before}"
        if draw < 0.9:
            return f"{number} or more"
        if low == 2:
            return self.pick("multiple", "more than one")
        return f"{self.pick('no less than', 'no fewer than', 'a minimum of')} {number}"

    def exact(self, number: int) -> str:
        word = self.number(number)
        if text := self.drawn((0.45, word), (0.8, f"exactly {word}"), (0.9, f"only {word}"), (1, "")):
            return text
        if number == 1:
            return self.pick("a single", "only one", "just one", "only a single", "exactly one")
        if number == 2:
            return self.pick("a couple of", "a pair of", "only two", "just two", "exactly two")
        return f"{self.pick('just', 'precisely', 'a total of', 'exactly')} {word}"

    # Noun phrases

    def described_noun(self, attributes: AttributeWords, plural: bool) -> str:
        """Adjectives and noun, without an article."""
        noun = self.style.item if attributes.shape is None else attributes.shape
        if plural and not (self.style.sloppy and self.chance(0.1)):
            noun = pluralised(noun)
        size = [self.choice(SIZES[attributes.size])] if attributes.size is not None else []
        colours = [self.colours(attributes.colours)] if attributes.colours else []
        if size and colours and self.chance(0.15):
            size, colours = colours, size
        if colours and self.chance(0.02):
            colours = [f"{colours[0]} {self.pick('colored', 'coloured', 'color')}"]
        return " ".join([*size, *colours, noun])

    def colours(self, colours: Sequence[str], last: str = "or") -> str:
        return f" {last} ".join(colours)

    def noun(self, noun: NounTemplate, plural: bool) -> str:
        words = [self.described_noun(noun.attributes, plural)]
        for index, predicate in enumerate(noun.predicates):
            words.append(self.modifier(predicate, plural, conjoined=index > 0))
        return " ".join(words)

    def modifier(self, predicate: PredicateTemplate, plural: bool, *, conjoined: bool = False) -> str:
        """The predicate as a modifier after its noun: "touching a wall", "that is not at the base"."""
        conjunction = self.pick("and ", "and ", "") if conjoined else ""
        complement = self.signed_complement(predicate)
        if predicate.follows_noun and (conjoined or predicate.main_complement is not None or self.chance(0.6)):
            return conjunction + complement
        which = self.pick("that", "that", "which")
        if predicate.verb_forms is not None and predicate.positive and self.chance(0.35):
            return f"{conjunction}{which} {predicate.verb_forms[plural]}"
        return f"{conjunction}{which} {self.be(plural)} {complement}"

    def signed_complement(self, predicate: PredicateTemplate) -> str:
        if predicate.positive:
            return predicate.complement
        return f"not {predicate.negated_complement or predicate.complement}"

    def verb_phrase(self, predicate: PredicateTemplate, plural: bool) -> str:
        """The predicate as a verb phrase: "touches a wall"."""
        if predicate.verb_forms is not None and self.chance(0.3):
            if predicate.positive:
                return predicate.verb_forms[plural]
            does = self.pick("do not", "don't") if plural else self.pick("does not", "doesn't", "doesnt")
            return f"{does} {predicate.verb_forms[True]}"
        if predicate.main_complement is not None:
            return f"{self.be(plural)} {'' if predicate.positive else 'not '}{predicate.main_complement}"
        return f"{self.be(plural)} {self.signed_complement(predicate)}"

    def indefinite(self, noun: NounTemplate) -> str:
        """ "a blue circle" """
        return self.a(self.noun(noun, plural=False))

    def quantified(self, quantity: Quantity, noun: NounTemplate) -> Phrase:
        """ "at least two blue circles" """
        determiner = self.determiner(quantity)
        text = self.noun(noun, determiner.plural)
        if determiner.text == "a":
            return Phrase(self.a(text), plural=False)
        if determiner.text in ("a couple of", "a pair of") and self.chance(0.3):
            return Phrase(f"{determiner.text.removesuffix(' of')} {text}", determiner.plural)
        return Phrase(f"{determiner.text} {text}", determiner.plural)

    # Predicates of both appearances

    def attribute_predicate(self, attributes: AttributeWords, *, positive: bool = True) -> PredicateTemplate:
        """ "yellow", "a circle" """
        tests = attributes.tests()
        if attributes.shape is not None:
            complement = article(self.described_noun(attributes, plural=False))
        else:
            sizes = [self.choice(SIZES[attributes.size])] if attributes.size is not None else []
            colours = [self.colours(attributes.colours)] if attributes.colours else []
            complement = " and ".join([*sizes, *colours])
            if not sizes and self.chance(0.06):
                complement = f"{complement} {self.pick('in color', 'colored')}"
        program = tests[0] if len(tests) == 1 else f"({' and '.join(tests)})"
        return PredicateTemplate(complement, program, positive=positive, follows_noun=False)

    def relation_predicate(
        self, words: Sequence[str], function: str, noun: NounTemplate, *, positive: bool = True
    ) -> PredicateTemplate:
        """A relation to an item that `noun` denotes.

        `words`: alternative wordings of the relation; `function`: the program function that returns the related items.
        """
        program = f"exist({item_set(noun, f'{function}({HOLE})', 2 * HOLE)})"
        relation = self.choice(words)
        other = self.noun(noun, plural=False)
        complement = f"{relation} {self.a(other)}"
        verb_forms = (f"touches {article(other)}", f"touch {article(other)}") if relation == "touching" else None
        negated = f"{relation} {self.pick(f'any {other}', article(other))}"
        return PredicateTemplate(complement, program, verb_forms, positive, negated, kind=function)
