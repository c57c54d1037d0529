"""Synchronous templates for phrases: each part has its words and its program text.

They imitate how many people write about pictures. The words may be chosen freely because every part carries its own
program text; most are in `data/phrases.toml`.
"""

from __future__ import annotations

import random
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import accumulate
from string import Formatter
from typing import Any, NamedTuple, TypeVar

from lilgym_mp.corpus.generator.fragments import ALL_ITEMS, NONE, SOME, Quantity, at_least, at_most, exactly
from lilgym_mp.scene.arrays import AnyDict, Strings
from lilgym_mp.scene.choices import article

HOLE = "@"  # in the program text of a test: the item or box to test; "@@" is the variable of a lambda inside
VARIABLES = "xyzuvw"  # names of lambda parameters, by nesting depth
COLOURS = ("yellow", "black", "blue")
SHAPES = ("circle", "square", "triangle")
VALUES = {"color": COLOURS, "shape": SHAPES, "size": ("small", "medium", "big")}
NUMBER_WORDS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
IRREGULAR_PLURALS = {"is": "are", "has": "have", "does": "do", "touches": "touch"}  # plurals of verbs
Option = TypeVar("Option")
Slot = str | Callable[[bool], str]  # words, or what draws them given whether they are plural


class TrainingPair(NamedTuple):
    """A statement and the program that decides its truth."""

    statement: str
    program: str


class Phrase(NamedTuple):
    """A noun phrase, and whether a verb that agrees with it is plural."""

    text: str
    plural: bool


@dataclass(frozen=True)
class Style:
    """Lexical choices that one writer keeps to within a statement."""

    words: Mapping[str, str]  # nouns by what they name, "item" and "items", and the number words "one" to "three"
    digits: bool = False
    sloppy: bool = False  # makes agreement errors, leaves articles out
    bare_number_is_bound: bool = False  # "two" may mean at least two, "one of the boxes" exactly one


def pluralised(noun: str) -> str:
    """The plural of a regular noun."""
    return noun + "es" if noun.endswith("x") else noun + "s"


def conjugated(verb: str, plural: bool) -> str:
    """The form of a verb given in the third person singular."""
    if not plural:
        return verb
    return IRREGULAR_PLURALS.get(verb, verb.removesuffix("s"))


def verb_forms(phrase: str) -> tuple[str, str]:
    """Both forms of a verb phrase given in the third person singular."""
    verb, _, rest = phrase.partition(" ")
    return phrase, f"almost {verb_forms(rest)[1]}" if verb == "almost" else f"{conjugated(verb, True)} {rest}"


@dataclass(frozen=True, slots=True)
class Attributes:
    """The attribute words of a noun phrase; several colours are alternatives."""

    colours: Strings = ()
    shape: str | None = None
    size: str | None = None

    def tests(self) -> Strings:
        """Program texts of the tests of one item, HOLE in place of its variable."""
        colours = [f"is_{colour}({HOLE})" for colour in COLOURS if colour in self.colours]
        either = f"({' or '.join(colours)})" if len(colours) > 1 else "".join(colours)
        return tuple(filter(None, (either, *(f"is_{name}({HOLE})" for name in (self.size, self.shape) if name))))


@dataclass(frozen=True, slots=True)
class Predicate:
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
        """Program text of the predicate, negated unless it is positive."""
        return bound(self.program if self.positive else f"NOT({self.program})", variable)


