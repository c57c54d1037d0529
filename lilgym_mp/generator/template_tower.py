"""What people say of towers of coloured blocks, with programs."""

from __future__ import annotations

import random
from collections.abc import Sequence
from functools import cached_property

from lilgym_mp.generator.lexicon import pluralised
from lilgym_mp.generator.semantics import NONE, SOME, Quantity
from lilgym_mp.generator.template_boxes import Frames
from lilgym_mp.generator.template_conditions import BOX, TWO_COLOURS, Condition, Family, Said, in_box
from lilgym_mp.generator.template_phrases import (
    ANYTHING,
    Look,
    Noun,
    Phrase,
    Trait,
    Voice,
    exactly,
    filtered,
    items,
    numbered,
)

ON = ("on", "on", "on top of", "above", "above", "over", "over", "directly above", "directly on", "right above",
      "just above", "immediately above", "directly on top of", "sitting on", "resting on", "placed on", "stacked on",
      "directly over", "right on top of")  # fmt: skip
UNDER = ("under", "under", "below", "below", "beneath", "underneath", "directly under", "directly below", "right below",
         "just below", "right under", "immediately below")  # fmt: skip
BESIDE = ("touching", "touching", "attached to", "adjacent to", "next to", "connected to", "in contact with")
FAR_ABOVE = ("somewhere above", "higher than", "anywhere above")
FAR_BELOW = ("somewhere below", "lower than", "anywhere below")
PARTS = {"top": "is_top", "bottom": "is_bottom", "second": "is_second", "third": "is_third"}


def tower_voice(rng: random.Random) -> Voice:
    """How one writer of statements about towers talks."""
    pick = rng.choice
    tower = pick(("tower",) * 12 + ("stack", "stack", "pile", "column"))
    return Voice(
        item=pick(("block",) * 10 + ("item", "item", "item", "brick", "square", "square", "object", "cube")),
        tower=tower,
        box=pick(("box",) * 8 + ("grey box", "gray box", "grey square", "grey area")),
        wall=pick(("wall", "wall", "edge")),
        picture=pick(("picture", "image", "picture", "image")),
        digits=rng.random() < 0.4,
        sloppy=rng.random() < 0.2,
    )


