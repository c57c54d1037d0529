"""English for the parts of a meaning: numbers, nouns, traits, what boxes have. `wording` makes statements of them."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from lilgym_mp.generator.semantics import (
    NONE,
    SOME,
    AtLevel,
    Attribute,
    AtWall,
    Beside,
    BesideLike,
    Condition,
    Ends,
    Has,
    HasLook,
    InBox,
    InCorner,
    Level,
    Look,
    Noun,
    Purely,
    Quantity,
    Relation,
    SameEnds,
    Share,
    Sharing,
    Trait,
    Varied,
    Wall,
)
from lilgym_mp.scene import Colour, Shape, Size

NUMBER_WORDS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
BOX_NAMES = ("left", "middle", "right")
COLOUR_NAMES = {Colour.YELLOW: "yellow", Colour.BLACK: "black", Colour.BLUE: "blue"}
SHAPE_NAMES = {Shape.CIRCLE: "circle", Shape.SQUARE: "square", Shape.TRIANGLE: "triangle"}
SIZE_NAMES = {
    Size.SMALL: ("small", "small", "tiny", "little"),
    Size.MEDIUM: ("medium-sized", "medium"),
    Size.LARGE: ("big", "large"),
}
ATTRIBUTE_NAMES = {Attribute.COLOUR: "color", Attribute.SHAPE: "shape", Attribute.SIZE: "size"}
WALL_NAMES = {
    Wall.LEFT: ("the left {wall}", "the {wall} on the left"),
    Wall.RIGHT: ("the right {wall}", "the {wall} on the right"),
    Wall.TOP: ("the top {wall}", "the upper {wall}"),
    Wall.BOTTOM: ("the bottom {wall}", "the floor", "the lower {wall}"),
}
IRREGULAR = {"is": "are", "has": "have", "does": "do", "touches": "touch"}


class Phrase(NamedTuple):
    """Words, and whether a verb after them stands in the plural."""

    text: str
    plural: bool


@dataclass(frozen=True)
class Style:
    """The words that one writer keeps to within a statement."""

    item: str  # the word for anything: block, object ...
    tower: str = "tower"
    wall: str = "wall"
    picture: str = "picture"
    digits: bool = False


def article(noun: str) -> str:
    return f"an {noun}" if noun[0] in "aeiou" else f"a {noun}"


def pluralised(noun: str) -> str:
    return noun + "es" if noun.endswith("x") else noun + "s"


def conjugated(verb: str, plural: bool) -> str:
    """A verb given in the third person singular."""
    if not plural:
        return verb
    return IRREGULAR.get(verb, verb.removesuffix("s"))


def listed(parts: Sequence[str], last: str = "and") -> str:
    """Parts joined as in prose."""
    if len(parts) == 1:
        return parts[0]
    return f"{', '.join(parts[:-1])} {last} {parts[-1]}"


class Phrases:
    """Phrases in one style; which of several wordings is taken is up to `rng`."""

    def __init__(self, rng: random.Random, style: Style) -> None:
        self.rng = rng
        self.style = style

    def pick(self, *options: str) -> str:
        return self.rng.choice(options)

    def chance(self, share: float) -> bool:
        return self.rng.random() < share

    def number(self, value: int) -> str:
        return str(value) if self.style.digits else NUMBER_WORDS[value]

    def be(self, plural: bool) -> str:
        return conjugated("is", plural)

    # Nouns

    def look(self, look: Look, plural: bool, *, alone: bool = True) -> str:
        """Adjectives and noun, without an article; `alone` when nothing follows that belongs to the noun."""
        noun = self.style.item if look.shape is None else SHAPE_NAMES[look.shape]
        noun = pluralised(noun) if plural else noun
        size = [] if look.size is None else [self.pick(*SIZE_NAMES[look.size])]
        if alone and len(look.colours) == 2 and self.chance(0.4):
            (left_out,) = set(Colour) - look.colours
            absent = COLOUR_NAMES[left_out]
            return " ".join([*size, noun, f"that {self.be(plural)} not {absent}"])
        colours = [self.colours(look.colours)] if look.colours else []
        return " ".join([*size, *colours, noun])

    def colours(self, colours: frozenset[Colour]) -> str:
        names = [COLOUR_NAMES[colour] for colour in sorted(colours)]
        self.rng.shuffle(names)
        return " or ".join(names)

    def noun(self, noun: Noun, plural: bool, *, alone: bool = True) -> str:
        words = [
            self.look(noun.look, plural, alone=alone and not noun.traits),
            *(self.modifier(trait, plural) for trait in noun.traits),
        ]
        return " ".join(words)

    def some(self, noun: Noun, other_than: Noun | None = None) -> str:
        """ "a blue circle", "another blue circle" """
        text = self.noun(noun, plural=False, alone=False)
        return f"another {text}" if other_than is not None and noun.look == other_than.look else article(text)

    def quantified(self, quantity: Quantity, noun: Noun) -> Phrase:
        """ "at least two blue circles" """
        words = self.quantity(quantity)
        text = self.noun(noun, words.plural)
        if words.text == "a":
            return Phrase(article(text), plural=False)
        return Phrase(f"{words.text} {text}", words.plural)

    def quantity(self, quantity: Quantity) -> Phrase:
        """The determiner; "a" stands for "a" or "an"."""
        low, high, soft = quantity
        if soft:
            vague = ("several", "quite a few") if low == 3 else ("many", "a lot of", "lots of")
            return Phrase(self.pick(*vague), plural=True)
        if quantity == NONE:
            return Phrase("no", plural=self.chance(0.5))
        if quantity == SOME:
            text = self.pick("a", "a", "a", "a", "at least one", "one or more")
            return Phrase(text, plural=text == "one or more")
        return Phrase(self.range(low, high), plural=self._range_is_plural)

    def range(self, low: int, high: int | None) -> str:
        """Words for an exact or bounded number; sets whether what follows is plural."""
        self._range_is_plural = True
        if high is None:
            options = [f"at least {self.number(low)}", f"no fewer than {self.number(low)}"]
            options += [f"more than {self.number(low - 1)}", f"{self.number(low)} or more"]
            if low == 2:
                options += ["multiple", "more than one"]
        elif low == high:
            options = [f"{adverb} {self.number(low)}" for adverb in ("exactly", "exactly", "exactly", "only", "just")]
            options += [self.number(low)] * 4 if low > 1 else ["a single", f"precisely {self.number(1)}"]
            options += ["a pair of"] if low == 2 else []
        elif low == 0:
            options = [f"at most {self.number(high)}", f"no more than {self.number(high)}"]
            options += [f"fewer than {self.number(high + 1)}", f"not more than {self.number(high)}"]
        else:
            options = [f"at least {self.number(low)} but no more than {self.number(high)}"]
            options += [f"between {self.number(low)} and {self.number(high)}"] if high > low + 1 else []
            options += [f"{self.number(low)} or {self.number(high)}"] * 3 if high == low + 1 else []
        text = self.pick(*options)
        last = text.split()[-1]
        if last in ("one", "1", "single") and " or " not in text:
            self._range_is_plural = False
        return text

    _range_is_plural = True

    # Traits

    def modifier(self, trait: Trait, plural: bool) -> str:
        """The trait after its noun: "touching the left wall"."""
        be = self.be(plural)
        match trait:
            case HasLook():
                return f"that {self.predicate(trait, plural)}"
            case AtWall(_, True, _):
                wall = self.wall(trait)
                return self.pick(f"touching or almost touching {wall}", f"very close to {wall} or touching it")
            case AtWall(_, _, True):
                wall = self.wall(trait)
                touch = conjugated("touches", plural)
                return self.pick(f"touching {wall}", f"that {touch} {wall}", f"against {wall}")
            case AtWall():
                wall = self.wall(trait)
                does = conjugated("does", plural)
                return self.pick(
                    f"not touching {wall}", f"that {does} not touch {wall}", f"that {be} not touching {wall}"
                )
            case InCorner(_, True):
                if plural:
                    return self.pick("in corners", "sitting in corners")
                return self.pick("in a corner", "sitting in a corner", "in a corner of a box", "tucked into a corner")
            case InCorner():
                return self.pick(f"that {be} not in a corner", "not in a corner")
            case InBox(index, holds):
                name = BOX_NAMES[index]
                inside = (f"in the {name} box", f"inside the {name} box")
                return self.pick(*inside) if holds else self.pick(f"outside the {name} box", f"not in the {name} box")
            case AtLevel(level):
                return self.place(level, plural)
            case Beside(relation, noun, holds):
                return self.beside(relation, noun) if holds else f"not {self.beside(relation, noun, negated=True)}"
            case BesideLike():
                return self.related(trait.relation, self.like(trait))

    def predicate(self, trait: Trait, plural: bool) -> str:
        """The trait as a verb phrase: "touches the left wall"."""
        be = self.be(plural) + ("" if trait.holds else " not")
        match trait:
            case HasLook(look):
                return f"{be} {self.look_complement(look, plural)}"
            case AtWall(_, True, _):
                wall = self.wall(trait)
                touch = conjugated("touches", plural)
                return self.pick(f"{touch} or almost {touch} {wall}", f"{be} very close to {wall} or touching it")
            case AtWall(_, _, True):
                wall = self.wall(trait)
                return self.pick(
                    f"{conjugated('touches', plural)} {wall}", f"{be} touching {wall}", f"{be} against {wall}"
                )
            case AtWall():
                wall = self.wall(trait)
                does = conjugated("does", plural)
                return self.pick(f"{does} not touch {wall}", f"{be} touching {wall}")
            case InCorner(_, True):
                sit = conjugated(self.pick("is", "sits", "lies"), plural)
                return f"{sit} {'in corners' if plural else self.pick('in a corner', 'in a corner of a box')}"
            case InCorner():
                return f"{be} in a corner"
            case InBox(index):
                name = BOX_NAMES[index]
                return f"{be} {self.pick(f'in the {name} box', f'inside the {name} box')}"
            case AtLevel(level, True):
                stand = conjugated(self.pick("is", "is", "stands" if level is Level.BOTTOM else "sits"), plural)
                return f"{stand} {self.place(level, plural)}"
            case AtLevel(level):
                return f"{be} {self.place(level, plural)}"
            case Beside(Relation.TOUCHING, noun, True) if self.chance(0.5):
                return f"{conjugated('touches', plural)} {self.some(noun)}"
            case Beside(relation, noun, holds):
                if relation in (Relation.ON, Relation.ABOVE) and holds and self.chance(0.4):
                    be = conjugated(self.pick("sits", "rests") if relation is Relation.ON else "lies", plural)
                return f"{be} {self.beside(relation, noun, negated=not holds)}"
            case BesideLike():
                return f"{be} {self.related(trait.relation, self.like(trait))}"

    def look_complement(self, look: Look, plural: bool) -> str:
        """What follows "is": an adjective where that is enough."""
        if look.shape is not None:
            text = self.look(look, plural)
            return text if plural else article(text)
        parts = [] if look.size is None else [self.pick(*SIZE_NAMES[look.size])]
        if len(look.colours) == 2 and not parts and self.chance(0.3):
            return f"either {self.colours(look.colours)}"
        return " and ".join([*parts, *([self.colours(look.colours)] if look.colours else [])])

    def wall(self, trait: AtWall) -> str:
        name = self.style.wall
        if trait.wall is not None:
            return self.pick(*WALL_NAMES[trait.wall]).format(wall=name)
        return article(name) if trait.holds else f"any {name}"

    def place(self, level: Level, plural: bool) -> str:
        tower = f"their {pluralised(self.style.tower)}" if plural else f"a {self.style.tower}"
        match level:
            case Level.TOP:
                return self.pick(f"at the top of {tower}", f"at the very top of {tower}")
            case Level.BOTTOM:
                return self.pick(f"at the bottom of {tower}", f"at the base of {tower}")
            case Level.SECOND | Level.THIRD:
                return self.pick(f"in {level} position from the bottom", f"{level} from the bottom")

    def beside(self, relation: Relation, noun: Noun, *, negated: bool = False) -> str:
        """The relation and its noun: "directly under a blue block"."""
        return self.related(
            relation, f"any {self.noun(noun, plural=False, alone=False)}" if negated else self.some(noun)
        )

    def like(self, trait: BesideLike) -> str:
        """ "another item of the same color" """
        name = ATTRIBUTE_NAMES[trait.attribute]
        if trait.same:
            return f"{self.pick('another', article(self.style.item).split()[0])} {self.style.item} of the same {name}"
        return f"{article(self.style.item)} of {self.pick('a different', 'another')} {name}"

    def related(self, relation: Relation, other: str) -> str:
        same = f"in the same {self.style.tower}" if self.style.item == "block" else "in the same box"
        match relation:
            case Relation.TOUCHING:
                return self.pick(f"touching {other}", f"in contact with {other}")
            case Relation.NEAR:
                return f"touching or almost touching {other}"
            case Relation.ON:
                return f"{self.pick('directly on top of', 'directly on', 'right on top of', 'directly above')} {other}"
            case Relation.UNDER:
                return f"{self.pick('directly under', 'right below', 'directly below', 'right under')} {other}"
            case Relation.ABOVE:
                return f"{self.pick('above', 'somewhere above', 'higher up than')} {other} {same}"
            case Relation.BELOW:
                return f"{self.pick('below', 'somewhere below', 'lower down than')} {other} {same}"

    def share(self, share: Share, total: Quantity, trait: Trait, them: str) -> str:
        """ "both of them touch a wall"; `them` is "them" or "which"."""
        pair = total == Quantity(2, 2)
        if share is Share.ALL and total == Quantity(1, 1):
            return f"{'it' if them == 'them' else 'which'} {self.predicate(trait, plural=False)}"
        if share is Share.ALL:
            return f"{'both' if pair else 'all'} of {them} {self.predicate(trait, plural=True)}"
        if share is Share.NONE:
            return f"{'neither' if pair else 'none'} of {them} {self.predicate(trait, plural=False)}"
        some = "at least one" if share is Share.SOME else f"{self.pick('exactly', 'only', 'just')} one"
        return f"{some} of {them} {self.predicate(trait, plural=False)}"

    # What boxes have

    def possession(self, condition: Condition) -> str:
        """What follows "has" or "with"."""
        items = pluralised(self.style.item)
        match condition:
            case Has(quantity, noun):
                return self.quantified(quantity, noun).text
            case Purely(look):
                return f"{self.pick('only', 'only', 'nothing but')} {self.look(look, plural=True)}"
            case Varied(attribute, quantity):
                return self.variety(attribute, quantity, items)
            case Ends(level, colours):
                return self.end(level, colours)
            case SameEnds(same):
                ends = self.pick("a top and a base", "a base and a top")
                return f"{ends} of {'the same color' if same else 'different colors'}"
            case Sharing(quantity, noun, share, trait):
                return f"{self.quantified(quantity, noun).text}, {self.share(share, quantity, trait, 'which')}"

    def variety(self, attribute: Attribute, quantity: Quantity, items: str) -> str:
        name = ATTRIBUTE_NAMES[attribute]
        if quantity == Quantity(1, 1):
            return f"{items} of {self.pick('a single', 'only one', 'just one')} {name}"
        if quantity == Quantity(3, 3):
            return f"{items} of all three {name}s"
        return f"{items} of {self.different(quantity, name)}"

    def different(self, quantity: Quantity, name: str) -> str:
        """ "exactly two different colors"; at least two is the only range there is."""
        if quantity.high is None:
            many = self.pick("more than one", f"at least {self.number(2)}", f"{self.number(2)} or more")
        else:
            many = self.pick("", "", "exactly ", "only ") + self.number(quantity.low)
        return f"{many} {name}" if many.endswith("one") else f"{many} {self.pick('', 'different ')}{name}s"

    def end(self, level: Level, colours: frozenset[Colour]) -> str:
        colour = self.colours(colours)
        if level is Level.TOP:
            return f"a {colour} {self.pick('top', 'block at the top', 'block on top')}"
        return f"a {colour} {self.pick('base', 'block at the bottom', 'block at the base')}"