@dataclass(frozen=True, slots=True)
class Noun:
    """A noun phrase without determiner: attribute words and predicates."""

    attributes: Attributes = Attributes()
    predicates: tuple[Predicate, ...] = ()

    def tests(self) -> Strings:
        """Program texts of all tests of one item, HOLE in place of its variable."""
        return (*self.attributes.tests(), *(predicate.signed_test() for predicate in self.predicates))

    def such_that(self, *predicates: Predicate) -> Noun:
        """The noun with further predicates."""
        return Noun(self.attributes, (*self.predicates, *predicates))

    def items(self, source: str = ALL_ITEMS, variable: str = "x") -> str:
        """Program text: the items of `source` that the noun phrase denotes."""
        colours = self.attributes.colours
        shape = self.attributes.shape
        tests = self.tests()
        if not self.predicates and len(tests) == 1 and len(colours) == 1:
            return f"filter_color({source}, Color.{colours[0].upper()})"
        if not self.predicates and len(tests) == 1 and shape is not None:
            return f"filter_shape({source}, Shape.{shape.upper()})"
        test = " and ".join(bound(test, variable) for test in tests)
        return f"filter_obj({source}, lambda {variable}: {test})" if tests else source

    def in_box(self, box: str = HOLE) -> str:
        """Program text: the items of the box that the noun phrase denotes."""
        return self.items(f"{box}.all_items_in_box()")

    def related(self, function: str) -> str:
        """Program text: the function of the tested item returns an item that the noun phrase denotes."""
        return f"exist({self.items(f'{function}({HOLE})', 2 * HOLE)})"


ANYTHING = Noun()


def bound(test: str, variable: str) -> str:
    """The program text of a test of this variable."""

    def name(holes: re.Match[str]) -> str:
        depth = len(holes[0]) - 1
        return variable + HOLE * depth if HOLE in variable else VARIABLES[VARIABLES.index(variable) + depth]

    return re.sub(f"{HOLE}+", name, test)


class PhraseBook(NamedTuple):
    """The words and weights of one appearance."""

    wordings: Mapping[str, Sequence[str]]  # alternatives
    style: Mapping[str, Sequence[str]]  # words to choose a style's from
    statements: Sequence[str]  # the methods that make statements
    cumulative_weights: Sequence[float]  # theirs
    conditions: Mapping[str, float]  # probabilities of the methods that make conditions; else `contains_some`


@cache
def phrase_tables() -> AnyDict:
    """The contents of data/phrases.toml."""
    return tomllib.loads((files("lilgym_mp.data") / "phrases.toml").read_text(encoding="utf-8"))


@cache
def phrase_book(appearance: str) -> PhraseBook:
    """The wordings and probabilities of an appearance."""
    own = phrase_tables()[appearance]
    wordings = phrase_tables()["common"] | own["wordings"]
    style = {name: [word for word in counts for _ in range(counts[word])] for name, counts in own["style"].items()}
    statements: dict[str, float] = own["statements"]
    return PhraseBook(wordings, style, tuple(statements), tuple(accumulate(statements.values())), own["conditions"])


class _Filler(Formatter):
    """Fills in slots, those that draw words each time: `{does:one}`, `{does:many}`, `{or:a|b}`."""

    def format_field(self, value: Any, format_spec: str) -> str:
        """`value`: words, or what draws them, given whether they are plural or a list to choose from."""
        if isinstance(value, str):
            return value
        return value(format_spec.split("|") if "|" in format_spec else format_spec == "many")


FILLER = _Filler()