class TowerFrames(Frames):
    """Statements about coloured blocks in towers."""

    most_in_box = 4

    def families(self) -> Sequence[Family]:
        return self._families

    @cached_property
    def _families(self) -> Sequence[Family]:
        return (
            (5, self.counted), (2, self.total), (0.5, self.number_told), (10, self.with_trait), (3, self.definite),
            (1.5, self.the_only), (2, self.shared), (2.5, self.every), (1, self.not_every), (1, self.only_those),
            (1.5, self.same_all), (1, self.variety), (2, self.compared), (3, self.joined), (3, self.two_counted),
            (34, self.boxes_with), (3, self.named_box), (1, self.conditional_boxes), (3, self.box_with_definite),
            (9, self.in_tower), (3, self.pile), (3, self.ends_told), (3, self.towers_alike), (1.5, self.touching_pair),
            (1.5, self.taller), (0.7, self.both), (0.5, self.excepted), (0.5, self.mostly), (0.4, self.no_two),
            (1, self.in_one_box), (1.5, self.two_named_boxes), (1.2, self.evenly), (0.8, self.most_of_them),
            (2, self.coloured_towers), (1.5, self.order_told),
        )  # fmt: skip

    def look(self) -> Look:
        return Look(self.colour() if self.chance(0.94) else self.one(TWO_COLOURS))

    def attribute(self) -> str:
        return "color"

    def look_free_of(self, attribute: str) -> Look:
        return Look()

    def box_word(self) -> str:
        return self.voice.box if self.chance(0.25) else self.voice.tower

    # Traits

    def trait(self) -> Trait:
        draw = self.rng.random()
        if draw < 0.38:
            return self.place_trait()
        if draw < 0.66:
            return self.stacked_trait()
        if draw < 0.74:
            return self.between_trait()
        if draw < 0.8:
            return self.height_trait()
        if draw < 0.86:
            return self.floor_trait()
        if draw < 0.92:
            return self.beside_trait()
        index = int(self.rng.random() * 3)
        core = f"in the {('left', 'middle', 'right')[index]} {self.box_word()}"
        return Trait(core, lambda v: f"{v}.box == all_boxes[{index}]", holds=self.chance(0.85), kind="box")

    def place_trait(self) -> Trait:
        part = self.pick("top", "top", "top", "bottom", "bottom", "bottom", "second", "third")
        core = self.place_words(part)
        told = core.removeprefix("as ") if core.startswith("as ") else None
        holds = part in ("second", "third") or self.chance(0.9)
        if not holds:
            core = core.removeprefix("as ")
        return Trait(core, lambda v: f"{PARTS[part]}({v})", holds=holds, kind="place", told=told)

    def place_words(self, part: str) -> str:
        tower = self.voice.tower
        a, the = self.a(tower), f"the {tower}"
        match part:
            case "top":
                return self.pick(
                    "on top", "at the top", "on the top", f"on top of {a}", f"at the top of {a}",
                        f"at the top of {the}",
                    f"on the top of {a}", "as the top", f"as the top of {a}", "at top", f"on top of {the}",
                    "at the top most position", f"at the very top of {a}",
                )  # fmt: skip
            case "bottom":
                return self.pick(
                    "at the base", "at the bottom", f"at the base of {a}", f"at the bottom of {a}", "as the base",
                    f"as the base of {a}", f"as base of {a}", f"at the base of {the}", "on the bottom", "as base",
                    f"at the bottom of {the}", f"as the base of {the}", "at the very bottom", "in the base",
                )  # fmt: skip
            case "second":
                return self.pick("second from the bottom", "in second position from the bottom", "second from the base",
                                 "in the second place from the bottom", "at the second level", "in second position",
                                 f"second from the bottom of {a}", "as the second block from the base")  # fmt: skip
            case _:
                return self.pick("third from the bottom", "in third position from the bottom", "third from the base",
                                 "at the third level", "in third position",
                                     "as the third block from the base")  # fmt: skip

    def block(self) -> Noun:
        """What another block lies on."""
        draw = self.rng.random()
        return ANYTHING if draw < 0.08 else Noun(Look(self.colour()))

    def stacked_trait(self) -> Trait:
        holds = self.chance(0.93)
        draw = self.rng.random()
        if draw < 0.06:
            return self.related(FAR_ABOVE, "get_box_all_below", self.block(), holds=holds)
        if draw < 0.1:
            return self.related(FAR_BELOW, "get_box_all_above", self.block(), holds=holds)
        noun = self.block()
        if draw < 0.65:
            if holds and self.chance(0.15):
                noun = noun.also(self.related(ON, "get_below", self.block()))
            return self.related(ON, "get_below", noun, holds=holds)
        return self.related(UNDER, "get_above", noun, holds=holds)

    def beside_trait(self) -> Trait:
        return self.related(BESIDE, "get_touching", self.block(), holds=self.chance(0.9))

    def between_trait(self) -> Trait:
        one, other = Noun(Look(self.colour())), Noun(Look(self.colour()))

        def test(variable: str) -> str:
            def side(function: str, noun: Noun) -> str:
                return f"exist({items(noun, f'{function}({variable})', 'y' if variable == 'x' else 'z')})"

            above, below = side("get_above", one), side("get_below", one)
            if one == other:
                return f"({above} and {below})"
            crossed = f"{side('get_above', other)} and {side('get_below', one)}"
            return f"({above} and {side('get_below', other)} or {crossed})"

        if one == other:
            core = self.pick(
                f"between {self.number(2)} {self.noun(one, True)}",
                    f"in between {self.number(2)} {self.noun(one, True)}",
                f"sandwiched between two {self.noun(one, True)}", f"between {self.noun(one, True)}",
            )  # fmt: skip
        else:
            first, second = self.some(one), self.some(other)
            core = self.pick(f"between {first} and {second}", f"in between {first} and {second}",
                             f"in the middle of {first} and {second}")  # fmt: skip
        return Trait(core, test, kind="between")

    def height_trait(self) -> Trait:
        """ "in a tower of three blocks" """
        condition = self.height()
        tower = self.a(self.voice.tower)
        how = condition.after if condition.after else f"with {condition.has}"
        inside = self.pick("in", "in", "inside", "part of")
        return Trait(f"{inside} {tower} {how}", lambda v: condition.test(f"{v}.box"), kind="box")

    def floor_trait(self) -> Trait:
        floor = self.pick("the wall", "the wall", f"the {self.voice.wall}", "the floor", "the ground", "the base",
                          f"the bottom {self.voice.wall}", f"a {self.voice.wall}",
                              f"the bottom of the {self.voice.box}",
                          f"the base of the {self.voice.box}", f"the bottom of a {self.voice.box}")  # fmt: skip
        bottom = ("wall" not in floor and "edge" not in floor) or "bottom" in floor
        side = ", Side.BOTTOM" if bottom else ""
        return Trait(f"touching {floor}", lambda v: f"is_touching_wall({v}{side})",
                     (f"touches {floor}", f"touch {floor}"), self.chance(0.85), kind="place")  # fmt: skip

    # Conditions

    def condition(self) -> Condition:
        draw = self.rng.random()
        for share, make in self._conditions:
            draw -= share
            if draw < 0:
                return make()
        return self.has_some()

    @cached_property
    def _conditions(self):
        return (
            (0.17, self.has_some), (0.19, self.height), (0.21, self.end), (0.06, self.purely), (0.06, self.varied),
            (0.04, self.has_none), (0.05, self.stacked_condition), (0.03, self.has_compared), (0.03, self.same_ends),
            (0.02, self.has_total_of_which), (0.015, self.only_item), (0.015, self.two_alike), (0.03, self.two_ends),
            (0.01, self.alternating), (0.04, self.with_more_on_it), (0.01, self.either), (0.015, self.one_of_each),
            (0.02, self.just_these), (0.02, self.and_others), (0.005, self.no_two_alike), (0.01, self.between_alike),
        )  # fmt: skip

    def height(self) -> Condition:
        number = self.pick(1, 1, 2, 2, 2, 3, 3, 3, 4, 4)
        quantity = exactly(number)
        draw = self.rng.random()
        if draw < 0.12 and 1 < number < 4:
            quantity = Quantity(number, None)
        elif draw < 0.17 and 1 < number < 4:
            quantity = Quantity(0, number)
        text = self.quantified(quantity, ANYTHING).text
        number_text = self.number(number)
        after = None
        verbs = None
        if quantity == exactly(number):
            several = f"{number_text} {self.noun(ANYTHING, number > 1)}"
            after = self.pick(None, None, f"of {several}", f"of {number_text}", f"made of {several}",
                              f"made up of {several}", f"consisting of {several}", f"of height {number_text}",
                              f"that is {several} {self.pick('high', 'tall')}", f"built of {several}")  # fmt: skip
            verbs = self.pick(
                None, (f"is {several} high", f"are {several} high"), (f"is {several} tall", f"are {several} tall"),
                (f"is made up of {several}", f"are made up of {several}"), (f"consists of {several}",
                    f"consist of {several}"),
            )  # fmt: skip
        return Condition(lambda box: numbered(quantity, in_box(box)), text, after, verbs, kind="total",
                         least=quantity.low, most=quantity.high)  # fmt: skip

    def part_items(self, box: str, part: str, look: Look) -> str:
        return filtered(in_box(box), (*look.tests(), lambda v: f"{PARTS[part]}({v})"))

    def end(self) -> Condition:
        """ "a black base", "a blue block on top", "a yellow block in the middle" """
        part = self.pick("top", "top", "top", "bottom", "bottom", "bottom", "second", "third", "middle")
        look = Look(self.colour())
        if part == "middle":
            return self.middle(look)
        block, colour = self.some(Noun(look)), look.colours[0]
        names = {
            "top": ("top", "top block", "top most block"),
            "bottom": ("base", "bottom", "bottom block", "base block"),
        }
        place = self.place_words(part) if part not in names else self.end_place(part)
        has = f"{block} {place}"
        if part == "second" and self.chance(0.4):
            has = self.pick(f"{block} as the second block", f"{colour} as the second block", f"a {colour} second block")
        verbs = None
        if part in names:
            name = self.one(names[part])
            item = self.voice.item
            has = self.pick(
                has, has, has, f"{self.a(colour)} {name}", f"{colour} {name}", f"{block} as the {name}",
                f"{block} as its {name}", f"{block} as {name}", f"the {name} as {colour}",
                f"{colour} as the {name}", f"{colour} {item} as {name}", f"the {colour} {item} {place}",
                f"{self.a(colour)} {name} {item}" if len(name) < 7 else f"{self.a(colour)} {name}",
                f"{colour} {item} {place}", f"exactly one {colour} {item} {place}",
            )  # fmt: skip
            verbs = self.pick(
                None, None, None, (f"ends with {block}", f"end with {block}") if part == "top" else
                (f"starts with {block}", f"start with {block}"),
                (f"is topped with {block}", f"are topped with {block}") if part == "top" else None,
            )  # fmt: skip
        return Condition(lambda box: numbered(SOME, self.part_items(box, part, look)), has, verbs=verbs,
                         kind=part, look=look, least={"second": 2, "third": 3}.get(part, 1))  # fmt: skip

    def end_place(self, part: str) -> str:
        if part == "top":
            return self.pick("on top", "at the top", "on the top", "as the top", "at top", "on its top", "at its top")
        return self.pick("at the base", "at the bottom", "as the base", "as base", "on the bottom", "in the base",
                         "at its base", "as its base", "at the very bottom", "in the bottom")  # fmt: skip

    def middle(self, look: Look) -> Condition:
        """The middle one of three blocks."""
        block, colour, item = self.some(Noun(look)), look.colours[0], self.voice.item
        has = self.pick(f"{block} in the middle", f"{block} as the middle {item}", f"{colour} in the middle",
                        f"{self.a(colour)} {item} as a middle {item}", f"{self.a(colour)} middle {item}",
                        f"{block} in between")  # fmt: skip
        return Condition(
            lambda box: f"count({in_box(box)}) == 3 and exist({self.part_items(box, 'second', look)})", has,
            kind="middle", least=3, most=3,
        )  # fmt: skip

    def two_ends(self) -> Condition:
        """ "a black top and a yellow base" """
        top, base = Look(self.colour()), Look(self.colour())
        if top == base:
            colour = top.colours[0]
            has = self.pick(f"{self.noun(Noun(top), True)} on the top and at the base",
                f"{colour} base and {colour} top",
                            f"both top and base {colour}",
                                f"{colour} {pluralised(self.voice.item)} at both ends")  # fmt: skip
        else:
            has = self.pick(
                f"{top.colours[0]} top and {base.colours[0]} base",
                f"{self.a(base.colours[0])} base and {self.a(top.colours[0])} top",
                f"{self.some(Noun(base))} at the base and {self.some(Noun(top))} at the top",
                f"{self.some(Noun(top))} on top and {self.some(Noun(base))} at the bottom",
            )

        def test(box: str) -> str:
            above = numbered(SOME, self.part_items(box, "top", top))
            return f"{above} and {numbered(SOME, self.part_items(box, 'bottom', base))}"

        return Condition(test, has, kind="ends")

    def same_ends(self) -> Condition:
        same = self.chance(0.65)
        ends = self.pick("the top and the base", "a top and a base", "top and base", "base and top",
            "the base and the top",
                         "the top and bottom blocks")  # fmt: skip
        what = self.pick("of the same color", "in the same color", "with the same color") if same else self.pick(
            "of different colors", "in different colors")  # fmt: skip
        verb = (
            ("has the same color", "have the same color") if same else ("has different colors", "have different colors")
        )
        verbs = (
            (f"{verb[0]} at the top and the base", f"{verb[1]} at the top and the base") if self.chance(0.3) else None
        )

        def test(box: str) -> str:
            both = f"filter_obj({in_box(box)}, lambda x: is_top(x) or is_bottom(x))"
            return f"ge(count({in_box(box)}), 2) and {'' if same else 'not '}all_same_color({both})"

        return Condition(test, f"{ends} {what}", verbs=verbs, kind="same ends", least=2)

    def stacked_condition(self) -> Condition:
        noun = Noun(Look(self.colour()), (self.pick(self.stacked_trait, self.stacked_trait, self.between_trait)(),))
        quantity = SOME if self.chance(0.85) else self.pick(exactly(1), exactly(2))
        return self.has_condition(quantity, noun)

    def alternating(self) -> Condition:
        item = pluralised(self.voice.item)
        has = self.pick("alternating colors", f"{item} of alternating colors", f"{item} in alternating colors",
                        f"no two adjacent {item} of the same color",
                            f"no two {item} of the same color touching")  # fmt: skip
        return Condition(
            lambda box: (
                f"ge(count({in_box(box)}), 2) and NOT(exist(filter_obj({in_box(box)}, "
                "lambda x: exist(filter_obj(get_below(x), lambda y: y.color == x.color)))))"
            ),
            has, kind="alternating", least=2,
        )  # fmt: skip

    def with_more_on_it(self) -> Condition:
        """ "a black item touching the wall and two blue items on top of it" """
        look, other = Look(self.colour()), self.pick(ANYTHING, Noun(Look(self.colour())), Noun(Look(self.colour())))
        trait = self.pick(None, self.floor_trait(), self.floor_trait(), self.place_trait())
        traits = () if trait is None or not trait.holds or "top" in trait.core else (trait,)
        first = Noun(look, traits)
        quantity = self.pick(SOME, SOME, exactly(1), exactly(2), exactly(2), Quantity(2, None), NONE)
        above = self.chance(0.8)
        it = self.pick("it", "it", "it", "that", f"that {self.voice.item}")
        words = self.pick(
            f"on top of {it}", f"on top of {it}", f"above {it}", f"over {it}", f"on {it}", f"directly above {it}",
        ) if above else self.pick(f"below {it}", f"under {it}", f"beneath {it}", f"underneath {it}")  # fmt: skip
        joint = "but" if quantity == NONE and self.chance(0.3) else "and"
        text = f"{self.some(first)} {joint} {self.quantified(quantity, other).text} {words}"
        direct = words.startswith("directly")
        related = ("get_above" if direct else "get_box_all_above") if above else "get_box_all_below"
        more = numbered(quantity, items(other, f"{related}(x)", "y"))

        def test(box: str) -> str:
            own = " and ".join(part("x") for part in first.tests())
            return f"exist(filter_obj({in_box(box)}, lambda x: {own} and {more}))"

        return Condition(test, text, kind="pile", least=2)

    def between_alike(self) -> Condition:
        """ "a black item between two items of the same color" """
        noun = Noun(Look(self.colour()))
        several = pluralised(self.voice.item)
        between = self.pick("between", "in between", "sandwiched between")
        same = self.pick("the same", "the same", "same")
        text = f"{self.some(noun)} {between} {self.number(2)} {several} of {same} color"
        more, more_text = self.pick(("", ""), ("", ""), (" and NOT(exist(get_above(y)))", "top"))
        neighbours = (
            "exist(filter_obj(get_above(x), lambda y: exist(filter_obj(get_below(x), lambda z: z.color == y.color))"
        )
        if more_text:
            text += self.pick(f" and no {self.voice.item} on top of that", f" and no {self.voice.item} above that",
                              f" and no {self.voice.item} on top of them")  # fmt: skip

        def test(box: str) -> str:
            return f"exist(filter_obj({in_box(box)}, lambda x: {noun.tests()[0]('x')} and {neighbours}{more})))"

        return Condition(test, text, kind="pile", least=3)

    # Statements

    def in_tower(self) -> Said:
        """ "there is a black block at the base of a tower with four blocks" """
        part = self.pick("top", "top", "bottom", "bottom", "any", "second")
        look, condition = (
            Look(self.colour()),
            self.pick(self.height, self.height, self.end, self.purely, self.has_some)(),
        )
        if condition.has is None:
            condition = self.height()
        tower = self.a(self.voice.tower)
        described = self.described([condition], plural=False)
        place = {"top": ("at the top of", "on top of", "on the top of", "as the top of", "at top of"),
                 "bottom": ("at the base of", "at the bottom of", "as the base of", "as base of"),
                 "second": ("as the second block of", "second from the bottom of"),
                 "any": ("in", "in", "inside")}[part]  # fmt: skip
        core = f"{self.one(place)} {tower} {described}"
        told = core.removeprefix("as ") if core.startswith("as ") else None

        def test(variable: str) -> str:
            own = [] if part == "any" else [f"{PARTS[part]}({variable})"]
            return " and ".join([*own, f"{variable}.box.is_tower()", condition.test(f"{variable}.box")])

        noun = Noun(look, (Trait(core, test, told=told),))
        quantity = self.quantity(3, none=0.05)
        return self.saying(quantity if quantity != Quantity(3, None) else SOME, noun)

    def ends_told(self) -> Said:
        """ "the base of the tower with two blocks is yellow" """
        part = self.pick("top", "bottom", "bottom", "middle")
        look, condition = Look(self.colour()), self.height() if self.chance(0.8) else self.has_some()
        tower, colour = self.voice.tower, look.colours[0]
        if part == "middle":
            one = self.middle(look)
            blocks = pluralised(self.voice.item)
            text = self.pick(f"the middle {self.voice.item} of {self.a(tower)} with three {blocks} is {colour}",
                             f"the middle {self.voice.item} in one of the {pluralised(tower)} is {colour}",
                             f"the middle {self.voice.item} of {self.a(tower)} is {colour}",
                             f"the {self.voice.item} in the middle of {self.a(tower)} is {colour}")  # fmt: skip
            return Said(text, f"exist(filter_obj(all_boxes, lambda {BOX}: {BOX}.is_tower() and {one.test(BOX)}))")
        name = self.pick("top", "top block", "block on top") if part == "top" else self.pick(
            "base", "base", "bottom", "bottom block", "base block")  # fmt: skip
        every = self.chance(0.25)
        look_test = numbered(SOME, self.part_items(BOX, part, look))
        if every:
            plural = {"block on top": "blocks on top"}.get(name, pluralised(name))
            text = self.pick(
                f"the {plural} of all the {pluralised(tower)} are {colour}",
                f"all the {pluralised(tower)} have {self.a(colour)} {name}",
                f"the {name} of every {tower} is {colour}",
                f"the {name} of each {tower} is {colour}",
                f"all {plural} are {colour}",
                f"every {tower} has {self.some(Noun(look))} {self.end_place(part)}",
            )
            return Said(text, f"All(filter_obj(all_boxes, lambda {BOX}: {BOX}.is_tower()), lambda {BOX}: {look_test})")
        if condition.has is None:
            condition = self.height()
        described = self.described([condition], plural=False)
        the = self.pick("the", "the", "a")
        text = self.pick(
            f"the {name} of {the} {tower} {described} is {colour}",
            f"{the} {tower} {described} has {self.a(colour)} {name}",
            f"{the} {tower} {described} has {self.some(Noun(look))} {self.end_place(part)}",
        )
        tests = f"{BOX}.is_tower() and {condition.test(BOX)} and {look_test}"
        return Said(text, f"exist(filter_obj(all_boxes, lambda {BOX}: {tests}))")

    def pile(self) -> Said:
        """Colours of a tower from top to bottom, or a pile within one."""
        number = self.pick(2, 2, 3, 3, 4)
        colours = [self.colour()[0] for _ in range(number)]
        if self.chance(0.5):
            return self.whole_pile(colours)
        nouns = [Noun(Look((colour,))) for colour in colours]
        lowest = nouns[-1]
        for noun in reversed(nouns[:-1]):
            lowest = noun.also(self.related(ON, "get_below", lowest))
        return self.saying(self.pick(SOME, SOME, SOME, exactly(1), NONE), lowest)

    def whole_pile(self, colours: Sequence[str]) -> Said:
        """All colours of a tower, from top to bottom."""
        tower, item = self.voice.tower, pluralised(self.voice.item)
        upwards = self.chance(0.4)
        order = [*reversed(colours)] if upwards else [*colours]
        direction = self.pick("from the bottom to the top", "from bottom to top",
            "from base to top") if upwards else self.pick(
            "from top to bottom", "from the top to the bottom", "from top to base")  # fmt: skip
        named = self.pick(", ".join(order), f"{', '.join(order[:-1])} and {order[-1]}", " then ".join(order))
        text = self.pick(
            f"{self.pick('there is a', 'one of the towers is a', 'there is one')} {tower} that is {named} {direction}",
            f"there is a {tower} with {item} that are {named} {direction}",
            f"{self.a(tower)} is {named} {direction}",
            f"{self.a(tower)} has {named} {item} {direction}",
        ).replace("one of the towers is a ", f"one of the {pluralised(tower)} is a ")
        parts = ("bottom", "second", "third")
        tests = [f"count({in_box(BOX)}) == {len(colours)}"]
        for place, colour in enumerate(reversed(colours)):
            part = "top" if place == len(colours) - 1 else parts[place]
            tests.append(numbered(SOME, self.part_items(BOX, part, Look((colour,)))))
        program = f"exist(filter_obj(all_boxes, lambda {BOX}: {BOX}.is_tower() and {' and '.join(tests)}))"
        if "there is one " in text:
            program = program.replace("exist(filter_obj(all_boxes", "count(filter_obj(all_boxes", 1) + " == 1"
        return Said(text, program)

    def towers_alike(self) -> Said:
        """Towers of the same height, with tops or bases of one colour."""
        several = pluralised(self.voice.tower)
        what = self.pick("height", "height", "top", "base", "base")
        if self.chance(0.5):
            return self.all_towers_alike(what, several)
        two = self.pick("two", "2", "at least two", "at least 2", "exactly two", "exactly 2", "only two")
        words = {
            "height": ("of the same height", "with the same height", "that have the same height",
                       f"with the same number of {pluralised(self.voice.item)}", "of same height", "of equal height"),
            "top": ("with the same color top", "with the same top color", "with tops of the same color",
                    "with the same color at the top", "that have the same color on top"),
            "base": ("with the same color base", "with the same base color", "with bases of the same color",
                     "with the same color at the base", "that have the same color at the bottom"),
        }[what]  # fmt: skip
        text = f"there {self.be(True)} {two} {several} {self.one(words)}"
        return Said(text, self.pairs_alike(what, exact=two.startswith(("exactly", "only"))))

    def pairs_alike(self, what: str, *, exact: bool) -> str:
        """Two towers being alike; `exact`: not all three are."""
        if what == "height":
            same = "count(p[0].all_items_in_box()) == count(p[1].all_items_in_box())"
        else:
            part = PARTS["top" if what == "top" else "bottom"]
            same = (
                f"query_color(filter_obj(p[0].all_items_in_box(), lambda x: {part}(x))) == "
                f"query_color(filter_obj(p[1].all_items_in_box(), lambda x: {part}(x)))"
            )
        pairs = f"filter_obj(combinations(filter_obj(all_boxes, lambda b: b.is_tower()), 2), lambda p: {same})"
        return f"count({pairs}) == 1" if exact else f"exist({pairs})"

    def all_towers_alike(self, what: str, several: str) -> Said:
        tower = self.voice.tower
        same = self.chance(0.75)
        subject = self.pick(f"all {several}", f"all the {several}", f"all three {several}", f"the {several}",
                            f"the three {several}", f"every {tower}", f"each of the {several}")  # fmt: skip
        plural = not subject.startswith(("every", "each"))
        name = {"height": self.pick("height", f"number of {pluralised(self.voice.item)}"),
                "top": self.pick("color at the top", "top color", "color on top"),
                "base": self.pick("color at the base", "base color", "color base",
                    "color at the bottom")}[what]  # fmt: skip
        if not same:
            subject = self.pick(f"not all {several}", f"not all the {several}", f"not all of the {several}")
            plural = True
        text = f"{subject} {self.verb('has', plural)} {self.pick('the same', 'the same', 'same')} {name}"
        if what != "height":
            ends = f"filter_obj(all_items, lambda x: {PARTS['top' if what == 'top' else 'bottom']}(x))"
            return Said(text, f"all_same_color({ends})" if same else f"ge(count(get_set_colors({ends})), 2)")
        three = same and "three" in subject
        towers = "all_boxes" if three else "filter_obj(all_boxes, lambda b: b.is_tower())"
        test = f"all_same_attribute({towers}, lambda b: count(b.all_items_in_box()))"
        if three:
            return Said(text, f"All(all_boxes, lambda b: b.is_tower()) and {test}")
        return Said(text, test if same else f"NOT({test})")

    def touching_pair(self) -> Said:
        """ "two black blocks touching each other" """
        look = Look(self.colour())
        joint = self.pick("touching each other", "stacked together", "on top of each other", "touching one another",
                          "next to each other", "stacked on top of each other", "attached to each other",
                          "one above the other", "stacked directly on each other")  # fmt: skip
        several, look_test = self.noun(Noun(look), True), look.tests()[0]
        draw = self.rng.random()
        if draw > 0.75:
            text = self.existential_words(f"two {pluralised(self.voice.item)} of the same color {joint}")
            same = "exist(filter_obj(get_below(x), lambda y: y.color == x.color))"
            return Said(text, f"exist(filter_obj(all_items, lambda x: {same}))")
        below = f"exist({items(Noun(look), 'get_below(x)', 'y')})"
        number = self.pick("two", "2")
        if draw > 0.5:
            number = self.pick("three", "3")
            lower = f"exist({items(Noun(look), 'get_below(y)', 'z')})"
            below = f"exist(filter_obj(get_below(x), lambda y: {look_test('y')} and {lower}))"
        text = self.existential_words(f"{number} {several} {joint}")
        return Said(text, f"exist(filter_obj(all_items, lambda x: {look_test('x')} and {below}))")

    def existential_words(self, text: str) -> str:
        return self.pick(
            f"there are {text}", f"there is a {self.voice.tower} with {text}",
                f"one of the {pluralised(self.voice.tower)} has {text}",
            f"there are {text}", f"there is a {self.voice.box} with {text}", text,
        )  # fmt: skip

    def taller(self) -> Said:
        """ "the left tower is taller than the right one" """
        one, other = self.rng.sample(range(3), 2)
        order, words = self.pick(
            (">", ("taller", "higher")), ("<", ("shorter", "smaller", "lower")), ("==", ("as tall",))
        )
        names = ("left", "middle", "right") if self.chance(0.7) else ("first", "second", "third")
        first, second = (
            f"the {names[one]} {self.voice.tower}",
            f"the {names[other]} {self.pick('one', self.voice.tower)}",
        )
        linking = "as" if order == "==" else "than"
        text = f"{first} is {self.one(words)} {linking} {second}"
        if self.chance(0.3):
            more = {">": "more", "<": "fewer", "==": "as many"}[order]
            text = f"{first} has {more} {pluralised(self.voice.item)} {linking} {second}"
        counts = [f"count(all_boxes[{index}].all_items_in_box())" for index in (one, other)]
        towers = f"all_boxes[{one}].is_tower() and all_boxes[{other}].is_tower()"
        return Said(text, f"{towers} and {counts[0]} {order} {counts[1]}")

    def coloured_towers(self) -> Said:
        """ "there is a black tower with two blocks" """
        colour = self.colour()[0]
        tower = self.voice.tower
        quantity = self.pick(SOME, SOME, SOME, exactly(1), exactly(2), Quantity(2, None), NONE)
        words = self.determiner(quantity)
        name = self.pick(f"{colour} {tower}", f"{colour} {tower}", f"all {colour} {tower}", f"fully {colour} {tower}",
                         f"completely {colour} {tower}", f"{colour} colored {tower}")  # fmt: skip
        name = pluralised(name) if words.plural else name
        named = Phrase(self.a(name) if words.text == "a" else f"{words.text} {name}", words.plural)
        test = f"{BOX}.is_tower() and All({in_box(BOX)}, lambda x: is_{colour}(x))"
        if self.chance(0.5):
            condition = self.height()
            test += f" and {condition.test(BOX)}"
            named = Phrase(f"{named.text} {self.described([condition], words.plural)}", words.plural)
        if quantity == SOME and self.chance(0.2):
            named = Phrase(
                f"one of the {pluralised(tower)} is {self.pick('all ', 'only ', 'completely ', '')}{colour}", False
            )
            test = f"{BOX}.is_tower() and All({in_box(BOX)}, lambda x: is_{colour}(x))"
            return Said(named.text, f"exist(filter_obj(all_boxes, lambda {BOX}: {test}))")
        return Said(self.existential(named), numbered(quantity, f"filter_obj(all_boxes, lambda {BOX}: {test})"))

    def order_told(self) -> Said:
        """ "the second block of a tower is black", "the first block is yellow and the second is blue" """
        item, tower = self.voice.item, self.voice.tower
        places = (("bottom", ("first", "lowest", "bottom")), ("second", ("second",)), ("third", ("third",)),
                  ("top", ("top", "top most", "uppermost", "last")))  # fmt: skip
        number = self.pick(1, 1, 2)
        chosen = sorted(self.rng.sample(range(4), number))
        from_base = self.pick("", " from the bottom", " from the base")
        told: list[str] = []
        tests: list[str] = []
        for index in chosen:
            part, names = places[index]
            look = Look(self.colour())
            after = from_base if part in ("second", "third") else ""
            told.append(f"the {self.one(names)} {item}{after} is {look.colours[0]}")
            tests.append(numbered(SOME, self.part_items(BOX, part, look)))
        somewhere = self.pick(f"in a {tower}", f"in one of the {pluralised(tower)}", f"in one {tower}")
        text = f"{somewhere} {' and '.join(told)}"
        if number == 1 and self.chance(0.6):
            first = told[0].rsplit(" is ", 1)
            of_tower = self.pick(
                f"of a {tower}", f"in a {tower}", f"of one of the {pluralised(tower)}", f"of one {tower}"
            )
            text = f"{first[0]} {of_tower} is {first[1]}"
        program = f"exist(filter_obj(all_boxes, lambda {BOX}: {BOX}.is_tower() and {' and '.join(tests)}))"
        return Said(text, program)
