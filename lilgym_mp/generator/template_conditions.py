"""What a box may be asked for, in words and as program text: "two circles", "a black base", "nothing but squares"."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from lilgym_mp.generator.lexicon import pluralised
from lilgym_mp.generator.semantics import NONE, SOME, Quantity
from lilgym_mp.generator.template_phrases import (
    ANYTHING,
    COLOURS,
    SHAPES,
    Look,
    Noun,
    Speech,
    Test,
    Trait,
    exactly,
    items,
    numbered,
)

BOX = "b"
TRIES = 12  # to find conditions that go together
PLACES = (("left", "first", "left most"), ("middle", "second", "center"), ("right", "third", "last"))
ATTRIBUTES = ("color", "shape", "size")
ORDERS = {"more": ">", "fewer": "<", "equal": "==", "at least": ">="}
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


class Conditions(Speech):
    """What boxes may have, whatever lies in them."""

    most_in_box = 6  # items that statements ask of one box

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
            if apart(one, other):
                return one, other

    # Items of the picture
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

    def comparison(self, one: Noun, other: Noun, order: str, margin: int | None) -> str:
        first, second = self.noun(one, plural=True), self.noun(other, plural=True)
        same_shape = one.look.shape == other.look.shape and not one.traits and not other.traits
        if same_shape and other.look.colours and not other.look.size and self.chance(0.5):
            second = self.pick(f"{self.colours(other.look.colours)} ones", self.colours(other.look.colours))
        if order == "at least":
            return self.pick(f"at least as many {first} as {second}", f"as many or more {first} than {second}")
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

    def conditions(self, number: int) -> list[Condition]:
        """Different conditions, what is lacking last; seldom fewer, where no more go together."""
        found: list[Condition] = []
        for _ in range(TRIES):
            if len(found) == number:
                break
            condition = self.condition()
            if not any(clash(condition, other) for other in found):
                found.append(condition)
        return sorted(found, key=lambda condition: (condition.lacks, condition.after is None))

    def two_conditions(self) -> tuple[Condition, Condition]:
        while len(found := self.conditions(2)) < 2:
            pass
        return found[0], found[1]

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
        if opening == "consisting of" and any(condition.kind in ("has", "traited") for condition in conditions):
            opening = "with"  # "a tower consisting of two black blocks" has no others
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
        words, quantity = self.variety_words(attribute, number), exactly(number)
        if self.chance(0.2):
            words, quantity = self.varied_words(attribute)
        several = pluralised(self.voice.item)
        has = f"{several} {self.pick('of', 'of', 'in', 'with')} {words}"
        if quantity.low > 1 and (attribute != "shape" or "different" in words) and self.chance(0.4):
            has = words
        if quantity == exactly(1) and self.chance(0.4):
            has = self.pick(f"all {several} of the same {attribute}", f"all {several} in the same {attribute}",
                            f"only one {attribute}", f"{several} of same {attribute}")  # fmt: skip
        return Condition(
            lambda box: numbered(quantity, f"get_set_{attribute}s({in_box(box)})"), has, kind="varied",
            least=quantity.low,
        )  # fmt: skip

    def varied_words(self, attribute: str) -> tuple[str, Quantity]:
        """Bounds on how many colours there are."""
        name, two = f"{attribute}s", self.number(2)
        least = (f"at least {two} {name}", f"at least {two} different {name}", f"more than one {attribute}",
                 f"different {name}", f"more than {self.number(1)} {attribute}", f"{two} or more {name}")  # fmt: skip
        most = (f"at most {two} {name}", f"no more than {two} {name}", f"less than {self.number(3)} {name}")
        return (self.one(least), Quantity(2, None)) if self.chance(0.7) else (self.one(most), Quantity(1, 2))

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
            text, kind="total", look=look, least=total, most=total,
        )  # fmt: skip

    def all_of_box(self) -> Condition:
        """ "all circles touching a wall" """
        noun, trait = self.pick(ANYTHING, Noun(self.look()), Noun(self.look())), self.trait()
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
                         f"{one} and it's {trait.core}")  # fmt: skip
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

    def either(self) -> Condition:
        """ "either a circle or a square" """
        one, other = self.two_looks()
        first, second = Noun(one), Noun(other)
        text = f"{self.pick('either ', '')}{self.some(first)} or {self.some(second)}"
        return Condition(
            lambda box: f"(exist({items(first, in_box(box))}) or exist({items(second, in_box(box))}))",
            text,
            kind="either",
        )

    def one_of_each(self) -> Condition:
        """ "a block of each color" """
        attribute = self.attribute()
        noun = Noun(self.look_free_of(attribute))
        number = self.pick(1, 1, 1, 2)
        each = self.pick(f"each {attribute}", f"every {attribute}", f"each of the {attribute}s",
                         f"all three {attribute}s",
                         f"each of the three {attribute}s")  # fmt: skip
        each = each if "all" not in each or number > 1 else f"each {attribute}"
        count = "" if number > 1 or self.chance(0.6) else self.pick("exactly ", "only ")
        quantity = exactly(number) if number > 1 or count else SOME
        named = self.some(noun) if quantity == SOME else f"{count}{self.number(number)} {self.noun(noun, number > 1)}"
        names = {"color": COLOURS, "shape": SHAPES, "size": ("small", "medium", "big")}[attribute]
        looks = [Noun(_with(noun.look, attribute, name)) for name in names]

        def test(box: str) -> str:
            return " and ".join(numbered(quantity, items(look, in_box(box))) for look in looks)

        return Condition(test, f"{named} of {each}", kind="varied", least=3 * number)

    def just_these(self) -> Condition:
        """ "only a circle and two squares": nothing else."""
        one, other = self.two_looks()
        numbers = self.pick(1, 1, 2, 2, 3), self.pick(1, 1, 2)
        nouns = Noun(one), Noun(other)
        named = [
            self.some(noun)
            if number == 1 and self.chance(0.4)
            else f"{self.number(number)} {self.noun(noun, number > 1)}"
            for noun, number in zip(nouns, numbers, strict=True)
        ]
        total = sum(numbers)
        item = f"{self.number(total)} {self.noun(ANYTHING, True)}"
        text = self.pick(
            f"only {named[0]} and {named[1]}", f"{named[0]} and {named[1]} only",
            f"{named[0]}, {named[1]} and nothing else",
            f"{item}, {named[0]} and {named[1]}", f"{item}: {named[0]} and {named[1]}",
            f"just {named[0]} and {named[1]}",
            f"exactly {item}, {named[0]} and {named[1]}",
        )  # fmt: skip

        def test(box: str) -> str:
            counts = (
                f"count({items(noun, in_box(box))}) == {number}" for noun, number in zip(nouns, numbers, strict=True)
            )
            return f"count({in_box(box)}) == {total} and {' and '.join(counts)}"

        return Condition(test, text, kind="total", least=total, most=total)

    def and_others(self) -> Condition:
        """ "one black item and two other items", "one black item and the rest yellow" """
        look = Look(self.colour())
        number = self.pick(1, 1, 2)
        first = self.quantified(exactly(number), Noun(look)).text
        if self.chance(0.5):
            others = self.pick(1, 2, 2, 3)
            other = f"{self.number(others)} {self.pick('other', 'more', 'other')} {self.noun(ANYTHING, others > 1)}"
            total = number + others
            return Condition(
                lambda box: f"count({in_box(box)}) == {total} and count({items(Noun(look), in_box(box))}) == {number}",
                f"{first} and {other}", kind="total", least=total, most=total,
            )  # fmt: skip
        rest = Look(self.colour())
        while rest == look:
            rest = Look(self.colour())
        several = self.pick("the rest", "the others", f"all the other {pluralised(self.voice.item)}",
                            f"all other {pluralised(self.voice.item)}", "all the others")  # fmt: skip
        rest_name = self.plain_noun(rest, plural=True) if self.chance(0.2) else rest.colours[0]
        text = f"{first} and {several} {self.pick('are ', '', 'are ')}{rest_name}"
        either = Look((*look.colours, *rest.colours)).tests()[0]

        def test(box: str) -> str:
            counts = f"count({items(Noun(look), in_box(box))}) == {number} and exist({items(Noun(rest), in_box(box))})"
            return f"{counts} and All({in_box(box)}, lambda x: {either('x')})"

        return Condition(test, text, kind="purely", least=number + 1)

    def no_two_alike(self) -> Condition:
        """ "no two items of the same color" """
        attribute = self.attribute()
        several = pluralised(self.voice.item)
        text = self.pick(
            f"no two {several} of the same {attribute}", f"no {several} of the same {attribute}",
            f"{several} all of different {attribute}s", f"all {several} of different {attribute}s",
        )  # fmt: skip
        return Condition(
            lambda box: f"exist({in_box(box)}) and count({in_box(box)}) == count(get_set_{attribute}s({in_box(box)}))",
            text, kind="varied", least=2,
        )  # fmt: skip


def _with(look: Look, attribute: str, value: str) -> Look:
    match attribute:
        case "color":
            return replace(look, colours=(value,))
        case "shape":
            return replace(look, shape=value)
        case _:
            return replace(look, size=value)


def apart(one: Look, other: Look) -> bool:
    """Whether the looks differ in just what both say, so that comparing them makes sense."""
    if one == other:
        return False
    colours = one.colours and other.colours and not set(one.colours) & set(other.colours)
    shapes = one.shape and other.shape and one.shape != other.shape
    sizes = one.size and other.size and one.size != other.size
    return bool(colours or shapes or sizes)


ALONE = frozenset({"purely", "compared", "varied", "alike"})  # go with numbers of anything only
PLACES_OF_BLOCKS = frozenset({"top", "bottom", "second", "third", "middle", "ends", "same ends", "alternating", "pile"})
COLOUR_KINDS = PLACES_OF_BLOCKS | ALONE | {"has", "traited"}


def clash(one: Condition, other: Condition) -> bool:
    """Whether the two contradict each other, say the same twice, or read oddly side by side."""
    kinds = {one.kind, other.kind}
    if len(kinds) == 1 and one.kind not in ("has", "traited"):
        return True
    if kinds & ALONE and kinds <= COLOUR_KINDS:
        return "purely" in kinds or "compared" in kinds or len(kinds & ALONE) > 1
    if ("ends" in kinds and kinds & {"top", "bottom", "same ends", "middle"}) or {"same ends", "top"} == kinds:
        return True
    if "purely" in kinds and (one.look is not None or other.look is not None):
        return True
    if one.look is not None and one.look == other.look and (one.lacks or other.lacks or one.kind == other.kind):
        return True
    if one.lacks and other.lacks:
        return True
    return any(_crowded(a, b) for a, b in ((one, other), (other, one)))


def _crowded(one: Condition, other: Condition) -> bool:
    """Whether `one` allows too few items for `other`, or just so many that it says too much."""
    if one.most is None:
        return False
    return other.least > one.most or (other.least == one.most and other.kind not in PLACES_OF_BLOCKS)
