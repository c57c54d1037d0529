"""Words and program text side by side: numbers, nouns, traits of items. `frames` builds whole statements of them.

Where `wording` gives a few careful ways to say a meaning, this is how many people type about pictures. Every part
carries its piece of program, so that whatever words are taken, statement and program say the same.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

from lilgym_mp.generator.lexicon import NUMBER_WORDS, article, conjugated, pluralised
from lilgym_mp.generator.semantics import NONE, SOME, Quantity

Test = Callable[[str], str]  # program text that tests the variable named
Option = TypeVar("Option")

COLOURS = ("yellow", "black", "blue")
SHAPES = ("circle", "square", "triangle")
SIZES = {
    "small": ("small", "small", "small", "tiny", "little", "small sized"),
    "medium": ("medium", "medium", "medium sized", "medium-sized", "mid-sized"),
    "big": ("big", "big", "large", "large", "big sized"),
}
NEXT_VARIABLE = {"x": "y", "y": "z", "z": "u", "u": "v", "v": "w"}
ALL_ITEMS = "all_items"


class Voice(NamedTuple):
    """The words that one writer keeps to within a statement."""

    item: str
    tower: str
    box: str
    wall: str
    picture: str
    digits: bool
    sloppy: bool  # agreement errors, articles left out
    bare_number_is_bound: bool = False  # "two" may mean at least two, "one of the boxes" just one


@dataclass(frozen=True, slots=True)
class Look:
    """What an item looks like: any number of colours, of which it has one; a shape; a size."""

    colours: tuple[str, ...] = ()
    shape: str | None = None
    size: str | None = None

    def tests(self) -> tuple[Test, ...]:
        names = [self.size, self.shape]
        tests = [] if not self.colours else [_colour_test(self.colours)]
        return (*tests, *(_named_test(name) for name in names if name is not None))


@dataclass(frozen=True, slots=True)
class Trait:
    """What an item may be besides its look."""

    core: str  # after "is"
    test: Test
    verbs: tuple[str, str] | None = None  # third person singular and plural: "touches a wall", "touch a wall"
    holds: bool = True
    negated_core: str | None = None  # where "not" alone does not do
    bare: bool = True  # whether `core` can stand right after its noun
    kind: str = "look"  # no noun has two traits of one kind
    told: str | None = None  # after "is" in a main clause, where `core` does not do

    def tested(self, variable: str) -> str:
        text = self.test(variable)
        return text if self.holds else f"NOT({text})"


@dataclass(frozen=True, slots=True)
class Noun:
    """Items of one look with all the traits."""

    look: Look = Look()
    traits: tuple[Trait, ...] = ()

    def tests(self) -> tuple[Test, ...]:
        return (*self.look.tests(), *(trait.tested for trait in self.traits))

    def also(self, *traits: Trait) -> Noun:
        return Noun(self.look, (*self.traits, *traits))


ANYTHING = Noun()


class Phrase(NamedTuple):
    """Words, and whether a verb after them stands in the plural."""

    text: str
    plural: bool


def _named_test(name: str) -> Test:
    return lambda variable: f"is_{name}({variable})"


def _colour_test(colours: Sequence[str]) -> Test:
    if len(colours) == 1:
        return _named_test(colours[0])
    ordered = [colour for colour in COLOURS if colour in colours]
    return lambda variable: f"({' or '.join(f'is_{colour}({variable})' for colour in ordered)})"


def filtered(source: str, tests: Sequence[Test], variable: str = "x") -> str:
    """Program text for the items of `source` that pass all tests."""
    if not tests:
        return source
    return f"filter_obj({source}, lambda {variable}: {' and '.join(test(variable) for test in tests)})"


def items(noun: Noun, source: str = ALL_ITEMS, variable: str = "x") -> str:
    """Program text for the items of `source` that the noun names."""
    look = noun.look
    if not noun.traits and look == Look(look.colours) and len(look.colours) == 1:
        return f"filter_color({source}, Color.{look.colours[0].upper()})"
    if not noun.traits and look == Look(shape=look.shape) and look.shape is not None:
        return f"filter_shape({source}, Shape.{look.shape.upper()})"
    return filtered(source, noun.tests(), variable)


def numbered(quantity: Quantity, collection: str) -> str:
    """Program text for the collection having so many elements."""
    low, high, _ = quantity
    if high == 0:
        return f"NOT(exist({collection}))"
    if (low, high) == (1, None):
        return f"exist({collection})"
    if low == high:
        return f"count({collection}) == {low}"
    if high is None:
        return f"ge(count({collection}), {low})"
    if low == 0:
        return f"le(count({collection}), {high})"
    return f"{low} <= count({collection}) <= {high}"


def exactly(number: int) -> Quantity:
    return Quantity(number, number)


class Speech:
    """Phrases in one writer's voice; which of several wordings is taken is up to `rng`."""

    def __init__(self, rng: random.Random, voice: Voice) -> None:
        self.rng = rng
        self.voice = voice

    def pick(self, *options: Option) -> Option:
        return options[int(self.rng.random() * len(options))]

    def one(self, options: Sequence[Option]) -> Option:
        return options[int(self.rng.random() * len(options))]

    def chance(self, share: float) -> bool:
        return self.rng.random() < share

    def be(self, plural: bool) -> str:
        if self.voice.sloppy and self.chance(0.25):
            return "is"
        return "are" if plural else "is"

    def verb(self, verb: str, plural: bool) -> str:
        """A verb given in the third person singular."""
        if self.voice.sloppy and self.chance(0.2):
            return verb
        return conjugated(verb, plural)

    def number(self, value: int) -> str:
        return str(value) if self.voice.digits or value >= len(NUMBER_WORDS) else NUMBER_WORDS[value]

    def a(self, text: str) -> str:
        return text if self.voice.sloppy and self.chance(0.3) else article(text)

    # Quantities

    def quantity(self, most: int = 5, *, none: float = 0.05) -> Quantity:
        """Existence and exact numbers often, bounds less often."""
        draw = self.rng.random()
        if draw < none:
            return NONE
        number = min(most, self.pick(1, 1, 1, 1, 2, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 5, 6, 7))
        draw = self.rng.random()
        if draw < 0.38:
            return SOME
        if draw < 0.72:
            return exactly(number)
        if draw < 0.92:
            return Quantity(number, None)
        if draw < 0.97:
            return Quantity(0, number)
        if draw < 0.985 and most >= 4:
            return Quantity(self.pick(2, 3, 3, 4), None, vague=True)
        return Quantity(number, number + 1)

    def few(self, most: int = 4) -> Quantity:
        """How many of some items one box has."""
        number = min(most, self.pick(1, 1, 1, 2, 2, 2, 2, 3, 3, 4))
        draw = self.rng.random()
        if draw < 0.35:
            return SOME
        if draw < 0.78:
            return exactly(number)
        if draw < 0.96:
            return Quantity(number, None)
        return Quantity(0, number)

    def determiner(self, quantity: Quantity) -> Phrase:
        """The words before the noun; "a" stands for "a" or "an"."""
        low, high, vague = quantity
        if vague:
            words = {
                2: ("multiple",),
                3: ("several", "several", "a few", "quite a few"),
                4: ("many", "a lot of", "lots of"),
            }[low]
            return Phrase(self.one(words), plural=True)
        if quantity == NONE:
            return Phrase("no", plural=self.chance(0.5))
        if quantity == SOME:
            if self.voice.bare_number_is_bound and self.chance(0.08):
                return Phrase(self.number(1), plural=False)
            if self.chance(0.75):
                return Phrase("a", plural=False)
            return Phrase(f"{self.at_least()} {self.number(1)}", plural=False)
        if high is None:
            if low == 1:
                return Phrase(f"{self.at_least()} {self.number(1)}", plural=False)
            return Phrase(self.lower_bound(low), plural=low != 2 or self.chance(0.95))
        if low == high:
            return Phrase(self.exact(low), plural=low > 1)
        if low == 0:
            number, after = self.number(high), self.number(high + 1)
            text = self.pick("at most {0}", "at most {0}", "no more than {0}", "not more than {0}", "less than {1}",
                             "fewer than {1}", "maximum {0}")  # fmt: skip
            return Phrase(text.format(number, after), plural=high > 1 or "than" in text)
        return Phrase(f"{self.number(low)} or {self.number(high)}", plural=True)

    def at_least(self) -> str:
        return self.pick("at least", "at least", "at least", "at least", "atleast", "minimum", "not less than")

    def lower_bound(self, low: int) -> str:
        number, before = self.number(low), self.number(low - 1)
        if self.voice.bare_number_is_bound and self.chance(0.5):
            return number
        draw = self.rng.random()
        if draw < 0.65:
            return f"{self.at_least()} {number}"
        if draw < 0.8:
            return f"more than {before}"
        if draw < 0.9:
            return f"{number} or more"
        if low == 2:
            return self.pick("multiple", "more than one")
        return f"{self.pick('no less than', 'no fewer than', 'a minimum of')} {number}"

    def exact(self, number: int) -> str:
        draw = self.rng.random()
        word = self.number(number)
        if draw < 0.45:
            return word
        if draw < 0.8:
            return f"exactly {word}"
        if draw < 0.9:
            return f"only {word}"
        if number == 1:
            return self.pick("a single", "only one", "just one", "only a single", "exactly one")
        if number == 2:
            return self.pick("a couple of", "a pair of", "only two", "just two", "exactly two")
        return f"{self.pick('just', 'precisely', 'a total of', 'exactly')} {word}"

    # Nouns

    def plain_noun(self, look: Look, plural: bool) -> str:
        """Adjectives and noun, without an article."""
        noun = self.voice.item if look.shape is None else look.shape
        if plural and not (self.voice.sloppy and self.chance(0.1)):
            noun = pluralised(noun)
        size = [self.one(SIZES[look.size])] if look.size is not None else []
        colours = [self.colours(look.colours)] if look.colours else []
        if size and colours and self.chance(0.15):
            size, colours = colours, size
        if colours and self.chance(0.02):
            colours = [f"{colours[0]} {self.pick('colored', 'coloured', 'color')}"]
        return " ".join([*size, *colours, noun])

    def colours(self, colours: Sequence[str], last: str = "or") -> str:
        return f" {last} ".join(colours)

    def noun(self, noun: Noun, plural: bool) -> str:
        words = [self.plain_noun(noun.look, plural)]
        for place, trait in enumerate(noun.traits):
            words.append(self.modifier(trait, plural, joint=place > 0))
        return " ".join(words)

    def modifier(self, trait: Trait, plural: bool, *, joint: bool = False) -> str:
        """The trait after its noun: "touching a wall", "that is not at the base"."""
        joined = self.pick("and ", "and ", "") if joint else ""
        core = self.negated(trait)
        if trait.bare and (joint or trait.told is not None or self.chance(0.6)):
            return joined + core
        which = self.pick("that", "that", "which")
        if trait.verbs is not None and trait.holds and self.chance(0.35):
            return f"{joined}{which} {trait.verbs[plural]}"
        return f"{joined}{which} {self.be(plural)} {core}"

    def negated(self, trait: Trait) -> str:
        if trait.holds:
            return trait.core
        return f"not {trait.negated_core or trait.core}"

    def predicate(self, trait: Trait, plural: bool) -> str:
        """The trait as a verb phrase: "touches a wall"."""
        if trait.verbs is not None and self.chance(0.3):
            if trait.holds:
                return trait.verbs[plural]
            does = self.pick("do not", "don't") if plural else self.pick("does not", "doesn't", "doesnt")
            return f"{does} {trait.verbs[True]}"
        if trait.told is not None:
            return f"{self.be(plural)} {'' if trait.holds else 'not '}{trait.told}"
        return f"{self.be(plural)} {self.negated(trait)}"

    def some(self, noun: Noun) -> str:
        """ "a blue circle" """
        return self.a(self.noun(noun, plural=False))

    def quantified(self, quantity: Quantity, noun: Noun) -> Phrase:
        """ "at least two blue circles" """
        words = self.determiner(quantity)
        text = self.noun(noun, words.plural)
        if words.text == "a":
            return Phrase(self.a(text), plural=False)
        if words.text in ("a couple of", "a pair of") and self.chance(0.3):
            return Phrase(f"{words.text.removesuffix(' of')} {text}", words.plural)
        return Phrase(f"{words.text} {text}", words.plural)

    # Traits that both appearances have

    def look_trait(self, look: Look, *, holds: bool = True) -> Trait:
        """Being yellow, being a circle."""
        tests = look.tests()
        if look.shape is not None:
            core = article(self.plain_noun(look, plural=False))
        else:
            sizes = [self.one(SIZES[look.size])] if look.size is not None else []
            colours = [self.colours(look.colours)] if look.colours else []
            core = " and ".join([*sizes, *colours])
            if not sizes and self.chance(0.06):
                core = f"{core} {self.pick('in color', 'colored')}"
        return Trait(core, lambda v: _conjoined([test(v) for test in tests]), holds=holds, bare=False)

    def related(self, words: Sequence[str], function: str, noun: Noun, *, holds: bool = True) -> Trait:
        """Standing in a relation to an item that is a `noun`; `function` gives the related items."""

        def test(variable: str) -> str:
            return f"exist({items(noun, f'{function}({variable})', NEXT_VARIABLE[variable])})"

        words_taken = self.one(words)
        other = self.noun(noun, plural=False)
        core = f"{words_taken} {self.a(other)}"
        verbs = ("touches", "touch") if words_taken == "touching" else None
        full = (f"{verbs[0]} {article(other)}", f"{verbs[1]} {article(other)}") if verbs else None
        negated = f"{words_taken} {self.pick(f'any {other}', article(other))}"
        return Trait(core, test, full, holds, negated, kind=function)


def _conjoined(tests: Sequence[str]) -> str:
    return tests[0] if len(tests) == 1 else f"({' and '.join(tests)})"
