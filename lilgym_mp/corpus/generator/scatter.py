"""Synchronous templates for Scatter: statements about shapes anywhere in the boxes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from lilgym_mp.corpus.generator.boxes import StatementTemplates
from lilgym_mp.corpus.generator.conditions import TWO_COLOURS, ConditionTemplate, WeightedCondition, WeightedTemplate
from lilgym_mp.corpus.generator.lexicon import pluralised
from lilgym_mp.corpus.generator.phrases import (
    ANYTHING,
    SHAPES,
    AttributeWords,
    NounTemplate,
    PredicateTemplate,
    TrainingPair,
    box_items,
    item_set,
)

NEAR_WORDS = (
    "closely touching", "closely touching", "closely touching", "almost touching", "nearly touching", "very close to",
    "close to", "near", "close touching",
)  # fmt: skip
SIDES = {
    "LEFT": ("left",),
    "RIGHT": ("right",),
    "TOP": ("top", "upper"),
    "BOTTOM": ("bottom", "lower"),
}


class ScatterTemplates(StatementTemplates):
    """Statements about circles, squares and triangles of three colours and sizes."""

    style_words = {
        "item": ("item",) * 8 + ("object",) * 4 + ("shape", "shape", "thing", "figure"),
        "box": ("box",) * 10 + ("grey box", "gray box", "grey square", "square box", "grey area"),
        "wall": ("wall",) * 4 + ("edge",) * 4 + ("side", "border"),
    }

    @cached_property
    def weighted_statements(self) -> Sequence[WeightedTemplate]:
        return (
            (6, self.item_count), (2, self.total_count), (0.7, self.number_is), (28, self.items_with_predicate),
            (6, self.definite), (1.5, self.only_item_with_predicate), (2, self.partitive_count), (3, self.every_item),
            (1, self.not_every_item), (1.5, self.only_these), (2, self.shared_value), (1, self.scene_variety),
            (2, self.count_comparison), (3, self.compound), (3, self.two_item_counts), (32, self.box_count),
            (3, self.named_box), (1, self.every_box_with), (2, self.definite_box), (1.5, self.touching_pair),
            (0.7, self.both_items), (0.6, self.all_but_some), (0.6, self.most_items), (0.4, self.no_two_items_alike),
            (1.5, self.items_in_same_box), (1, self.two_adjacent_boxes), (1.2, self.equal_counts),
            (0.8, self.largest_box), (2.5, self.item_in_box), (1.2, self.two_walls),
        )  # fmt: skip

    def attributes(self) -> AttributeWords:
        draw = self.rng.random()
        colours = () if draw < 0.12 else self.choice(TWO_COLOURS) if draw > 0.97 else self.colour()
        shape = self.choice(SHAPES) if self.chance(0.75) or (not colours and self.chance(0.7)) else None
        size = self.pick("small", "medium", "big", "small", "big") if self.chance(0.12) else None
        return AttributeWords(colours, shape, size) if colours or shape or size else AttributeWords(self.colour())

    def attribute_name(self) -> str:
        attribute = self.pick("color", "color", "color", "shape", "shape", "size")
        return "color" if attribute == self.style.item else attribute

    def attributes_without(self, attribute: str) -> AttributeWords:
        draw = self.rng.random()
        if draw < 0.35:
            return AttributeWords()
        colours = self.colour() if attribute != "color" and draw < 0.75 else ()
        shape = self.choice(SHAPES) if attribute != "shape" and draw > 0.55 else None
        return AttributeWords(colours, shape)

    def box_word(self) -> str:
        return self.style.box

    # Predicates

    def predicate(self) -> PredicateTemplate:
        return self.drawn(
            (0.56, self.wall_predicate), (0.7, self.corner_predicate), (0.86, self.beside_predicate),
            (0.9, self.height_predicate), (0.96, self.box_predicate), (1, self.only_in_box_predicate),
        )()  # fmt: skip

    def box_predicate(self) -> PredicateTemplate:
        index = int(self.rng.random() * 3)
        name = self.pick(("left", "middle", "right"), ("first", "second", "third"))[index]
        return PredicateTemplate(
            f"in the {name} {self.style.box}", f"@.box == all_boxes[{index}]", positive=self.chance(0.9), kind="box"
        )

    def touching_words(self) -> tuple[str, tuple[str, str] | None, bool]:
        """Words for touching, their verb forms if any, and whether they include almost touching."""
        draw = self.rng.random()
        if draw < 0.76:
            words = self.pick(
                "touching", "touching", "touching", "touching", "touching", "in contact with", "against", "attached to",
                "connected to", "that is touching",
            )  # fmt: skip
            if words == "touching":
                return words, ("touches", "touch"), False
            return (words if words != "that is touching" else "touching"), None, False
        words = self.choice(NEAR_WORDS)
        verb_forms = ("almost touches", "almost touch") if words == "almost touching" else None
        return words, verb_forms, True

    def wall_predicate(self) -> PredicateTemplate:
        positive = self.chance(0.85)
        touching, verb_forms, close = self.touching_words()
        name, sides = self.wall_words(positive)
        function = "is_closely_touching_wall" if close else "is_touching_wall"
        complement = f"{touching} {name}"
        tests = [f"{function}(@, Side.{side})" for side in sides] or [f"{function}(@)"]
        test = tests[0] if len(tests) == 1 else f"({' or '.join(tests)})"
        if verb_forms is not None:
            verb_forms = (f"{verb_forms[0]} {name}", f"{verb_forms[1]} {name}")
        negated = complement
        if not positive and complement.startswith(f"{touching} a "):
            any_wall = complement.removeprefix(f"{touching} a ")
            negated = self.pick(complement, f"{touching} any {any_wall}", f"{touching} any of the walls")
        return PredicateTemplate(complement, test, verb_forms, positive, negated, kind="wall")

    def wall_words(self, positive: bool) -> tuple[str, tuple[str, ...]]:
        """Words for a wall, and the sides that count; none means any."""
        wall, box = self.style.wall, self.style.box
        of_box = self.pick("", "", "", f" of a {box}", f" of the {box}", f" of its {box}", " of box")
        draw = self.rng.random()
        if draw < 0.42:
            name = self.pick(
                f"the {wall}", f"the {wall}", f"the {wall}", f"a {wall}", f"a {wall}", f"the {wall}{of_box}",
                f"a {wall}{of_box}", f"one {wall}", f"one of the {pluralised(wall)}", f"the {pluralised(wall)}",
            )  # fmt: skip
            return name.replace("a edge", "an edge"), ()
        if draw < 0.58 and positive:
            part, sides = self.item_side()
            the = self.pick(f"the {wall}", f"the {wall}", f"a {wall}").replace("a edge", "an edge")
            return f"{the} with its {part}", sides
        side = self.pick("LEFT", "RIGHT", "BOTTOM", "BOTTOM", "BOTTOM", "TOP", "TOP")
        adjective = self.choice(SIDES[side])
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
        return self.choice(names), (side,)

    def item_side(self) -> tuple[str, tuple[str, ...]]:
        """Words for the touching side of an item, and the walls that it may touch: "top", "left side"."""
        return self.pick(
            ("top", ("TOP",)), ("top", ("TOP",)), ("tip", ("TOP",)), ("base", ("BOTTOM",)), ("bottom", ("BOTTOM",)),
            ("base", ("BOTTOM",)), ("side", ("LEFT", "RIGHT")), ("side", ("LEFT", "RIGHT")), ("left side", ("LEFT",)),
            ("right side", ("RIGHT",)), ("top side", ("TOP",)), ("bottom side", ("BOTTOM",)), ("upper side", ("TOP",)),
        )  # fmt: skip

    def corner_predicate(self) -> PredicateTemplate:
        positive = self.chance(0.85)
        draw = self.rng.random()
        of_box = self.pick("", "", "", f" of a {self.style.box}", f" of the {self.style.box}")
        if draw < 0.12:
            return self.specific_corner(of_box, positive)
        if draw < 0.55:
            touching = self.pick(
                "touching", "touching", "touching", "in", "in", "sitting in", "placed in", "at", "located in"
            )
            close = False
        else:
            touching, close = self.choice(NEAR_WORDS), True
        corner = (
            self.pick("a corner", "the corner", "one corner", "a corner", "the corners", "one of the corners") + of_box
        )
        function = "is_closely_touching_corner" if close else "is_touching_corner"
        negated = f"{touching} {self.pick('a corner', 'the corner', 'any corner')}{of_box}"
        verb_forms = (f"touches {corner}", f"touch {corner}") if touching == "touching" else None
        return PredicateTemplate(f"{touching} {corner}", f"{function}(@)", verb_forms, positive, negated, kind="wall")

    def specific_corner(self, of_box: str, positive: bool) -> PredicateTemplate:
        vertical, horizontal = self.pick("TOP", "BOTTOM"), self.pick("LEFT", "RIGHT")
        separator = self.pick(" ", "-", " ", " hand ")
        first = self.choice(SIDES[vertical])
        side = horizontal.lower() + (" hand" if separator == " hand " else "")
        name = f"the {first}{' ' if separator == ' hand ' else separator}{side} corner{of_box}"
        touching = self.pick("in", "touching", "closely touching", "near", "at")
        return PredicateTemplate(
            f"{touching} {name}",
            f"is_closely_touching_specific_corner(@, Side.{vertical}, Side.{horizontal})",
            positive=positive,
            kind="wall",
        )

    def other_noun(self) -> NounTemplate:
        draw = self.rng.random()
        if draw < 0.12:
            return ANYTHING
        noun = NounTemplate(self.attributes())
        return noun.such_that(self.wall_predicate()) if draw > 0.94 else noun

    def beside_predicate(self) -> PredicateTemplate:
        touching, _, close = self.touching_words()
        if not close and self.chance(0.1):
            touching = self.pick("next to", "adjacent to")
        function = "get_closely_touching" if close else "get_touching"
        noun = self.other_noun()
        if noun == ANYTHING and self.chance(0.6):
            other = self.pick(f"another {self.style.item}", f"any other {self.style.item}", "something")
            return PredicateTemplate(
                f"{touching} {other}", f"exist({function}(@))", positive=self.chance(0.8), kind="beside"
            )
        return self.relation_predicate((touching,), function, noun, positive=self.chance(0.88))

    def height_predicate(self) -> PredicateTemplate:
        words, function = self.pick(
            (("above", "somewhere above", "higher than", "over"), "get_box_all_below"),
            (("below", "under", "underneath", "lower than", "beneath"), "get_box_all_above"),
        )
        return self.relation_predicate(words, function, self.other_noun(), positive=self.chance(0.9))

    def only_in_box_predicate(self) -> PredicateTemplate:
        """ "alone in its box" """
        complement = self.pick(
            "alone in a box", "alone in its box", "the only item in its box", "the only one in its box",
            "alone in the box", "by itself in a box",
        )  # fmt: skip
        return PredicateTemplate(
            complement,
            "NOT(exist(get_box_exclusive(@)))",
            follows_noun=not complement.startswith("the"),
            kind="box",
        )

    # Conditions

    @cached_property
    def weighted_conditions(self) -> Sequence[WeightedCondition]:
        return (
            (0.31, self.contains_some), (0.12, lambda: self.total_in_box(8)), (0.15, self.contains_with_predicate),
            (0.06, self.contains_only), (0.07, self.box_variety), (0.05, self.contains_none),
            (0.035, self.contains_more), (0.035, self.total_and_part), (0.025, self.every_item_in_box),
            (0.03, self.single_item), (0.03, self.items_alike), (0.02, self.both_colours), (0.01, self.either_item),
            (0.015, self.one_of_each_value), (0.02, self.exactly_these), (0.015, self.some_and_others),
            (0.005, self.all_different),
        )  # fmt: skip

    def both_colours(self) -> ConditionTemplate:
        """ "both black and yellow items" """
        one, other = self.pick(*TWO_COLOURS)
        shape = self.choice((None, None, *SHAPES))
        nouns = self.described_noun(AttributeWords(shape=shape), plural=True)
        text = self.pick(
            f"both {one} and {other} {nouns}", f"{one} and {other} {nouns}", f"{nouns} in {one} and {other}",
        )  # fmt: skip
        first, second = NounTemplate(AttributeWords((one,), shape)), NounTemplate(AttributeWords((other,), shape))
        test = f"exist({box_items(first)}) and exist({box_items(second)})"
        return ConditionTemplate(test, text, kind="comparison", min_items=2)

    # Statements

    def touching_pair(self) -> TrainingPair:
        """ "two black circles touching each other" """
        attributes = self.attributes()
        noun = NounTemplate(attributes)
        nouns = self.noun(noun, plural=True)
        relation, close = self.pick(
            ("touching each other", False), ("touching one another", False), ("in contact with each other", False),
            ("closely touching each other", True), ("nearly touching each other", True), ("close to each other", True),
            ("next to each other", False),
        )  # fmt: skip
        function = "get_closely_touching" if close else "get_touching"
        predicate = PredicateTemplate(relation, f"exist({item_set(noun, f'{function}(@)', '@@')})")
        there = self.pick(
            "there are two", "there are 2", "two", f"there is a {self.style.box} with two", "there are at least two"
        )
        if self.chance(0.2):
            there = self.pick("there are no", "no")
            return TrainingPair(f"{there} {nouns} {relation}", f"NOT(exist({item_set(noun.such_that(predicate))}))")
        return TrainingPair(f"{there} {nouns} {relation}", f"exist({item_set(noun.such_that(predicate))})")

    def item_in_box(self) -> TrainingPair:
        """ "there is a blue circle in a box with two squares" """
        attributes = self.attributes()
        condition = self.pick(
            lambda: self.total_in_box(6), self.contains_some, self.contains_none, self.contains_only, self.box_variety
        )()
        while condition.contents is None:
            condition = self.contains_some()
        box = self.a(self.style.box)
        with_it = self.box_modifier([condition], plural=False)
        complement = f"{self.pick('in', 'in', 'in', 'inside')} {box} {with_it}"
        noun = NounTemplate(attributes, (PredicateTemplate(complement, condition.test("@.box"), kind="box"),))
        return self.with_main_predicate(self.quantity(3, none=0.06), noun)

    def two_walls(self) -> TrainingPair:
        """Items that touch two walls, or exactly one."""
        attributes = self.attributes()
        wall = self.style.wall
        two = self.pick(f"two {pluralised(wall)}", f"2 {pluralised(wall)}", f"two {pluralised(wall)} of the box")
        touching = self.pick("touching", "touching", "almost touching")
        function = "is_touching_corner" if touching == "touching" else "is_closely_touching_corner"
        predicate = PredicateTemplate(f"{touching} {two}", f"{function}(@)", positive=self.chance(0.9), kind="wall")
        if self.chance(0.35):
            one = self.pick("only one", "exactly one", "just one")
            test = "(is_touching_wall(@) and NOT(is_touching_corner(@)))"
            predicate = PredicateTemplate(f"touching {one} {wall}", test, kind="wall")
        return self.with_main_predicate(self.quantity(3, none=0.06), NounTemplate(attributes, (predicate,)))
