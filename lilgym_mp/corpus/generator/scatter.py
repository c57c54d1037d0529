"""Synchronous templates for Scatter: statements about shapes anywhere in the boxes."""

from __future__ import annotations

from lilgym_mp.corpus.generator.boxes import Statements
from lilgym_mp.corpus.generator.conditions import TWO_COLOURS, Condition
from lilgym_mp.corpus.generator.writer import ANYTHING, SHAPES, Attributes, Noun, Predicate, TrainingPair, verb_forms

ITEM_SIDES = {"tip": "TOP", "base": "BOTTOM", "upper side": "TOP"}  # others begin with the name of the side


class ScatterStatements(Statements):
    """Statements about circles, squares and triangles of three colours and sizes."""

    appearance = "scatter"
    max_in_box = 6

    def some_attributes(self) -> Attributes:
        draw = self.rng.random()
        colours = () if draw < 0.12 else self.choice(TWO_COLOURS) if draw > 0.97 else self.colour()
        shape = self.choice(SHAPES) if self.chance(0.75) or (not colours and self.chance(0.7)) else None
        size = self.pick("small", "medium", "big", "small", "big") if self.chance(0.12) else None
        return Attributes(colours, shape, size) if colours or shape or size else Attributes(self.colour())

    def attribute_name(self) -> str:
        attribute = self.pick("color", "color", "color", "shape", "shape", "size")
        return "color" if attribute == self.word("item") else attribute

    def attributes_without(self, attribute: str) -> Attributes:
        draw = self.rng.random()
        if draw < 0.35:
            return Attributes()
        colours = self.colour() if attribute != "color" and draw < 0.75 else ()
        shape = self.choice(SHAPES) if attribute != "shape" and draw > 0.55 else None
        return Attributes(colours, shape)

    def box_word(self) -> str:
        return self.word("box")

    # Predicates

    def predicate(self) -> Predicate:
        return self.drawn(
            (0.56, self.wall_predicate),
            (0.7, self.corner_predicate),
            (0.86, self.beside_predicate),
            (0.9, self.height_predicate),
            (0.96, self.box_predicate),
            (1, self.only_in_box_predicate),
        )()

    def box_predicate(self) -> Predicate:
        """Draws the predicate of being in the left, middle or right box."""
        index = self.choice(range(3))
        name = self.pick(("left", "middle", "right"), ("first", "second", "third"))[index]
        test = f"@.box == all_boxes[{index}]"
        positive = self.chance(0.9)
        return Predicate(f"in the {name} {self.word('box')}", test, positive=positive, kind="box")

    def touching_words(self) -> tuple[str, bool]:
        """Words for touching, and whether they include almost touching."""
        return (self.say("touching"), False) if self.rng.random() < 0.76 else (self.say("near"), True)

    def wall_predicate(self) -> Predicate:
        """Draws a predicate of touching a wall, any or a named one."""
        positive = self.chance(0.85)
        words, close = self.touching_words()
        touching = words.removeprefix("that is ")
        name, sides = self.wall_words(positive)
        function = "is_closely_touching_wall" if close else "is_touching_wall"
        complement = f"{touching} {name}"
        tests = [f"{function}(@, Side.{side})" for side in sides] or [f"{function}(@)"]
        test = tests[0] if len(tests) == 1 else f"({' or '.join(tests)})"
        negated = complement
        if not positive and name.startswith("a "):
            any_wall = name.removeprefix("a ")
            negated = self.pick(complement, f"{touching} any {any_wall}", f"{touching} any of the walls")
        verb = {"touching": "touches", "almost touching": "almost touches"}.get(words)
        forms = verb_forms(f"{verb} {name}") if verb else None
        return Predicate(complement, test, forms, positive, negated, kind="wall")

    def wall_words(self, positive: bool) -> tuple[str, tuple[str, ...]]:
        """Words for a wall, and the sides that count; none means any."""
        box = self.word("box")
        of_box = self.pick("", "", "", f" of a {box}", f" of the {box}", f" of its {box}", " of box")
        draw = self.rng.random()
        if draw < 0.42:
            return self.say("some_wall", of_box=of_box).replace("a edge", "an edge"), ()
        if draw < 0.58 and positive:
            part = self.say("item_side")
            sides = ("LEFT", "RIGHT") if part == "side" else (ITEM_SIDES.get(part, part.split()[0].upper()),)
            return f"{self.say('with_wall').replace('a edge', 'an edge')} with its {part}", sides
        side = self.pick("left", "right", "bottom", "bottom", "bottom", "top", "top")
        adjective = self.say(f"side_{side}")
        wording = f"wall_{side}" if side in ("bottom", "top") else "wall_side"
        return self.say(wording, adjective=adjective, of_box=of_box), (side.upper(),)

    def corner_predicate(self) -> Predicate:
        """Draws a predicate of touching a corner."""
        positive = self.chance(0.85)
        draw = self.rng.random()
        box = self.word("box")
        of_box = self.pick("", "", "", f" of a {box}", f" of the {box}")
        if draw < 0.12:
            return self.specific_corner(of_box, positive)
        close = draw >= 0.55
        touching = self.say("near" if close else "at_corner")
        corner = self.say("corner") + of_box
        function = "is_closely_touching_corner" if close else "is_touching_corner"
        negated = f"{touching} {self.pick('a corner', 'the corner', 'any corner')}{of_box}"
        forms = verb_forms(f"touches {corner}") if touching == "touching" else None
        return Predicate(f"{touching} {corner}", f"{function}(@)", forms, positive, negated, kind="wall")

    def specific_corner(self, of_box: str, positive: bool) -> Predicate:
        """Draws a predicate of touching a named corner; `of_box` ends its words."""
        vertical = self.pick("top", "bottom")
        horizontal = self.pick("left", "right")
        separator = self.pick(" ", "-", " ", " hand ")
        first = self.say(f"side_{vertical}")
        side = f" {horizontal} hand" if separator == " hand " else f"{separator}{horizontal}"
        test = f"is_closely_touching_specific_corner(@, Side.{vertical.upper()}, Side.{horizontal.upper()})"
        complement = f"{self.say('at_specific_corner')} the {first}{side} corner{of_box}"
        return Predicate(complement, test, positive=positive, kind="wall")

    def other_noun(self) -> Noun:
        """Draws the noun that a relation refers to."""
        draw = self.rng.random()
        if draw < 0.12:
            return ANYTHING
        noun = self.some_noun()
        return noun.such_that(self.wall_predicate()) if draw > 0.94 else noun

    def beside_predicate(self) -> Predicate:
        """Draws a predicate of touching another item."""
        words, close = self.touching_words()
        touching = words.removeprefix("that is ")
        if not close and self.chance(0.1):
            touching = self.pick("next to", "adjacent to")
        function = "get_closely_touching" if close else "get_touching"
        noun = self.other_noun()
        if noun == ANYTHING and self.chance(0.6):
            complement = f"{touching} {self.say('another')}"
            positive = self.chance(0.8)
            return Predicate(complement, f"exist({function}(@))", positive=positive, kind="beside")
        return self.relation_predicate("beside", function, noun, positive=self.chance(0.88), touching=touching)

    def height_predicate(self) -> Predicate:
        """Draws a predicate of being above or below another item."""
        words, function = self.pick(("above", "get_box_all_below"), ("below", "get_box_all_above"))
        return self.relation_predicate(words, function, self.other_noun(), positive=self.chance(0.9))

    def only_in_box_predicate(self) -> Predicate:
        """ "alone in its box" """
        words = self.say("alone")
        follows_noun = not words.startswith("the")
        return Predicate(words, "NOT(exist(get_box_exclusive(@)))", follows_noun=follows_noun, kind="box")

    # Conditions

    def both_colours(self) -> Condition:
        """ "both black and yellow items" """
        colours = self.pick(*TWO_COLOURS)
        shape = self.choice((None, None, *SHAPES))
        nouns = self.described_noun(Attributes(shape=shape), plural=True)
        text = self.say("both_colours", first=colours[0], second=colours[1], nouns=nouns)
        test = " and ".join(f"exist({Noun(Attributes((colour,), shape)).in_box()})" for colour in colours)
        return Condition(test, text, kind="comparison", min_items=2)

    # Statements

    def touching_pair(self) -> TrainingPair:
        """ "two black circles touching each other" """
        noun = self.some_noun()
        nouns = self.noun(noun, plural=True)
        relation = self.say("touching_pair")
        close = relation.startswith(("close", "nearly"))
        program = noun.related("get_closely_touching" if close else "get_touching")
        pairs = noun.such_that(Predicate(relation, program)).items()
        there = self.say("there_are_two")
        test = f"exist({pairs})"
        if self.chance(0.2):
            there = self.pick("there are no", "no")
            test = f"NOT({test})"
        return TrainingPair(f"{there} {nouns} {relation}", test)

    def item_in_box(self) -> TrainingPair:
        """ "there is a blue circle in a box with two squares" """
        attributes = self.some_attributes()
        condition = self.pick(
            lambda: self.total_in_box(6), self.contains_some, self.contains_none, self.contains_only, self.box_variety
        )()
        while condition.contents is None:
            condition = self.contains_some()
        box = self.a(self.word("box"))
        with_it = self.box_modifier([condition], plural=False)
        complement = f"{self.pick('in', 'in', 'in', 'inside')} {box} {with_it}"
        noun = Noun(attributes, (Predicate(complement, condition.test("@.box"), kind="box"),))
        return self.with_main_predicate(self.quantity(3, none=0.06), noun)

    def two_walls(self) -> TrainingPair:
        """Items that touch two walls, or exactly one."""
        attributes = self.some_attributes()
        two = self.say("two_walls")
        touching = self.pick("touching", "touching", "almost touching")
        test = "is_touching_corner(@)" if touching == "touching" else "is_closely_touching_corner(@)"
        predicate = Predicate(f"{touching} {two}", test, positive=self.chance(0.9), kind="wall")
        if self.chance(0.35):
            one = self.pick("only one", "exactly one", "just one")
            test = "(is_touching_wall(@) and NOT(is_touching_corner(@)))"
            predicate = Predicate(f"touching {one} {self.word('wall')}", test, kind="wall")
        return self.with_main_predicate(self.quantity(3, none=0.06), Noun(attributes, (predicate,)))
