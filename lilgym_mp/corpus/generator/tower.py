"""Synchronous templates for Tower: statements about towers of coloured blocks."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from lilgym_mp.corpus.generator.boxes import StatementTemplates
from lilgym_mp.corpus.generator.conditions import (
    ITEMS,
    TWO_COLOURS,
    ConditionTemplate,
    WeightedCondition,
    WeightedTemplate,
)
from lilgym_mp.corpus.generator.lexicon import Phrase, pluralised
from lilgym_mp.corpus.generator.phrases import (
    ANYTHING,
    HOLE,
    AttributeWords,
    NounTemplate,
    PredicateTemplate,
    TrainingPair,
    bound,
    filter_items,
    item_set,
)
from lilgym_mp.corpus.generator.program_text import BOX, TOWERS, boxes_where, items_in_box, quantity_test
from lilgym_mp.corpus.generator.quantities import NONE, SOME, at_least, at_most, exactly

ON = (
    "on", "on", "on top of", "above", "above", "over", "over", "directly above", "directly on", "right above",
    "just above", "immediately above", "directly on top of", "sitting on", "resting on", "placed on", "stacked on",
    "directly over", "right on top of",
)  # fmt: skip
UNDER = (
    "under", "under", "below", "below", "beneath", "underneath", "directly under", "directly below", "right below",
    "just below", "right under", "immediately below",
)  # fmt: skip
BESIDE = ("touching", "touching", "attached to", "adjacent to", "next to", "connected to", "in contact with")
FAR_ABOVE = ("somewhere above", "higher than", "anywhere above")
FAR_BELOW = ("somewhere below", "lower than", "anywhere below")
ON_SAME_COLOUR = "exist(filter_obj(get_below(x), lambda y: y.color == x.color))"
POSITIONS = {  # where a block is in {a} or {the} tower
    "top": (
        "on top", "at the top", "on the top", "on top of {a}", "at the top of {a}", "at the top of {the}",
        "on the top of {a}", "as the top", "as the top of {a}", "at top", "on top of {the}",
        "at the top most position", "at the very top of {a}",
    ),
    "bottom": (
        "at the base", "at the bottom", "at the base of {a}", "at the bottom of {a}", "as the base",
        "as the base of {a}", "as base of {a}", "at the base of {the}", "on the bottom", "as base",
        "at the bottom of {the}", "as the base of {the}", "at the very bottom", "in the base",
    ),
    "second": (
        "second from the bottom", "in second position from the bottom", "second from the base",
        "in the second place from the bottom", "at the second level", "in second position",
        "second from the bottom of {a}", "as the second block from the base",
    ),
    "third": (
        "third from the bottom", "in third position from the bottom", "third from the base", "at the third level",
        "in third position", "as the third block from the base",
    ),
}  # fmt: skip
POSITION_TESTS = {"top": "is_top", "bottom": "is_bottom", "second": "is_second", "third": "is_third"}


def some_tower(test: str) -> str:
    """Program text: some tower passes a test of the variable BOX."""
    return quantity_test(SOME, boxes_where(f"{BOX}.is_tower() and {test}"))


class TowerTemplates(StatementTemplates):
    """Statements about coloured blocks in towers."""

    max_in_box = 4
    style_words = {
        "tower": ("tower",) * 12 + ("stack", "stack", "pile", "column"),
        "item": ("block",) * 10 + ("item", "item", "item", "brick", "square", "square", "object", "cube"),
        "box": ("box",) * 8 + ("grey box", "gray box", "grey square", "grey area"),
        "wall": ("wall", "wall", "edge"),
    }

    @cached_property
    def weighted_statements(self) -> Sequence[WeightedTemplate]:
        return (
            (5, self.item_count), (2, self.total_count), (0.5, self.number_is), (10, self.items_with_predicate),
            (3, self.definite), (1.5, self.only_item_with_predicate), (2, self.partitive_count), (2.5, self.every_item),
            (1, self.not_every_item), (1, self.only_these), (1.5, self.shared_value), (1, self.scene_variety),
            (2, self.count_comparison), (3, self.compound), (3, self.two_item_counts), (34, self.box_count),
            (3, self.named_box), (1, self.every_box_with), (3, self.definite_box), (9, self.item_in_tower),
            (3, self.colour_sequence), (3, self.end_colour), (3, self.towers_alike), (1.5, self.touching_pair),
            (1.5, self.height_comparison), (0.7, self.both_items), (0.5, self.all_but_some), (0.5, self.most_items),
            (0.4, self.no_two_items_alike), (1, self.items_in_same_box), (1.5, self.two_adjacent_boxes),
            (1.2, self.equal_counts), (0.8, self.largest_box), (2, self.coloured_towers),
            (1.5, self.colours_by_position),
        )  # fmt: skip

    def attributes(self) -> AttributeWords:
        return AttributeWords(self.colour() if self.chance(0.94) else self.choice(TWO_COLOURS))

    def attribute_name(self) -> str:
        return "color"

    def attributes_without(self, attribute: str) -> AttributeWords:
        return AttributeWords()

    def box_word(self) -> str:
        return self.style.box if self.chance(0.25) else self.style.tower

    # Predicates

    def predicate(self) -> PredicateTemplate:
        return self.drawn(
            (0.38, self.position_predicate), (0.66, self.stacked_predicate), (0.74, self.between_predicate),
            (0.8, self.height_predicate), (0.86, self.floor_predicate), (0.92, self.beside_predicate),
            (1, self.box_predicate),
        )()  # fmt: skip

    def box_predicate(self) -> PredicateTemplate:
        index = int(self.rng.random() * 3)
        complement = f"in the {('left', 'middle', 'right')[index]} {self.box_word()}"
        return PredicateTemplate(complement, f"@.box == all_boxes[{index}]", positive=self.chance(0.85), kind="box")

    def position_predicate(self) -> PredicateTemplate:
        position = self.pick("top", "top", "top", "bottom", "bottom", "bottom", "second", "third")
        complement = self.position_words(position)
        main_complement = complement.removeprefix("as ") if complement.startswith("as ") else None
        positive = position in ("second", "third") or self.chance(0.9)
        if not positive:
            complement = complement.removeprefix("as ")
        return PredicateTemplate(
            complement,
            f"{POSITION_TESTS[position]}(@)",
            positive=positive,
            kind="place",
            main_complement=main_complement,
        )

    def position_words(self, position: str) -> str:
        tower = self.style.tower
        towers = {"a": self.a(tower), "the": f"the {tower}"}
        return self.choice(POSITIONS[position]).format(**towers)

    def coloured_block(self) -> NounTemplate:
        return NounTemplate(AttributeWords(self.colour()))

    def any_block(self) -> NounTemplate:
        return ANYTHING if self.chance(0.08) else self.coloured_block()

    def stacked_predicate(self) -> PredicateTemplate:
        positive = self.chance(0.93)
        draw = self.rng.random()
        if draw < 0.06:
            return self.relation_predicate(FAR_ABOVE, "get_box_all_below", self.any_block(), positive=positive)
        if draw < 0.1:
            return self.relation_predicate(FAR_BELOW, "get_box_all_above", self.any_block(), positive=positive)
        noun = self.any_block()
        if draw < 0.65:
            if positive and self.chance(0.15):
                noun = noun.such_that(self.relation_predicate(ON, "get_below", self.any_block()))
            return self.relation_predicate(ON, "get_below", noun, positive=positive)
        return self.relation_predicate(UNDER, "get_above", noun, positive=positive)

    def beside_predicate(self) -> PredicateTemplate:
        return self.relation_predicate(BESIDE, "get_touching", self.any_block(), positive=self.chance(0.9))

    def between_predicate(self) -> PredicateTemplate:
        one, other = self.coloured_block(), self.coloured_block()

        def side(function: str, noun: NounTemplate) -> str:
            return f"exist({item_set(noun, f'{function}(@)', '@@')})"

        test = f"{side('get_above', one)} and {side('get_below', other)}"
        if one == other:
            complement = self.pick(
                f"between {self.number(2)} {self.noun(one, True)}",
                f"in between {self.number(2)} {self.noun(one, True)}", f"sandwiched between two {self.noun(one, True)}",
                f"between {self.noun(one, True)}",
            )  # fmt: skip
        else:
            test += f" or {side('get_above', other)} and {side('get_below', one)}"
            first, second = self.indefinite(one), self.indefinite(other)
            complement = self.pick(
                f"between {first} and {second}", f"in between {first} and {second}",
                f"in the middle of {first} and {second}",
            )  # fmt: skip
        return PredicateTemplate(complement, f"({test})", kind="between")

    def height_predicate(self) -> PredicateTemplate:
        """ "in a tower of three blocks" """
        condition = self.height()
        tower = self.a(self.style.tower)
        how = condition.modifier if condition.modifier else f"with {condition.contents}"
        inside = self.pick("in", "in", "inside", "part of")
        return PredicateTemplate(f"{inside} {tower} {how}", condition.test("@.box"), kind="box")

    def floor_predicate(self) -> PredicateTemplate:
        floor = self.pick(
            "the wall", "the wall", f"the {self.style.wall}", "the floor", "the ground", "the base",
            f"the bottom {self.style.wall}", f"a {self.style.wall}", f"the bottom of the {self.style.box}",
            f"the base of the {self.style.box}", f"the bottom of a {self.style.box}",
        )  # fmt: skip
        bottom = ("wall" not in floor and "edge" not in floor) or "bottom" in floor
        side = ", Side.BOTTOM" if bottom else ""
        return PredicateTemplate(
            f"touching {floor}", f"is_touching_wall(@{side})", (f"touches {floor}", f"touch {floor}"),
            self.chance(0.85), kind="place",
        )  # fmt: skip

    # Conditions

    @cached_property
    def weighted_conditions(self) -> Sequence[WeightedCondition]:
        return (
            (0.17, self.contains_some), (0.19, self.height), (0.21, self.position_colour), (0.06, self.contains_only),
            (0.06, self.box_variety), (0.04, self.contains_none), (0.05, self.stacked_condition),
            (0.03, self.contains_more), (0.03, self.same_ends), (0.02, self.total_and_part), (0.015, self.single_item),
            (0.015, self.items_alike), (0.03, self.two_ends), (0.01, self.alternating),
            (0.04, self.item_with_others_on_it), (0.01, self.either_item), (0.015, self.one_of_each_value),
            (0.02, self.exactly_these), (0.02, self.some_and_others), (0.005, self.all_different),
            (0.01, self.between_alike),
        )  # fmt: skip

    def height(self) -> ConditionTemplate:
        number = self.pick(1, 1, 2, 2, 2, 3, 3, 3, 4, 4)
        quantity = exactly(number)
        draw = self.rng.random()
        if draw < 0.12 and 1 < number < 4:
            quantity = at_least(number)
        elif draw < 0.17 and 1 < number < 4:
            quantity = at_most(number)
        text = self.quantified(quantity, ANYTHING).text
        number_text = self.number(number)
        modifier = None
        verb_forms = None
        if quantity == exactly(number):
            nouns = f"{number_text} {self.noun(ANYTHING, number > 1)}"
            modifier = self.pick(
                None, None, f"of {nouns}", f"of {number_text}", f"made of {nouns}", f"made up of {nouns}",
                f"consisting of {nouns}", f"of height {number_text}",
                f"that is {nouns} {self.pick('high', 'tall')}", f"built of {nouns}",
            )  # fmt: skip
            verb_forms = self.pick(
                None, (f"is {nouns} high", f"are {nouns} high"), (f"is {nouns} tall", f"are {nouns} tall"),
                (f"is made up of {nouns}", f"are made up of {nouns}"),
                (f"consists of {nouns}", f"consist of {nouns}"),
            )  # fmt: skip
        return ConditionTemplate(
            quantity_test(quantity, ITEMS), text, modifier, verb_forms, kind="total",
            min_items=quantity.low, max_items=quantity.high,
        )  # fmt: skip

    def existence_at_position(self, position: str, attributes: AttributeWords, box: str = HOLE) -> str:
        tests = (*attributes.tests(), f"{POSITION_TESTS[position]}({HOLE})")
        return quantity_test(SOME, filter_items(items_in_box(box), tests))

    def position_colour(self) -> ConditionTemplate:
        """ "a black base", "a blue block on top", "a yellow block in the middle" """
        position = self.pick("top", "top", "top", "bottom", "bottom", "bottom", "second", "third", "middle")
        attributes = AttributeWords(self.colour())
        if position == "middle":
            return self.middle_colour(attributes)
        block, colour = self.indefinite(NounTemplate(attributes)), attributes.colours[0]
        names = {
            "top": ("top", "top block", "top most block"),
            "bottom": ("base", "bottom", "bottom block", "base block"),
        }
        place = self.position_words(position) if position not in names else self.end_position_words(position)
        contents = f"{block} {place}"
        if position == "second" and self.chance(0.4):
            contents = self.pick(
                f"{block} as the second block", f"{colour} as the second block", f"a {colour} second block"
            )
        verb_forms = None
        if position in names:
            name = self.choice(names[position])
            item = self.style.item
            contents = self.pick(
                contents, contents, contents, f"{self.a(colour)} {name}", f"{colour} {name}", f"{block} as the {name}",
                f"{block} as its {name}", f"{block} as {name}", f"the {name} as {colour}", f"{colour} as the {name}",
                f"{colour} {item} as {name}", f"the {colour} {item} {place}",
                f"{self.a(colour)} {name} {item}" if len(name) < 7 else f"{self.a(colour)} {name}",
                f"{colour} {item} {place}", f"exactly one {colour} {item} {place}",
            )  # fmt: skip
            if position == "top":
                ends = (f"ends with {block}", f"end with {block}")
                verb_forms = self.pick(None, None, None, ends, (f"is topped with {block}", f"are topped with {block}"))
            else:
                verb_forms = self.pick(None, None, None, (f"starts with {block}", f"start with {block}"), None)
        return ConditionTemplate(
            self.existence_at_position(position, attributes), contents,
            verb_forms=verb_forms, kind=position, attributes=attributes,
            min_items={"second": 2, "third": 3}.get(position, 1),
        )  # fmt: skip

    def end_position_words(self, position: str) -> str:
        if position == "top":
            return self.pick("on top", "at the top", "on the top", "as the top", "at top", "on its top", "at its top")
        return self.pick(
            "at the base", "at the bottom", "as the base", "as base", "on the bottom", "in the base", "at its base",
            "as its base", "at the very bottom", "in the bottom",
        )  # fmt: skip

    def middle_colour(self, attributes: AttributeWords) -> ConditionTemplate:
        """The colour of the middle block of three."""
        block, colour, item = self.indefinite(NounTemplate(attributes)), attributes.colours[0], self.style.item
        contents = self.pick(
            f"{block} in the middle", f"{block} as the middle {item}", f"{colour} in the middle",
            f"{self.a(colour)} {item} as a middle {item}", f"{self.a(colour)} middle {item}", f"{block} in between",
        )  # fmt: skip
        test = f"count({ITEMS}) == 3 and {self.existence_at_position('second', attributes)}"
        return ConditionTemplate(test, contents, kind="middle", min_items=3, max_items=3)

    def two_ends(self) -> ConditionTemplate:
        """ "a black top and a yellow base" """
        top, base = AttributeWords(self.colour()), AttributeWords(self.colour())
        if top == base:
            colour = top.colours[0]
            contents = self.pick(
                f"{self.noun(NounTemplate(top), True)} on the top and at the base", f"{colour} base and {colour} top",
                f"both top and base {colour}", f"{colour} {pluralised(self.style.item)} at both ends",
            )  # fmt: skip
        else:
            upper, lower = NounTemplate(top), NounTemplate(base)
            contents = self.pick(
                f"{top.colours[0]} top and {base.colours[0]} base",
                f"{self.a(base.colours[0])} base and {self.a(top.colours[0])} top",
                f"{self.indefinite(lower)} at the base and {self.indefinite(upper)} at the top",
                f"{self.indefinite(upper)} on top and {self.indefinite(lower)} at the bottom",
            )
        test = f"{self.existence_at_position('top', top)} and {self.existence_at_position('bottom', base)}"
        return ConditionTemplate(test, contents, kind="ends")

    def same_ends(self) -> ConditionTemplate:
        same = self.chance(0.65)
        ends = self.pick(
            "the top and the base", "a top and a base", "top and base", "base and top", "the base and the top",
            "the top and bottom blocks",
        )  # fmt: skip
        same_words = ("of the same color", "in the same color", "with the same color")
        what = self.choice(same_words if same else ("of different colors", "in different colors"))
        colours = "the same color" if same else "different colors"
        at_ends = f"{colours} at the top and the base"
        verb_forms = (f"has {at_ends}", f"have {at_ends}") if self.chance(0.3) else None
        both = f"filter_obj({ITEMS}, lambda x: is_top(x) or is_bottom(x))"
        test = f"ge(count({ITEMS}), 2) and {'' if same else 'not '}all_same_color({both})"
        return ConditionTemplate(test, f"{ends} {what}", verb_forms=verb_forms, kind="same ends", min_items=2)

    def stacked_condition(self) -> ConditionTemplate:
        noun = self.coloured_block()
        noun = noun.such_that(self.pick(self.stacked_predicate, self.stacked_predicate, self.between_predicate)())
        quantity = SOME if self.chance(0.85) else self.pick(exactly(1), exactly(2))
        return self.contains(quantity, noun)

    def alternating(self) -> ConditionTemplate:
        item = pluralised(self.style.item)
        contents = self.pick(
            "alternating colors", f"{item} of alternating colors", f"{item} in alternating colors",
            f"no two adjacent {item} of the same color", f"no two {item} of the same color touching",
        )  # fmt: skip
        test = f"ge(count({ITEMS}), 2) and NOT(exist(filter_obj({ITEMS}, lambda x: {ON_SAME_COLOUR})))"
        return ConditionTemplate(test, contents, kind="alternating", min_items=2)

    def item_with_others_on_it(self) -> ConditionTemplate:
        """ "a black item touching the wall and two blue items on top of it" """
        first = self.coloured_block()
        other = self.pick(ANYTHING, self.coloured_block(), self.coloured_block())
        predicate = self.pick(None, self.floor_predicate(), self.floor_predicate(), self.position_predicate())
        if predicate is not None and predicate.positive and "top" not in predicate.complement:
            first = first.such_that(predicate)
        quantity = self.pick(SOME, SOME, exactly(1), exactly(2), exactly(2), at_least(2), NONE)
        above = self.chance(0.8)
        it = self.pick("it", "it", "it", "that", f"that {self.style.item}")
        prepositions = (
            ("on top of", "on top of", "above", "over", "on", "directly above")
            if above
            else ("below", "under", "beneath", "underneath")
        )
        words = f"{self.choice(prepositions)} {it}"
        conjunction = "but" if quantity == NONE and self.chance(0.3) else "and"
        text = f"{self.indefinite(first)} {conjunction} {self.quantified(quantity, other).text} {words}"
        direct = words.startswith("directly")
        related = ("get_above" if direct else "get_box_all_above") if above else "get_box_all_below"
        more = quantity_test(quantity, item_set(other, f"{related}(x)", "y"))
        test = f"exist({filter_items(ITEMS, (*first.tests(), more))})"
        return ConditionTemplate(test, text, kind="stack", min_items=2)

    def between_alike(self) -> ConditionTemplate:
        """ "a black item between two items of the same color" """
        noun = self.coloured_block()
        nouns = pluralised(self.style.item)
        between = self.pick("between", "in between", "sandwiched between")
        same = self.pick("the same", "the same", "same")
        text = f"{self.indefinite(noun)} {between} {self.number(2)} {nouns} of {same} color"
        more, more_text = self.pick(("", ""), ("", ""), (" and NOT(exist(get_above(y)))", "top"))
        neighbours = (
            "exist(filter_obj(get_above(x), lambda y: exist(filter_obj(get_below(x), lambda z: z.color == y.color))"
        )
        if more_text:
            text += self.pick(
                f" and no {self.style.item} on top of that", f" and no {self.style.item} above that",
                f" and no {self.style.item} on top of them",
            )  # fmt: skip
        test = f"exist({filter_items(ITEMS, (*noun.tests(), f'{neighbours}{more})'))})"
        return ConditionTemplate(test, text, kind="stack", min_items=3)

    # Statements

    def item_in_tower(self) -> TrainingPair:
        """ "there is a black block at the base of a tower with four blocks" """
        position = self.pick("top", "top", "bottom", "bottom", "any", "second")
        attributes = AttributeWords(self.colour())
        condition = self.pick(self.height, self.height, self.position_colour, self.contains_only, self.contains_some)()
        if condition.contents is None:
            condition = self.height()
        tower = self.a(self.style.tower)
        described = self.box_modifier([condition], plural=False)
        place = {"top": ("at the top of", "on top of", "on the top of", "as the top of", "at top of"),
                 "bottom": ("at the base of", "at the bottom of", "as the base of", "as base of"),
                 "second": ("as the second block of", "second from the bottom of"),
                 "any": ("in", "in", "inside")}[position]  # fmt: skip
        complement = f"{self.choice(place)} {tower} {described}"
        main_complement = complement.removeprefix("as ") if complement.startswith("as ") else None
        own = [] if position == "any" else [f"{POSITION_TESTS[position]}(@)"]
        test = " and ".join([*own, "@.box.is_tower()", condition.test("@.box")])
        noun = NounTemplate(attributes, (PredicateTemplate(complement, test, main_complement=main_complement),))
        quantity = self.quantity(3, none=0.05)
        return self.with_main_predicate(quantity if quantity != at_least(3) else SOME, noun)

    def end_colour(self) -> TrainingPair:
        """ "the base of the tower with two blocks is yellow" """
        position = self.pick("top", "bottom", "bottom", "middle")
        attributes = AttributeWords(self.colour())
        condition = self.height() if self.chance(0.8) else self.contains_some()
        tower, colour = self.style.tower, attributes.colours[0]
        if position == "middle":
            one = self.middle_colour(attributes)
            blocks = pluralised(self.style.item)
            text = self.pick(
                f"the middle {self.style.item} of {self.a(tower)} with three {blocks} is {colour}",
                f"the middle {self.style.item} in one of the {pluralised(tower)} is {colour}",
                f"the middle {self.style.item} of {self.a(tower)} is {colour}",
                f"the {self.style.item} in the middle of {self.a(tower)} is {colour}",
            )  # fmt: skip
            return TrainingPair(text, some_tower(one.test(BOX)))
        names = (
            ("top", "top block", "block on top")
            if position == "top"
            else ("base", "base", "bottom", "bottom block", "base block")
        )
        name = self.choice(names)
        every = self.chance(0.25)
        attribute_test = self.existence_at_position(position, attributes, BOX)
        if every:
            plural = {"block on top": "blocks on top"}.get(name, pluralised(name))
            text = self.pick(
                f"the {plural} of all the {pluralised(tower)} are {colour}",
                f"all the {pluralised(tower)} have {self.a(colour)} {name}",
                f"the {name} of every {tower} is {colour}",
                f"the {name} of each {tower} is {colour}",
                f"all {plural} are {colour}",
                f"every {tower} has {self.indefinite(NounTemplate(attributes))} {self.end_position_words(position)}",
            )
            return TrainingPair(text, f"All({TOWERS}, lambda {BOX}: {attribute_test})")
        if condition.contents is None:
            condition = self.height()
        block, described = NounTemplate(attributes), self.box_modifier([condition], plural=False)
        the = self.pick("the", "the", "a")
        text = self.pick(
            f"the {name} of {the} {tower} {described} is {colour}",
            f"{the} {tower} {described} has {self.a(colour)} {name}",
            f"{the} {tower} {described} has {self.indefinite(block)} {self.end_position_words(position)}",
        )
        return TrainingPair(text, some_tower(f"{condition.test(BOX)} and {attribute_test}"))

    def colour_sequence(self) -> TrainingPair:
        """The colours of a whole tower, or of consecutive blocks in one."""
        number = self.pick(2, 2, 3, 3, 4)
        colours = [self.colour()[0] for _ in range(number)]
        if self.chance(0.5):
            return self.whole_tower_colours(colours)
        blocks = [NounTemplate(AttributeWords((colour,))) for colour in colours]
        lowest = blocks[-1]
        for noun in reversed(blocks[:-1]):
            lowest = noun.such_that(self.relation_predicate(ON, "get_below", lowest))
        return self.with_main_predicate(self.pick(SOME, SOME, SOME, exactly(1), NONE), lowest)

    def whole_tower_colours(self, colours: Sequence[str]) -> TrainingPair:
        """All colours of a tower from top to bottom, or the reverse."""
        tower, item = self.style.tower, pluralised(self.style.item)
        upwards = self.chance(0.4)
        order = [*reversed(colours)] if upwards else [*colours]
        directions = (
            ("from the bottom to the top", "from bottom to top", "from base to top")
            if upwards
            else ("from top to bottom", "from the top to the bottom", "from top to base")
        )
        direction = self.choice(directions)
        named = self.pick(", ".join(order), f"{', '.join(order[:-1])} and {order[-1]}", " then ".join(order))
        text = self.pick(
            f"{self.pick('there is a', 'one of the towers is a', 'there is one')} {tower} that is {named} {direction}",
            f"there is a {tower} with {item} that are {named} {direction}",
            f"{self.a(tower)} is {named} {direction}",
            f"{self.a(tower)} has {named} {item} {direction}",
        ).replace("one of the towers is a ", f"one of the {pluralised(tower)} is a ")
        positions = (*("bottom", "second", "third")[: len(colours) - 1], "top")
        tests = [f"count({items_in_box(BOX)}) == {len(colours)}"]
        for position, colour in zip(positions, reversed(colours), strict=True):
            tests.append(self.existence_at_position(position, AttributeWords((colour,)), BOX))
        quantity = exactly(1) if "there is one " in text else SOME
        boxes = boxes_where(" and ".join([f"{BOX}.is_tower()", *tests]))
        return TrainingPair(text, quantity_test(quantity, boxes))

    def towers_alike(self) -> TrainingPair:
        """Towers with the same height, top colour or base colour."""
        nouns = pluralised(self.style.tower)
        what = self.pick("height", "height", "top", "base", "base")
        if self.chance(0.5):
            return self.all_towers_alike(what, nouns)
        two = self.pick("two", "2", "at least two", "at least 2", "exactly two", "exactly 2", "only two")
        words = {
            "height": ("of the same height", "with the same height", "that have the same height",
                       f"with the same number of {pluralised(self.style.item)}", "of same height", "of equal height"),
            "top": ("with the same color top", "with the same top color", "with tops of the same color",
                    "with the same color at the top", "that have the same color on top"),
            "base": ("with the same color base", "with the same base color", "with bases of the same color",
                     "with the same color at the base", "that have the same color at the bottom"),
        }[what]  # fmt: skip
        text = f"there {self.be(True)} {two} {nouns} {self.choice(words)}"
        return TrainingPair(text, self.pairs_alike(what, exact=two.startswith(("exactly", "only"))))

    def pairs_alike(self, what: str, *, exact: bool) -> str:
        """Tests that two towers are alike; with `exact`, exactly one pair is."""
        if what == "height":
            same = "count(p[0].all_items_in_box()) == count(p[1].all_items_in_box())"
        else:
            test = POSITION_TESTS["top" if what == "top" else "bottom"]
            ends = (f"filter_obj({items_in_box(f'p[{index}]')}, lambda x: {test}(x))" for index in (0, 1))
            same = " == ".join(f"query_color({end})" for end in ends)
        pairs = f"filter_obj(combinations({TOWERS}, 2), lambda p: {same})"
        return f"count({pairs}) == 1" if exact else f"exist({pairs})"

    def all_towers_alike(self, what: str, nouns: str) -> TrainingPair:
        tower = self.style.tower
        same = self.chance(0.75)
        subject = self.pick(
            f"all {nouns}", f"all the {nouns}", f"all three {nouns}", f"the {nouns}", f"the three {nouns}",
            f"every {tower}", f"each of the {nouns}",
        )  # fmt: skip
        plural = not subject.startswith(("every", "each"))
        name = {"height": self.pick("height", f"number of {pluralised(self.style.item)}"),
                "top": self.pick("color at the top", "top color", "color on top"),
                "base": self.pick("color at the base", "base color", "color base",
                    "color at the bottom")}[what]  # fmt: skip
        if not same:
            subject = self.pick(f"not all {nouns}", f"not all the {nouns}", f"not all of the {nouns}")
            plural = True
        text = f"{subject} {self.verb('has', plural)} {self.pick('the same', 'the same', 'same')} {name}"
        if what != "height":
            ends = f"filter_obj(all_items, lambda x: {POSITION_TESTS['top' if what == 'top' else 'bottom']}(x))"
            return TrainingPair(text, f"all_same_color({ends})" if same else f"ge(count(get_set_colors({ends})), 2)")
        three = same and "three" in subject
        towers = "all_boxes" if three else TOWERS
        test = f"all_same_attribute({towers}, lambda b: count(b.all_items_in_box()))"
        if three:
            return TrainingPair(text, f"All(all_boxes, lambda b: b.is_tower()) and {test}")
        return TrainingPair(text, test if same else f"NOT({test})")

    def touching_pair(self) -> TrainingPair:
        """ "two black blocks touching each other" """
        attributes = AttributeWords(self.colour())
        relation = self.pick(
            "touching each other", "stacked together", "on top of each other", "touching one another",
            "next to each other", "stacked on top of each other", "attached to each other", "one above the other",
            "stacked directly on each other",
        )  # fmt: skip
        nouns, attribute_test = self.noun(NounTemplate(attributes), True), attributes.tests()[0]
        draw = self.rng.random()
        if draw > 0.75:
            text = self.existential_words(f"two {pluralised(self.style.item)} of the same color {relation}")
            return TrainingPair(text, f"exist(filter_obj(all_items, lambda x: {ON_SAME_COLOUR}))")
        below = f"exist({item_set(NounTemplate(attributes), 'get_below(x)', 'y')})"
        number = self.pick("two", "2")
        if draw > 0.5:
            number = self.pick("three", "3")
            lower = f"exist({item_set(NounTemplate(attributes), 'get_below(y)', 'z')})"
            below = f"exist(filter_obj(get_below(x), lambda y: {bound(attribute_test, 'y')} and {lower}))"
        text = self.existential_words(f"{number} {nouns} {relation}")
        return TrainingPair(text, f"exist(filter_obj(all_items, lambda x: {bound(attribute_test, 'x')} and {below}))")

    def existential_words(self, text: str) -> str:
        return self.pick(
            f"there are {text}", f"there is a {self.style.tower} with {text}",
            f"one of the {pluralised(self.style.tower)} has {text}", f"there are {text}",
            f"there is a {self.style.box} with {text}", text,
        )  # fmt: skip

    def height_comparison(self) -> TrainingPair:
        """ "the left tower is taller than the right one" """
        one, other = self.rng.sample(range(3), 2)
        order, words = self.pick(
            (">", ("taller", "higher")), ("<", ("shorter", "smaller", "lower")), ("==", ("as tall",))
        )
        names = ("left", "middle", "right") if self.chance(0.7) else ("first", "second", "third")
        first, second = (
            f"the {names[one]} {self.style.tower}",
            f"the {names[other]} {self.pick('one', self.style.tower)}",
        )
        linking = "as" if order == "==" else "than"
        text = f"{first} is {self.choice(words)} {linking} {second}"
        if self.chance(0.3):
            more = {">": "more", "<": "fewer", "==": "as many"}[order]
            text = f"{first} has {more} {pluralised(self.style.item)} {linking} {second}"
        counts = [f"count(all_boxes[{index}].all_items_in_box())" for index in (one, other)]
        towers = f"all_boxes[{one}].is_tower() and all_boxes[{other}].is_tower()"
        return TrainingPair(text, f"{towers} and {counts[0]} {order} {counts[1]}")

    def coloured_towers(self) -> TrainingPair:
        """ "there is a black tower with two blocks" """
        colour = self.colour()[0]
        tower = self.style.tower
        quantity = self.pick(SOME, SOME, SOME, exactly(1), exactly(2), at_least(2), NONE)
        words = self.determiner(quantity)
        name = self.pick(
            f"{colour} {tower}", f"{colour} {tower}", f"all {colour} {tower}", f"fully {colour} {tower}",
            f"completely {colour} {tower}", f"{colour} colored {tower}",
        )  # fmt: skip
        name = pluralised(name) if words.plural else name
        named = Phrase(self.a(name) if words.text == "a" else f"{words.text} {name}", words.plural)
        test = f"{BOX}.is_tower() and All({items_in_box(BOX)}, lambda x: is_{colour}(x))"
        if self.chance(0.5):
            condition = self.height()
            test += f" and {condition.test(BOX)}"
            named = Phrase(f"{named.text} {self.box_modifier([condition], words.plural)}", words.plural)
        if quantity == SOME and self.chance(0.2):
            named = Phrase(
                f"one of the {pluralised(tower)} is {self.pick('all ', 'only ', 'completely ', '')}{colour}", False
            )
            test = f"{BOX}.is_tower() and All({items_in_box(BOX)}, lambda x: is_{colour}(x))"
            return TrainingPair(named.text, quantity_test(SOME, boxes_where(test)))
        return TrainingPair(self.existential(named), quantity_test(quantity, boxes_where(test)))

    def colours_by_position(self) -> TrainingPair:
        """ "the second block of a tower is black", "the first block is yellow and the second is blue" """
        item, tower = self.style.item, self.style.tower
        places = (
            ("bottom", ("first", "lowest", "bottom")), ("second", ("second",)), ("third", ("third",)),
            ("top", ("top", "top most", "uppermost", "last")),
        )  # fmt: skip
        number = self.pick(1, 1, 2)
        chosen = sorted(self.rng.sample(range(4), number))
        from_base = self.pick("", " from the bottom", " from the base")
        clauses: list[str] = []
        tests: list[str] = []
        for index in chosen:
            position, names = places[index]
            attributes = AttributeWords(self.colour())
            modifier = from_base if position in ("second", "third") else ""
            clauses.append(f"the {self.choice(names)} {item}{modifier} is {attributes.colours[0]}")
            tests.append(self.existence_at_position(position, attributes, BOX))
        somewhere = self.pick(f"in a {tower}", f"in one of the {pluralised(tower)}", f"in one {tower}")
        text = f"{somewhere} {' and '.join(clauses)}"
        if number == 1 and self.chance(0.6):
            first = clauses[0].rsplit(" is ", 1)
            of_tower = self.pick(
                f"of a {tower}", f"in a {tower}", f"of one of the {pluralised(tower)}", f"of one {tower}"
            )
            text = f"{first[0]} {of_tower} is {first[1]}"
        return TrainingPair(text, some_tower(" and ".join(tests)))
