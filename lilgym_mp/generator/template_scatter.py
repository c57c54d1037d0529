"""What people say of scattered shapes, with programs."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from functools import cached_property

from lilgym_mp.generator.lexicon import pluralised
from lilgym_mp.generator.template_boxes import Frames
from lilgym_mp.generator.template_conditions import TWO_COLOURS, Condition, Family, Said, in_box
from lilgym_mp.generator.template_phrases import ANYTHING, SHAPES, Look, Noun, Test, Trait, Voice, items

EXACTLY_CLOSE = ("closely touching", "closely touching", "closely touching", "almost touching", "nearly touching",
                 "very close to", "close to", "near", "close touching")  # fmt: skip
SIDES = {
    "LEFT": ("left",),
    "RIGHT": ("right",),
    "TOP": ("top", "upper"),
    "BOTTOM": ("bottom", "lower"),
}


def scatter_voice(rng: random.Random) -> Voice:
    """How one writer of statements about scattered shapes talks."""
    pick = rng.choice
    return Voice(
        item=pick(("item",) * 8 + ("object",) * 4 + ("shape", "shape", "thing", "figure")),
        tower="",
        box=pick(("box",) * 10 + ("grey box", "gray box", "grey square", "square box", "grey area")),
        wall=pick(("wall",) * 4 + ("edge",) * 4 + ("side", "border")),
        picture=pick(("picture", "image", "picture", "image")),
        digits=rng.random() < 0.4,
        sloppy=rng.random() < 0.2,
    )


class ScatterFrames(Frames):
    """Statements about circles, squares and triangles of three colours and sizes."""

    def families(self) -> Sequence[Family]:
        return self._families

    @cached_property
    def _families(self) -> Sequence[Family]:
        return (
            (6, self.counted), (2, self.total), (0.7, self.number_told), (28, self.with_trait), (6, self.definite),
            (1.5, self.the_only), (2, self.shared), (3, self.every), (1, self.not_every), (1.5, self.only_those),
            (2, self.same_all), (1, self.variety), (2, self.compared), (3, self.joined), (3, self.two_counted),
            (32, self.boxes_with), (3, self.named_box), (1, self.conditional_boxes), (2, self.box_with_definite),
            (1.5, self.touching_pair), (0.7, self.both), (0.6, self.excepted), (0.6, self.mostly), (0.4, self.no_two),
            (1.5, self.in_one_box), (1, self.two_named_boxes), (1.2, self.evenly), (0.8, self.most_of_them),
            (2.5, self.in_box_with), (1.2, self.every_wall),
        )  # fmt: skip

    def look(self) -> Look:
        draw = self.rng.random()
        colours = () if draw < 0.12 else self.one(TWO_COLOURS) if draw > 0.97 else self.colour()
        shape = self.one(SHAPES) if self.chance(0.75) or (not colours and self.chance(0.7)) else None
        size = self.pick("small", "medium", "big", "small", "big") if self.chance(0.12) else None
        return Look(colours, shape, size) if colours or shape or size else Look(self.colour())

    def attribute(self) -> str:
        attribute = self.pick("color", "color", "color", "shape", "shape", "size")
        return "color" if attribute == self.voice.item else attribute

    def look_free_of(self, attribute: str) -> Look:
        draw = self.rng.random()
        if draw < 0.35:
            return Look()
        colours = self.colour() if attribute != "color" and draw < 0.75 else ()
        shape = self.one(SHAPES) if attribute != "shape" and draw > 0.55 else None
        return Look(colours, shape)

    def box_word(self) -> str:
        return self.voice.box

    # Traits

    def trait(self) -> Trait:
        draw = self.rng.random()
        if draw < 0.56:
            return self.wall_trait()
        if draw < 0.7:
            return self.corner_trait()
        if draw < 0.86:
            return self.beside_trait()
        if draw < 0.9:
            return self.height_trait()
        if draw < 0.96:
            index = int(self.rng.random() * 3)
            core = (
                f"in the {self.pick(('left', 'middle', 'right'), ('first', 'second', 'third'))[index]} {self.voice.box}"
            )
            return Trait(core, lambda v: f"{v}.box == all_boxes[{index}]", holds=self.chance(0.9), kind="box")
        return self.alone_trait()

    def touching(self) -> tuple[str, tuple[str, str] | None, bool]:
        """Words for touching, verbs where there are some, and whether almost touching will do."""
        draw = self.rng.random()
        if draw < 0.76:
            words = self.pick("touching", "touching", "touching", "touching", "touching", "in contact with", "against",
                              "attached to", "connected to", "that is touching")  # fmt: skip
            if words == "touching":
                return words, ("touches", "touch"), False
            return (words if words != "that is touching" else "touching"), None, False
        words = self.one(EXACTLY_CLOSE)
        verbs = ("almost touches", "almost touch") if words == "almost touching" else None
        return words, verbs, True

    def wall_trait(self) -> Trait:
        holds = self.chance(0.85)
        touching, verbs, close = self.touching()
        name, side, both = self.wall(holds)
        function = "is_closely_touching_wall" if close else "is_touching_wall"
        core = f"{touching} {name}"
        test: Test
        if both:

            def either(variable: str) -> str:
                return f"({function}({variable}, Side.LEFT) or {function}({variable}, Side.RIGHT))"

            test = either
        else:
            argument = "" if side is None else f", Side.{side}"

            def one(variable: str) -> str:
                return f"{function}({variable}{argument})"

            test = one
        full = (f"{verbs[0]} {name}", f"{verbs[1]} {name}") if verbs else None
        negated = core
        if not holds and core.startswith(f"{touching} a "):
            negated = self.pick(
                core, f"{touching} any {core.removeprefix(f'{touching} a ')}", f"{touching} any of the walls"
            )
        return Trait(core, test, full, holds, negated, kind="wall")

    def wall(self, holds: bool) -> tuple[str, str | None, bool]:
        """A wall's name, which side it is (None: any), and whether left and right will both do."""
        wall, box = self.voice.wall, self.voice.box
        of_box = self.pick("", "", "", f" of a {box}", f" of the {box}", f" of its {box}", " of box")
        draw = self.rng.random()
        if draw < 0.42:
            return self.pick(
                f"the {wall}", f"the {wall}", f"the {wall}", f"a {wall}",
                    f"an {wall}" if wall == "edge" else f"a {wall}",
                f"the {wall}{of_box}", f"a {wall}{of_box}", f"one {wall}", f"one of the {pluralised(wall)}",
                f"the {pluralised(wall)}",
            ).replace("a edge", "an edge"), None, False  # fmt: skip
        if draw < 0.58 and holds:
            part, side, both = self.own_part()
            the = self.pick(f"the {wall}", f"the {wall}", f"a {wall}").replace("a edge", "an edge")
            return f"{the} with its {part}", side, both
        side = self.pick("LEFT", "RIGHT", "BOTTOM", "BOTTOM", "BOTTOM", "TOP", "TOP")
        adjective = self.one(SIDES[side])
        names = [f"the {adjective} {wall}{of_box}"] * 3 + [f"{adjective} {wall}{of_box}"]
        if side == "BOTTOM":
            names += (
                [f"the base{of_box}"] * 2
                + [f"the bottom{of_box}"] * 4
                + ["the floor", "the ground", f"the bottom edge{of_box}"]
            )
        elif side == "TOP":
            names += [f"the top{of_box}"] * 4 + [f"the roof{of_box}", "the ceiling", f"the upper edge{of_box}"]
        else:
            names += [
                f"the {adjective} side{of_box}",
                f"the {adjective} hand side{of_box}",
                f"the {wall} on the {adjective}",
            ]
        return self.one(names), side, False

    def own_part(self) -> tuple[str, str | None, bool]:
        """The part of an item that touches: "top", "left side"."""
        return self.pick(
            ("top", "TOP", False), ("top", "TOP", False), ("tip", "TOP", False), ("base", "BOTTOM", False),
            ("bottom", "BOTTOM", False), ("base", "BOTTOM", False), ("side", None, True), ("side", None, True),
            ("left side", "LEFT", False), ("right side", "RIGHT", False), ("top side", "TOP", False),
            ("bottom side", "BOTTOM", False), ("upper side", "TOP", False),
        )  # fmt: skip

    def corner_trait(self) -> Trait:
        holds = self.chance(0.85)
        draw = self.rng.random()
        of_box = self.pick("", "", "", f" of a {self.voice.box}", f" of the {self.voice.box}")
        if draw < 0.12:
            return self.specific_corner(of_box, holds)
        if draw < 0.55:
            touching = self.pick(
                "touching", "touching", "touching", "in", "in", "sitting in", "placed in", "at", "located in"
            )
            close = False
        else:
            touching, close = self.one(EXACTLY_CLOSE), True
        corner = (
            self.pick("a corner", "the corner", "one corner", "a corner", "the corners", "one of the corners") + of_box
        )
        function = "is_closely_touching_corner" if close else "is_touching_corner"
        negated = f"{touching} {self.pick('a corner', 'the corner', 'any corner')}{of_box}"
        verbs = (f"touches {corner}", f"touch {corner}") if touching == "touching" else None
        return Trait(f"{touching} {corner}", lambda v: f"{function}({v})", verbs, holds, negated, kind="wall")

    def specific_corner(self, of_box: str, holds: bool) -> Trait:
        vertical, horizontal = self.pick("TOP", "BOTTOM"), self.pick("LEFT", "RIGHT")
        joint = self.pick(" ", "-", " ", " hand ")
        first = self.one(SIDES[vertical])
        side = horizontal.lower() + (" hand" if joint == " hand " else "")
        name = f"the {first}{' ' if joint == ' hand ' else joint}{side} corner{of_box}"
        touching = self.pick("in", "touching", "closely touching", "near", "at")
        return Trait(
            f"{touching} {name}",
            lambda v: f"is_closely_touching_specific_corner({v}, Side.{vertical}, Side.{horizontal})",
            holds=holds,
            kind="wall",
        )

    def other_noun(self) -> Noun:
        draw = self.rng.random()
        if draw < 0.12:
            return ANYTHING
        noun = Noun(self.look())
        return noun.also(self.wall_trait()) if draw > 0.94 else noun

    def beside_trait(self) -> Trait:
        touching, _, close = self.touching()
        if not close and self.chance(0.1):
            touching = self.pick("next to", "adjacent to")
        function = "get_closely_touching" if close else "get_touching"
        noun = self.other_noun()
        if noun == ANYTHING and self.chance(0.6):
            other = self.pick(f"another {self.voice.item}", f"any other {self.voice.item}", "something")
            return Trait(
                f"{touching} {other}", lambda v: f"exist({function}({v}))", holds=self.chance(0.8), kind="beside"
            )
        return self.related((touching,), function, noun, holds=self.chance(0.88))

    def height_trait(self) -> Trait:
        words, function = self.pick(
            (("above", "somewhere above", "higher than", "over"), "get_box_all_below"),
            (("below", "under", "underneath", "lower than", "beneath"), "get_box_all_above"),
        )
        return self.related(words, function, self.other_noun(), holds=self.chance(0.9))

    def alone_trait(self) -> Trait:
        """Being the only item of its box."""
        core = self.pick("alone in a box", "alone in its box", "the only item in its box", "the only one in its box",
                         "alone in the box", "by itself in a box")  # fmt: skip
        return Trait(
            core,
            lambda v: f"NOT(exist(get_box_exclusive({v})))",
            holds=True,
            bare=not core.startswith("the"),
            kind="box",
        )

    # Conditions

    def condition(self) -> Condition:
        draw = self.rng.random()
        for share, make in self._conditions:
            draw -= share
            if draw < 0:
                return make()
        return self.has_some()

    @cached_property
    def _conditions(self) -> Sequence[tuple[float, Callable[[], Condition]]]:
        return (
            (0.31, self.has_some), (0.12, lambda: self.total_in_box(8)), (0.15, self.has_traited), (0.06, self.purely),
            (0.07, self.varied), (0.05, self.has_none), (0.035, self.has_compared), (0.035, self.has_total_of_which),
            (0.025, self.all_of_box), (0.03, self.only_item), (0.03, self.two_alike), (0.02, self.two_lots),
            (0.01, self.either), (0.015, self.one_of_each), (0.02, self.just_these), (0.015, self.and_others),
            (0.005, self.no_two_alike),
        )  # fmt: skip

    def two_lots(self) -> Condition:
        """ "both black and yellow items" """
        one, other = self.pick(*TWO_COLOURS)
        shape = self.one((None, None, *SHAPES))
        several = self.plain_noun(Look(shape=shape), plural=True)
        text = self.pick(f"both {one} and {other} {several}", f"{one} and {other} {several}",
                         f"{several} in {one} and {other}")  # fmt: skip
        first, second = Noun(Look((one,), shape)), Noun(Look((other,), shape))

        def test(box: str) -> str:
            return " and ".join(self.has_test(noun, box) for noun in (first, second))

        return Condition(test, text, kind="compared", least=2)

    def has_test(self, noun: Noun, box: str) -> str:
        return f"exist({items(noun, in_box(box))})"

    # Statements

    def touching_pair(self) -> Said:
        """ "two black circles touching each other" """
        look = self.look()
        noun = Noun(look)
        several = self.noun(noun, plural=True)
        joint, close = self.pick(
            ("touching each other", False), ("touching one another", False), ("in contact with each other", False),
            ("closely touching each other", True), ("nearly touching each other", True), ("close to each other", True),
            ("next to each other", False),
        )  # fmt: skip
        function = "get_closely_touching" if close else "get_touching"
        trait = Trait(joint, lambda v: f"exist({items(noun, f'{function}({v})', 'y')})")
        there = self.pick(
            "there are two", "there are 2", "two", f"there is a {self.voice.box} with two", "there are at least two"
        )
        if self.chance(0.2):
            there = self.pick("there are no", "no")
            return Said(f"{there} {several} {joint}", f"NOT(exist({items(noun.also(trait))}))")
        return Said(f"{there} {several} {joint}", f"exist({items(noun.also(trait))})")

    def in_box_with(self) -> Said:
        """ "there is a blue circle in a box with two squares" """
        look = self.look()
        condition = self.pick(lambda: self.total_in_box(6), self.has_some, self.has_none, self.purely, self.varied)()
        while condition.has is None:
            condition = self.has_some()
        box = self.a(self.voice.box)
        with_it = self.described([condition], plural=False)
        core = f"{self.pick('in', 'in', 'in', 'inside')} {box} {with_it}"
        noun = Noun(look, (Trait(core, lambda v: condition.test(f"{v}.box"), kind="box"),))
        return self.saying(self.quantity(3, none=0.06), noun)

    def every_wall(self) -> Said:
        """Items touching two walls, or exactly one."""
        look = self.look()
        wall = self.voice.wall
        two = self.pick(f"two {pluralised(wall)}", f"2 {pluralised(wall)}", f"two {pluralised(wall)} of the box")
        touching = self.pick("touching", "touching", "almost touching")
        function = "is_touching_corner" if touching == "touching" else "is_closely_touching_corner"
        trait = Trait(f"{touching} {two}", lambda v: f"{function}({v})", holds=self.chance(0.9), kind="wall")
        if self.chance(0.35):
            one = self.pick("only one", "exactly one", "just one")

            def test(variable: str) -> str:
                return f"(is_touching_wall({variable}) and NOT(is_touching_corner({variable})))"

            trait = Trait(f"touching {one} {wall}", test, kind="wall")
        return self.saying(self.quantity(3, none=0.06), Noun(look, (trait,)))