class Writer:
    """Random phrases in the style of one writer."""

    appearance: str

    def __init__(self, rng: random.Random) -> None:
        self.rng = rng
        self.book = phrase_book(self.appearance)
        self.style = self.random_style()

    def random_style(self) -> Style:
        """Draws the habits of an annotator."""
        words = {name: self.rng.choice(options) for name, options in self.book.style.items()}
        words |= {pluralised(name): pluralised(word) for name, word in words.items()}
        words["picture"] = self.rng.choice(("picture", "image", "picture", "image"))
        digits = self.chance(0.4)
        sloppy = self.chance(0.2)
        words["one"], words["two"], words["three"] = "123" if digits else NUMBER_WORDS[1:4]
        return Style(words, digits, sloppy)

    def pick(self, *options: Option) -> Option:
        """One of the options, each equally likely."""
        return self.choice(options)

    def choice(self, options: Sequence[Option]) -> Option:
        """One of the options, each equally likely; draws a single number, whatever their count."""
        return options[int(self.rng.random() * len(options))]

    def chance(self, probability: float) -> bool:
        """Draws True with the given probability."""
        return self.rng.random() < probability

    def drawn(self, *options: tuple[float, Option]) -> Option:
        """The first option whose bound is above a random number; the last bound is 1."""
        draw = self.rng.random()
        return next(option for bound, option in options if draw < bound)

    def say(self, wording: str, **slots: Slot) -> str:
        """One of the phrase book's wordings. All are filled in, in order, before one is drawn: slots may draw words."""
        filling = {**self.style.words, "or": self.choice, **slots}
        return self.choice([FILLER.vformat(option, (), filling) for option in self.book.wordings[wording]])

    def word(self, name: str) -> str:
        """The noun of the writer's style, "item", "items", "box" ..."""
        return self.style.words[name]

    def be(self, plural: bool) -> str:
        """The verb "is" or "are"; a sloppy annotator sometimes writes the first for both."""
        if self.style.sloppy and self.chance(0.25):
            return "is"
        return "are" if plural else "is"

    def verb(self, verb: str, plural: bool) -> str:
        """The form of a verb given in the third person singular."""
        if self.style.sloppy and self.chance(0.2):
            return verb
        return conjugated(verb, plural)

    def colour(self) -> Strings:
        """One random colour, as the field `colours` of `Attributes`."""
        return (self.choice(COLOURS),)

    def number(self, value: int) -> str:
        """The number in the annotator's habit: a word or digits."""
        return str(value) if self.style.digits or value >= len(NUMBER_WORDS) else NUMBER_WORDS[value]

    def a(self, text: str) -> str:
        """The text with "a" or "an"; a sloppy annotator sometimes leaves it out."""
        return text if self.style.sloppy and self.chance(0.3) else article(text)

    # Quantities

    def quantity(self, max_count: int = 5, *, none: float = 0.05) -> Quantity:
        """Mostly existence and exact counts; zero with probability `none`."""
        if self.chance(none):
            return NONE
        number = min(max_count, self.pick(1, 1, 1, 1, 2, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 5, 6, 7))
        either = Quantity(number, number + 1)
        bounded = ((0.92, at_least(number)), (0.97, at_most(number)))
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
            return Phrase(self.say(f"vague_{low}"), plural=True)
        if quantity == NONE:
            return Phrase("no", plural=self.chance(0.5))
        if quantity == SOME:
            if self.style.bare_number_is_bound and self.chance(0.08):
                return Phrase(self.number(1), plural=False)
            if self.chance(0.75):
                return Phrase("a", plural=False)
            return Phrase(f"{self.say('at_least')} {self.number(1)}", plural=False)
        if high is None:
            return Phrase(self.lower_bound(low), plural=low != 2 or self.chance(0.95))
        if low == high:
            return Phrase(self.exact(low), plural=low > 1)
        if low == 0:
            text = self.say("at_most", most=self.number(high), more=self.number(high + 1))
            return Phrase(text, plural=high > 1 or "than" in text)
        return Phrase(f"{self.number(low)} or {self.number(high)}", plural=True)

    def lower_bound(self, low: int) -> str:
        """Words for `low` or more."""
        number = self.number(low)
        before = self.number(low - 1)
        if self.style.bare_number_is_bound and self.chance(0.5):
            return number
        draw = self.rng.random()
        if draw < 0.65:
            return f"{self.say('at_least')} {number}"
        if draw < 0.8:
            return f"more than {before}"
        if draw < 0.9:
            return f"{number} or more"
        if low == 2:
            return self.pick("multiple", "more than one")
        return f"{self.pick('no less than', 'no fewer than', 'a minimum of')} {number}"

    def exact(self, number: int) -> str:
        """Words for the exact number."""
        word = self.number(number)
        if text := self.drawn((0.45, word), (0.8, f"exactly {word}"), (0.9, f"only {word}"), (1, "")):
            return text
        if number in (1, 2):
            return self.say(f"exactly_{number}")
        return f"{self.say('exactly')} {word}"

    # Noun phrases

    def adjectives(self, attributes: Attributes) -> tuple[list[str], list[str]]:
        """The words for the size and for the colours, each a list of one or none."""
        size = [self.say(attributes.size)] if attributes.size is not None else []
        return size, [" or ".join(attributes.colours)] if attributes.colours else []

    def described_noun(self, attributes: Attributes, plural: bool) -> str:
        """Adjectives and noun, without an article."""
        noun = attributes.shape or self.word("item")
        if plural and not (self.style.sloppy and self.chance(0.1)):
            noun = pluralised(noun)
        size, colours = self.adjectives(attributes)
        if size and colours and self.chance(0.15):
            size, colours = colours, size
        if colours and self.chance(0.02):
            colours = [f"{colours[0]} {self.pick('colored', 'coloured', 'color')}"]
        return " ".join([*size, *colours, noun])

    def noun(self, noun: Noun, plural: bool) -> str:
        """The noun with its predicates as modifiers."""
        words = [self.described_noun(noun.attributes, plural)]
        for index, predicate in enumerate(noun.predicates):
            words.append(self.modifier(predicate, plural, conjoined=index > 0))
        return " ".join(words)

    def modifier(self, predicate: Predicate, plural: bool, *, conjoined: bool = False) -> str:
        """The predicate as a modifier after its noun: "touching a wall", "that is not at the base"."""
        conjunction = self.pick("and ", "and ", "") if conjoined else ""
        complement = self.signed_complement(predicate)
        if predicate.follows_noun and (conjoined or predicate.main_complement is not None or self.chance(0.6)):
            return conjunction + complement
        which = self.pick("that", "that", "which")
        if predicate.verb_forms is not None and predicate.positive and self.chance(0.35):
            return f"{conjunction}{which} {predicate.verb_forms[plural]}"
        return f"{conjunction}{which} {self.be(plural)} {complement}"

    def signed_complement(self, predicate: Predicate) -> str:
        """The complement of a verb, negated unless the predicate is positive."""
        if predicate.positive:
            return predicate.complement
        return f"not {predicate.negated_complement or predicate.complement}"

    def verb_phrase(self, predicate: Predicate, plural: bool) -> str:
        """The predicate as a verb phrase: "touches a wall"."""
        if predicate.verb_forms is not None and self.chance(0.3):
            if predicate.positive:
                return predicate.verb_forms[plural]
            does = self.pick("do not", "don't") if plural else self.pick("does not", "doesn't", "doesnt")
            return f"{does} {predicate.verb_forms[True]}"
        if predicate.main_complement is not None:
            return f"{self.be(plural)} {'' if predicate.positive else 'not '}{predicate.main_complement}"
        return f"{self.be(plural)} {self.signed_complement(predicate)}"

    def indefinite(self, noun: Noun) -> str:
        """ "a blue circle" """
        return self.a(self.noun(noun, plural=False))

    def quantified(self, quantity: Quantity, noun: Noun) -> Phrase:
        """ "at least two blue circles" """
        determiner = self.determiner(quantity)
        text = self.noun(noun, determiner.plural)
        if determiner.text == "a":
            return Phrase(self.a(text), plural=False)
        if determiner.text in ("a couple of", "a pair of") and self.chance(0.3):
            return Phrase(f"{determiner.text.removesuffix(' of')} {text}", determiner.plural)
        return Phrase(f"{determiner.text} {text}", determiner.plural)

    # Predicates of both appearances

    def attribute_predicate(self, attributes: Attributes) -> Predicate:
        """ "yellow", "a circle" """
        tests = attributes.tests()
        if attributes.shape is not None:
            complement = article(self.described_noun(attributes, plural=False))
        else:
            size, colours = self.adjectives(attributes)
            complement = " and ".join([*size, *colours])
            if not size and self.chance(0.06):
                complement = f"{complement} {self.pick('in color', 'colored')}"
        program = tests[0] if len(tests) == 1 else f"({' and '.join(tests)})"
        return Predicate(complement, program, follows_noun=False)

    def relation_predicate(
        self, wording: str, function: str, noun: Noun, *, positive: bool = True, **slots: Slot
    ) -> Predicate:
        """A relation to an item that `noun` denotes; `function`: the program function that returns related items."""
        relation = self.say(wording, **slots)
        other = self.noun(noun, plural=False)
        complement = f"{relation} {self.a(other)}"
        forms = verb_forms(f"touches {article(other)}") if relation == "touching" else None
        negated = f"{relation} {self.pick(f'any {other}', article(other))}"
        return Predicate(complement, noun.related(function), forms, positive, negated, kind=function)
