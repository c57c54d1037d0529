"""Synchronous templates for Tower: statements about towers of coloured blocks."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from lilgym_mp.corpus.generator.boxes import Statements
from lilgym_mp.corpus.generator.conditions import ITEMS, TWO_COLOURS, Condition
from lilgym_mp.corpus.generator.fragments import BOX, NONE, SOME, TOWERS, at_least, at_most, boxes_where, exactly
from lilgym_mp.corpus.generator.writer import (
    ANYTHING,
    Attributes,
    Noun,
    Predicate,
    TrainingPair,
    pluralised,
    verb_forms,
)

ON_SAME_COLOUR = "exist(filter_obj(get_below(x), lambda y: y.color == x.color))"


def some_tower(test: str) -> str:
    """Program text: some tower passes a test of the variable BOX."""
    return SOME.test(boxes_where(f"{BOX}.is_tower() and {test}"))


def such_that(noun: Noun, test: str) -> Noun:
    """The items that the noun phrase denotes and that pass a test."""
    return noun.such_that(Predicate("", test))


def coloured_at(position: str, attributes: Attributes, box: str = "@") -> str:
    """Program text: the block at the "top", "bottom", "second" or "third" position of the box has the attributes."""
    return f"exist({such_that(Noun(attributes), f'is_{position}(@)').in_box(box)})"


class TowerStatements(Statements):
    """Statements about coloured blocks in towers."""

    appearance = "tower"
    max_in_box = 4

    def some_attributes(self) -> Attributes:
        return Attributes(self.colour() if self.chance(0.94) else self.choice(TWO_COLOURS))

    def attribute_name(self) -> str:
        return "color"

    def attributes_without(self, attribute: str) -> Attributes:
        return Attributes()

    def box_word(self) -> str:
        return self.word("box" if self.chance(0.25) else "tower")

    def coloured_block(self) -> Noun:
        """A noun of one random colour."""
        return Noun(Attributes(self.colour()))

    def any_block(self) -> Noun:
        """Draws a noun of one colour or, rarely, any block."""
        return ANYTHING if self.chance(0.08) else self.coloured_block()

    def a_tower(self, _: bool = False) -> str:
        """The annotator's word for a tower with its article; takes the flag that phrases pass, and ignores it."""
        return self.a(self.word("tower"))

    # Predicates

    def predicate(self) -> Predicate:
        return self.drawn(
            (0.38, self.position_predicate),
            (0.66, self.stacked_predicate),
            (0.74, self.between_predicate),
            (0.8, self.height_predicate),
            (0.86, self.floor_predicate),
            (0.92, self.beside_predicate),
            (1, self.box_predicate),
        )()

    def box_predicate(self) -> Predicate:
        """Draws the predicate of being in the left, middle or right box."""
        index = self.choice(range(3))
        complement = f"in the {('left', 'middle', 'right')[index]} {self.box_word()}"
        return Predicate(complement, f"@.box == all_boxes[{index}]", positive=self.chance(0.85), kind="box")

    def position_predicate(self) -> Predicate:
        """Draws the predicate of being at the top, at the bottom, or second or third."""
        position = self.pick("top", "top", "top", "bottom", "bottom", "bottom", "second", "third")
        complement = self.say(f"place_{position}", a_tower=self.a_tower())
        without_as = complement.removeprefix("as ")
        main_complement = without_as if without_as != complement else None
        positive = position in ("second", "third") or self.chance(0.9)
        return Predicate(
            complement if positive else without_as,
            f"is_{position}(@)",
            positive=positive,
            kind="place",
            main_complement=main_complement,
        )

    def stacked_predicate(self) -> Predicate:
        """Draws a predicate of being over or under another block, directly or not."""
        positive = self.chance(0.93)
        draw = self.rng.random()
        if draw < 0.06:
            return self.relation_predicate("far_above", "get_box_all_below", self.any_block(), positive=positive)
        if draw < 0.1:
            return self.relation_predicate("far_below", "get_box_all_above", self.any_block(), positive=positive)
        noun = self.any_block()
        if draw < 0.65:
            if positive and self.chance(0.15):
                noun = noun.such_that(self.relation_predicate("on", "get_below", self.any_block()))
            return self.relation_predicate("on", "get_below", noun, positive=positive)
        return self.relation_predicate("under", "get_above", noun, positive=positive)

    def beside_predicate(self) -> Predicate:
        """Draws a predicate of touching another block."""
        return self.relation_predicate("beside", "get_touching", self.any_block(), positive=self.chance(0.9))

    def between_predicate(self) -> Predicate:
        """Draws the predicate of being directly between two blocks, in either order."""
        one = self.coloured_block()
        other = self.coloured_block()
        test = f"{one.related('get_above')} and {other.related('get_below')}"
        if one == other:
            complement = self.say("between_alike", ones=partial(self.noun, one))
        else:
            test += f" or {other.related('get_above')} and {one.related('get_below')}"
            complement = self.say("between", first=self.indefinite(one), second=self.indefinite(other))
        return Predicate(complement, f"({test})", kind="between")

    def height_predicate(self) -> Predicate:
        """ "in a tower of three blocks" """
        condition = self.height()
        tower = self.a_tower()
        how = condition.modifier if condition.modifier else f"with {condition.contents}"
        inside = self.pick("in", "in", "inside", "part of")
        return Predicate(f"{inside} {tower} {how}", condition.test("@.box"), kind="box")

    def floor_predicate(self) -> Predicate:
        """Draws a predicate of touching the floor, also worded as the edge or the wall."""
        floor = self.say("floor")
        bottom = ("wall" not in floor and "edge" not in floor) or "bottom" in floor
        test = f"is_touching_wall(@{', Side.BOTTOM' if bottom else ''})"
        forms = verb_forms(f"touches {floor}")
        return Predicate(f"touching {floor}", test, forms, self.chance(0.85), kind="place")

    # Conditions

    def height(self) -> Condition:
        """Draws a condition on the height of the tower."""
        number = self.pick(1, 1, 2, 2, 2, 3, 3, 3, 4, 4)
        quantity = exactly(number)
        draw = self.rng.random()
        if draw < 0.17 and 1 < number < 4:
            quantity = at_least(number) if draw < 0.12 else at_most(number)
        text = self.quantified(quantity, ANYTHING).text
        if quantity != exactly(number):
            return self.total(quantity, text)
        number_text = self.number(number)
        nouns = f"{number_text} {self.noun(ANYTHING, number > 1)}"
        modifier = self.say("of_height", nouns=nouns, number=number_text)
        verb_phrase = self.say("is_high", nouns=nouns)
        return self.total(quantity, text, modifier or None, verb_forms(verb_phrase) if verb_phrase else None)

    def position_colour(self) -> Condition:
        """ "a black base", "a blue block on top", "a yellow block in the middle" """
        position = self.pick("top", "top", "top", "bottom", "bottom", "bottom", "second", "third", "middle")
        attributes = Attributes(self.colour())
        if position == "middle":
            return self.middle_colour(attributes)
        block = self.indefinite(Noun(attributes))
        colour = attributes.colours[0]
        at_end = position in ("top", "bottom")
        place = self.say(f"at_{position}") if at_end else self.say(f"place_{position}", a_tower=self.a_tower())
        contents = f"{block} {place}"
        forms = None
        if position == "second" and self.chance(0.4):
            contents = self.say("second_colour", block=block, colour=colour)
        if at_end:
            name = self.say(f"name_{position}")
            contents = self.say(
                "end_colour",
                contents=contents,
                block=block,
                colour=colour,
                name=name,
                place=place,
                end=f"{name} {self.word('item')}" if len(name) < 7 else name,
                a_colour=lambda _: self.a(colour),
            )
            verb_phrase = self.say(f"does_at_{position}", block=block)
            forms = verb_forms(verb_phrase) if verb_phrase else None
        least = {"second": 2, "third": 3}.get(position, 1)
        test = coloured_at(position, attributes)
        return Condition(test, contents, None, forms, kind=position, attributes=attributes, min_items=least)

    def middle_colour(self, attributes: Attributes) -> Condition:
        """The colour of the middle block of three."""
        block = self.indefinite(Noun(attributes))
        colour = attributes.colours[0]
        contents = self.say("middle_colour", block=block, colour=colour, a_colour=lambda _: self.a(colour))
        test = f"count({ITEMS}) == 3 and {coloured_at('second', attributes)}"
        return Condition(test, contents, kind="middle", min_items=3, max_items=3)

    def two_ends(self) -> Condition:
        """ "a black top and a yellow base" """
        (top,) = self.colour()
        (base,) = self.colour()
        upper = Attributes((top,))
        lower = Attributes((base,))
        if top == base:
            contents = self.say("same_two_ends", nouns=partial(self.noun, Noun(upper)), colour=top)
        else:
            contents = self.say(
                "two_ends",
                top=top,
                base=base,
                a_top=lambda _: self.a(top),
                a_base=lambda _: self.a(base),
                upper=lambda _: self.indefinite(Noun(upper)),
                lower=lambda _: self.indefinite(Noun(lower)),
            )
        return Condition(f"{coloured_at('top', upper)} and {coloured_at('bottom', lower)}", contents, kind="ends")

    def same_ends(self) -> Condition:
        """Draws a condition that compares the colours of the top and the bottom block."""
        same = self.chance(0.65)
        ends = self.say("same_ends")
        what = self.say("of_same_colour" if same else "of_different_colours")
        at_ends = f"has {'the same color' if same else 'different colors'} at the top and the base"
        forms = verb_forms(at_ends) if self.chance(0.3) else None
        both = f"filter_obj({ITEMS}, lambda x: is_top(x) or is_bottom(x))"
        test = f"ge(count({ITEMS}), 2) and {'' if same else 'not '}all_same_color({both})"
        return Condition(test, f"{ends} {what}", verb_forms=forms, kind="same ends", min_items=2)

    def stacked_condition(self) -> Condition:
        """Draws a condition on the number of blocks that lie next to another one."""
        noun = self.coloured_block()
        noun = noun.such_that(self.pick(self.stacked_predicate, self.stacked_predicate, self.between_predicate)())
        quantity = SOME if self.chance(0.85) else self.pick(exactly(1), exactly(2))
        return self.contains(quantity, noun)

    def alternating(self) -> Condition:
        """The condition that no block lies on one of its colour."""
        test = f"ge(count({ITEMS}), 2) and NOT(exist(filter_obj({ITEMS}, lambda x: {ON_SAME_COLOUR})))"
        return Condition(test, self.say("alternating"), kind="alternating", min_items=2)

    def item_with_others_on_it(self) -> Condition:
        """ "a black item touching the wall and two blue items on top of it" """
        first = self.coloured_block()
        other = self.pick(ANYTHING, self.coloured_block(), self.coloured_block())
        predicate = self.pick(None, self.floor_predicate(), self.floor_predicate(), self.position_predicate())
        if predicate is not None and predicate.positive and "top" not in predicate.complement:
            first = first.such_that(predicate)
        quantity = self.pick(SOME, SOME, exactly(1), exactly(2), exactly(2), at_least(2), NONE)
        above = self.chance(0.8)
        it = self.pick("it", "it", "it", "that", f"that {self.word('item')}")
        where = self.say("above_it" if above else "below_it")
        conjunction = "but" if quantity == NONE and self.chance(0.3) else "and"
        text = f"{self.indefinite(first)} {conjunction} {self.quantified(quantity, other).text} {where} {it}"
        function = "get_above" if where == "directly above" else f"get_box_all_{'above' if above else 'below'}"
        more = quantity.test(other.items(f"{function}(x)", "y"))
        test = f"exist({such_that(first, more).in_box()})"
        return Condition(test, text, kind="stack", min_items=2)

    # Statements

    def item_in_tower(self) -> TrainingPair:
        """ "there is a black block at the base of a tower with four blocks" """
        position = self.pick("top", "top", "bottom", "bottom", "any", "second")
        attributes = Attributes(self.colour())
        condition = self.pick(self.height, self.height, self.position_colour, self.contains_only, self.contains_some)()
        if condition.contents is None:
            condition = self.height()
        tower = self.a_tower()
        described = self.box_modifier([condition], plural=False)
        complement = f"{self.say(f'in_tower_{position}')} {tower} {described}"
        main_complement = complement.removeprefix("as ") if complement.startswith("as ") else None
        own = [] if position == "any" else [f"is_{position}(@)"]
        test = " and ".join([*own, "@.box.is_tower()", condition.test("@.box")])
        noun = Noun(attributes, (Predicate(complement, test, main_complement=main_complement),))
        quantity = self.quantity(3, none=0.05)
        return self.with_main_predicate(quantity if quantity != at_least(3) else SOME, noun)

    def end_colour(self) -> TrainingPair:
        """ "the base of the tower with two blocks is yellow" """
        position = self.pick("top", "bottom", "bottom", "middle")
        attributes = Attributes(self.colour())
        condition = self.height() if self.chance(0.8) else self.contains_some()
        colour = attributes.colours[0]
        if position == "middle":
            one = self.middle_colour(attributes)
            return TrainingPair(self.say("middle_is", a_tower=self.a_tower, colour=colour), some_tower(one.test(BOX)))
        name = self.say(f"end_{position}")
        every = self.chance(0.25)
        test = coloured_at(position, attributes, BOX)
        words = {"name": name, "names": pluralised(name).replace("block on tops", "blocks on top"), "colour": colour}

        def a_colour(_: bool) -> str:
            return self.a(colour)

        def block(_: bool) -> str:
            return f"{self.indefinite(Noun(attributes))} {self.say(f'at_{position}')}"

        if every:
            text = self.say("every_end_is", a_colour=a_colour, block=block, **words)
            return TrainingPair(text, f"All({TOWERS}, lambda {BOX}: {test})")
        if condition.contents is None:
            condition = self.height()
        words |= {"described": self.box_modifier([condition], plural=False), "the": self.pick("the", "the", "a")}
        text = self.say("end_is", a_colour=a_colour, block=block, **words)
        return TrainingPair(text, some_tower(f"{condition.test(BOX)} and {test}"))

    def colour_sequence(self) -> TrainingPair:
        """The colours of a whole tower, or of consecutive blocks in one."""
        number = self.pick(2, 2, 3, 3, 4)
        colours = [self.colour()[0] for _ in range(number)]
        if self.chance(0.5):
            return self.whole_tower_colours(colours)
        *upper, lowest = (Noun(Attributes((colour,))) for colour in colours)
        for noun in reversed(upper):
            lowest = noun.such_that(self.relation_predicate("on", "get_below", lowest))
        return self.with_main_predicate(self.pick(SOME, SOME, SOME, exactly(1), NONE), lowest)

    def whole_tower_colours(self, colours: Sequence[str]) -> TrainingPair:
        """All colours of a tower from top to bottom, or the reverse."""
        upwards = self.chance(0.4)
        order = [*reversed(colours)] if upwards else [*colours]
        direction = self.say("upwards" if upwards else "downwards")
        named = self.pick(", ".join(order), f"{', '.join(order[:-1])} and {order[-1]}", " then ".join(order))
        text = self.say("whole_tower", a_tower=self.a_tower, named=named, direction=direction)
        positions = (*("bottom", "second", "third")[: len(colours) - 1], "top")
        tests = [
            coloured_at(position, Attributes((colour,)), BOX)
            for position, colour in zip(positions, reversed(colours), strict=True)
        ]
        quantity = exactly(1) if "there is one " in text else SOME
        tests = [f"{BOX}.is_tower()", f"count({ANYTHING.in_box(BOX)}) == {len(colours)}", *tests]
        return TrainingPair(text, quantity.test(boxes_where(" and ".join(tests))))

    def towers_alike(self) -> TrainingPair:
        """Towers with the same height, top colour or base colour."""
        what = self.pick("height", "height", "top", "bottom", "bottom")
        if self.chance(0.5):
            return self.all_towers_alike(what)
        two = self.say("two_towers")
        text = f"there {self.be(True)} {two} {self.word('towers')} {self.say(f'two_alike_{what}')}"
        return TrainingPair(text, self.pairs_alike(what, exact=two.startswith(("exactly", "only"))))

    def pairs_alike(self, what: str, *, exact: bool) -> str:
        """Tests that two towers are alike; with `exact`, exactly one pair is."""
        values = [f"count(p[{index}].all_items_in_box())" for index in (0, 1)]
        if what != "height":
            ends = (f"filter_obj(p[{index}].all_items_in_box(), lambda x: is_{what}(x))" for index in (0, 1))
            values = [f"query_color({end})" for end in ends]
        pairs = f"filter_obj(combinations({TOWERS}, 2), lambda p: {' == '.join(values)})"
        return f"count({pairs}) == 1" if exact else f"exist({pairs})"

    def all_towers_alike(self, what: str) -> TrainingPair:
        """Draws a statement that all towers share a height, top or bottom colour, or that they do not."""
        same = self.chance(0.75)
        subject = self.say("all_towers")
        plural = not subject.startswith(("every", "each"))
        names = {name: self.say(f"alike_{name}") for name in ("height", "top", "bottom")}
        if not same:
            subject = self.say("not_all_towers")
            plural = True
        text = f"{subject} {self.verb('has', plural)} {self.pick('the same', 'the same', 'same')} {names[what]}"
        if what == "height":
            test = f"all_same_attribute({TOWERS}, lambda b: count(b.all_items_in_box()))"
            test = test if same else f"exist({TOWERS}) and NOT({test})"
        else:
            ends = f"filter_obj(all_items, lambda x: is_{what}(x))"
            test = f"all_same_color({ends})" if same else f"ge(count(get_set_colors({ends})), 2)"
        return TrainingPair(text, f"All(all_boxes, lambda b: b.is_tower()) and {test}" if "three" in subject else test)

    def touching_pair(self) -> TrainingPair:
        """ "two black blocks touching each other" """
        noun = self.coloured_block()
        relation = self.say("touching_pair")
        nouns = self.noun(noun, True)
        draw = self.rng.random()
        if draw > 0.75:
            pair = f"two {self.word('items')} of the same color {relation}"
            text = self.say("there_are_two", pair=pair)
            return TrainingPair(text, f"exist(filter_obj(all_items, lambda x: {ON_SAME_COLOUR}))")
        below = f"exist({noun.items('get_below(x)', 'y')})"
        number = self.pick("two", "2")
        if draw > 0.5:
            number = self.pick("three", "3")
            lower = f"exist({noun.items('get_below(y)', 'z')})"
            below = f"exist({such_that(noun, lower).items('get_below(x)', 'y')})"
        text = self.say("there_are_two", pair=f"{number} {nouns} {relation}")
        return TrainingPair(text, f"exist({such_that(noun, below).items()})")

    def height_comparison(self) -> TrainingPair:
        """ "the left tower is taller than the right one" """
        one, other = self.rng.sample(range(3), 2)
        order, more = self.pick((">", "more"), ("<", "fewer"), ("==", "as many"))
        names = ("left", "middle", "right") if self.chance(0.7) else ("first", "second", "third")
        tower = self.word("tower")
        first = f"the {names[one]} {tower}"
        second = f"the {names[other]} {self.pick('one', tower)}"
        linking = "as" if order == "==" else "than"
        text = f"{first} is {self.say(f'taller_{order}')} {linking} {second}"
        if self.chance(0.3):
            text = f"{first} has {more} {self.word('items')} {linking} {second}"
        counts = [f"count(all_boxes[{index}].all_items_in_box())" for index in (one, other)]
        towers = f"all_boxes[{one}].is_tower() and all_boxes[{other}].is_tower()"
        return TrainingPair(text, f"{towers} and {counts[0]} {order} {counts[1]}")

    def coloured_towers(self) -> TrainingPair:
        """ "there is a black tower with two blocks" """
        (colour,) = self.colour()
        quantity = self.pick(SOME, SOME, SOME, exactly(1), exactly(2), at_least(2), NONE)
        words = self.determiner(quantity)
        name = self.say("coloured_tower", colour=colour)
        name = pluralised(name) if words.plural else name
        named = self.a(name) if words.text == "a" else f"{words.text} {name}"
        one_colour = f"{BOX}.is_tower() and All({ANYTHING.in_box(BOX)}, lambda x: is_{colour}(x))"
        test = one_colour
        if self.chance(0.5):
            condition = self.height()
            test = f"{one_colour} and {condition.test(BOX)}"
            named = f"{named} {self.box_modifier([condition], words.plural)}"
        if quantity == SOME and self.chance(0.2):
            adverb = self.pick("all ", "only ", "completely ", "")
            text = f"one of the {self.word('towers')} is {adverb}{colour}"
            test = one_colour
        else:
            text = self.existential(named, words.plural)
        return TrainingPair(text, quantity.test(boxes_where(test)))

    def colours_by_position(self) -> TrainingPair:
        """ "the second block of a tower is black", "the first block is yellow and the second is blue" """
        number = self.pick(1, 1, 2)
        chosen = sorted(self.rng.sample(range(4), number))
        from_base = self.pick("", " from the bottom", " from the base")
        clauses: list[tuple[str, str]] = []
        tests: list[str] = []
        for position in (("bottom", "second", "third", "top")[index] for index in chosen):
            (colour,) = self.colour()
            modifier = from_base if position in ("second", "third") else ""
            clauses.append((f"the {self.say(f'block_{position}')} {self.word('item')}{modifier}", f"is {colour}"))
            tests.append(coloured_at(position, Attributes((colour,)), BOX))
        text = f"{self.say('somewhere')} {' and '.join(map(' '.join, clauses))}"
        if number == 1 and self.chance(0.6):
            ((block, is_coloured),) = clauses
            text = f"{block} {self.say('of_tower')} {is_coloured}"
        return TrainingPair(text, some_tower(" and ".join(tests)))
