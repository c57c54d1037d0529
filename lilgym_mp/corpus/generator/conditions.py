"""Synchronous templates for conditions of boxes: "two circles", "a black base", "nothing but squares"."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from lilgym_mp.corpus.generator.fragments import ALL_ITEMS, NONE, SOME, Quantity, at_least, at_most, exactly
from lilgym_mp.corpus.generator.writer import ANYTHING, HOLE, VALUES, Attributes, Noun, Predicate, Writer, verb_forms

ITEMS = ANYTHING.in_box()  # program text: the items of the tested box
TRIES = 12  # attempts to find compatible conditions
ORDERS = {"more": ">", "fewer": "<", "equal": "==", "at least": ">="}
TWO_COLOURS = (("yellow", "black"), ("yellow", "blue"), ("black", "blue"))


@dataclass(frozen=True, slots=True)
class Condition:
    """A condition of boxes: its words and its test. At least one of `contents` and `verb_forms` is set."""

    program: str  # test of a box
    contents: str | None = None  # follows "has" or "with"
    modifier: str | None = None  # follows the noun: "of three blocks"
    verb_forms: tuple[str, str] | None = None
    negative: bool = False  # listed last, after "but"
    kind: str = "contains"
    attributes: Attributes | None = None  # attributes of the counted items
    min_items: int = 0  # fewest items of a box that satisfies it
    max_items: int | None = None  # most items

    def test(self, box: str) -> str:
        """The program text that tests this box expression."""
        return self.program.replace(HOLE, box)


class BoxConditions(Writer):
    """Conditions of boxes of both appearances."""

    max_in_box: int  # items that a statement requires in one box

    # Each appearance has its own
    def some_attributes(self) -> Attributes:
        """Draws attributes for a noun."""
        raise NotImplementedError

    def attribute_name(self) -> str:
        """Draws one of the attributes that vary in the appearance: "color", "shape" or "size"."""
        raise NotImplementedError

    def attributes_without(self, attribute: str) -> Attributes:
        """Random attributes with no value for `attribute`."""
        raise NotImplementedError

    def predicate(self) -> Predicate:
        """Draws a predicate of items."""
        raise NotImplementedError

    def box_word(self) -> str:
        """Draws the annotator's word for a box."""
        raise NotImplementedError

    def condition(self) -> Condition:
        """Draws a condition of a box, by the probabilities in the phrase book."""
        draw = self.rng.random()
        for name, probability in self.book.conditions.items():
            draw -= probability
            if draw < 0:
                return getattr(self, name)()
        return self.contains_some()

    def some_noun(self) -> Noun:
        """A noun with random attributes and no predicates."""
        return Noun(self.some_attributes())

    def two_disjoint_nouns(self) -> tuple[Noun, Noun]:
        """Noun phrases of attribute words such that no item matches both."""
        while True:
            one = self.some_attributes()
            other = self.some_attributes()
            if disjoint(one, other):
                return Noun(one), Noun(other)

    # Words about several items

    def have_same(self, attribute: str) -> str:
        """Words for items that share the value of an attribute."""
        of_one = "in the same" if attribute == "color" else "of one"
        return self.say("have_same", attribute=attribute, of_one=of_one)

    def comparison(self, one: Noun, other: Noun, order: str, margin: int | None) -> str:
        """Words that compare two counts; `margin` gives the exact difference, None leaves it open."""
        first = self.noun(one, plural=True)
        second = self.noun(other, plural=True)
        same_shape = one.attributes.shape == other.attributes.shape and not one.predicates and not other.predicates
        if same_shape and other.attributes.colours and not other.attributes.size and self.chance(0.5):
            colours = " or ".join(other.attributes.colours)
            second = self.pick(f"{colours} ones", colours)
        if order in ("at least", "equal"):
            return self.say("as_many" if order == "equal" else "as_many_or_more", first=first, second=second)
        if margin is not None:
            return f"{self.pick('', 'exactly ')}{self.number(margin)} more {first} than {second}"
        word = "more" if order == "more" else self.pick("fewer", "less")
        return f"{word} {first} than {second}"

    def comparison_test(self, one: Noun, other: Noun, order: str, margin: int | None, source: str = ALL_ITEMS) -> str:
        """Program text for `comparison` of the items in `source`."""
        first = f"count({one.items(source)})"
        second = f"count({other.items(source)})"
        if margin is not None:
            return f"{first} == {second} + {margin}"
        return f"{first} {ORDERS[order]} {second}"

    # Lists of conditions

    def conditions(self, number: int) -> list[Condition]:
        """Compatible conditions, negative ones last; fewer than `number` if TRIES do not suffice."""
        found: list[Condition] = []
        for _ in range(TRIES):
            if len(found) == number:
                break
            condition = self.condition()
            if not any(clash(condition, other) for other in found):
                found.append(condition)
        return sorted(found, key=lambda condition: (condition.negative, condition.modifier is None))

    def two_conditions(self) -> tuple[Condition, Condition]:
        """Draws two conditions that can hold together."""
        while len(found := self.conditions(2)) < 2:
            pass
        return found[0], found[1]

    def box_verb_phrase(self, conditions: Sequence[Condition], plural: bool) -> str:
        """The conditions as a verb phrase: "has two circles but no triangle"."""
        verb = self.say("has")
        parts: list[str] = []
        last_has = False
        for condition in conditions:
            if condition.contents is None or (condition.verb_forms is not None and self.chance(0.4)):
                assert condition.verb_forms is not None
                parts.append(condition.verb_forms[plural])
                last_has = False
            else:
                parts.append(condition.contents if last_has else f"{self.verb(verb, plural)} {condition.contents}")
                last_has = True
        return self.conjoined(parts, conditions)

    def box_modifier(self, conditions: Sequence[Condition], plural: bool) -> str:
        """The conditions as a modifier after the noun: "with two circles", "that has only blue blocks"."""
        first, *others = conditions
        all_contents = [condition.contents for condition in conditions if condition.contents is not None]
        other_contents = [condition.contents for condition in others if condition.contents is not None]
        if first.modifier is not None and (first.contents is None or self.chance(0.5)):
            if not others:
                return first.modifier
            if len(other_contents) == len(others):
                tail = self.conjoined(other_contents, others)
                return f"{first.modifier} {self.pick('with', 'with', 'and', 'that has')} {tail}"
        if len(all_contents) < len(conditions) or self.chance(0.25):
            which = self.pick("that", "that", "which", "which")
            return f"{which} {self.box_verb_phrase(conditions, plural)}"
        opening = self.say("with")
        if opening == "consisting of" and any(condition.kind in ("contains", "predicate") for condition in conditions):
            opening = "with"  # "a tower consisting of two black blocks" has no others
        if opening == "that contains":
            opening = f"that {self.verb('contains', plural)}"
        if opening in ("consisting of", "in which there is", "where there is") and any(c.negative for c in conditions):
            opening = "with"
        return f"{opening} {self.conjoined(all_contents, conditions)}"

    def conjoined(self, parts: Sequence[str], conditions: Sequence[Condition]) -> str:
        """Parts joined by commas and conjunctions, "but" before a negative condition."""
        text = parts[0] if parts else ""
        for index, part in enumerate(parts[1:], start=1):
            negative = index < len(conditions) and conditions[index].negative
            if negative:
                conjunction = self.pick(" but ", " and ", ", but ")
            elif index < len(parts) - 1:
                conjunction = self.pick(", ", " and ")
            else:
                conjunction = self.pick(" and ", " and ", " and ", ", and ", " and also ", " as well as ")
            text += conjunction + part
        return text

    # Conditions

    def contains(self, quantity: Quantity, noun: Noun) -> Condition:
        """The condition that the box contains a quantity of the noun's items."""
        text = self.quantified(quantity, noun).text
        kind = "predicate" if noun.predicates else "contains"
        test = quantity.test(noun.in_box())
        return Condition(test, text, kind=kind, attributes=noun.attributes, min_items=quantity.low)

    def contains_some(self) -> Condition:
        """Draws a condition on the number of items with some attributes."""
        noun = self.some_noun()
        quantity = self.quantity_in_box()
        return self.contains(quantity, noun)

    def contains_with_predicate(self) -> Condition:
        """Draws a condition on the number of items that satisfy a predicate within the box."""
        predicate = self.predicate_within_box()
        return self.contains(self.quantity_in_box(3), Noun(self.some_attributes(), (predicate,)))

    def predicate_within_box(self) -> Predicate:
        """A random predicate that does not say which box the item is in."""
        while (predicate := self.predicate()).kind == "box":
            pass
        return predicate

    def contains_none(self) -> Condition:
        """Draws a condition that the box has no such items."""
        noun = self.some_noun()
        text = self.noun(noun, plural=self.chance(0.5))
        does = f"does not {self.pick('have', 'contain')}"
        do = f"do not {self.pick('have', 'contain')}"
        anything = self.pick("any ", "any ", "") + self.noun(noun, plural=True)
        without = f"without {self.pick('any ' + text, self.a(self.noun(noun, False)), self.noun(noun, True))}"
        forms = f"{does} {anything}", f"{do} {anything}"
        test = NONE.test(noun.in_box())
        return Condition(test, f"no {text}", without, forms, negative=True, attributes=noun.attributes)

    def contains_only(self) -> Condition:
        """Draws a condition that all items of the box have some attributes."""
        attributes = self.some_attributes()
        predicate = self.attribute_predicate(attributes)
        nouns = self.described_noun(attributes, plural=True)
        contents = self.say("only", nouns=nouns)
        modifier = None
        forms = None
        if attributes.shape is None and attributes.size is None:
            colour = predicate.complement
            contents = self.say("only_coloured", only=contents, colour=colour)
            modifier = self.say("only_modifier", nouns=nouns, colour=colour) or None
            forms = self.pick(None, verb_forms(f"is made of only {nouns}"))
        test = f"All({ITEMS}, lambda x: {predicate.signed_test('x')})"
        return Condition(test, contents, modifier, forms, kind="only")

    def box_variety(self) -> Condition:
        """Draws a condition on the number of different colours, shapes or sizes in the box."""
        attribute = self.attribute_name()
        number = self.pick(1, 2, 2, 3, 3)
        words = self.say(f"variety_{number}", attribute=attribute)
        quantity = exactly(number)
        if self.chance(0.2):
            side, quantity = ("least", at_least(2)) if self.chance(0.7) else ("most", Quantity(1, 2))
            words = self.say(f"variety_at_{side}_2", attribute=attribute)
        contents = f"{self.word('items')} {self.pick('of', 'of', 'in', 'with')} {words}"
        if quantity.low > 1 and (attribute != "shape" or "different" in words) and self.chance(0.4):
            contents = words
        if quantity == exactly(1) and self.chance(0.4):
            contents = self.say("of_one_value", attribute=attribute)
        test = quantity.test(f"get_set_{attribute}s({ITEMS})")
        return Condition(test, contents, kind="variety", min_items=quantity.low)

    def contains_more(self) -> Condition:
        """Draws a comparison of two counts within the box."""
        one, other = self.two_disjoint_nouns()
        order = self.pick("more", "more", "fewer", "equal")
        words = self.comparison(one, other, order, None)
        return Condition(self.comparison_test(one, other, order, None, ITEMS), words, kind="comparison")

    def total_and_part(self) -> Condition:
        """ "four items of which two are blue" """
        attributes = self.some_attributes()
        total = self.pick(2, 3, 3, 4, 4, self.max_in_box)
        part = self.choice(range(1, total))
        complement = self.attribute_predicate(attributes).complement
        named = self.quantified(exactly(total), ANYTHING).text
        which = self.say("of_which")
        exact = self.pick("", "", "exactly ", "only ")
        if attributes.shape:
            complement = self.described_noun(attributes, part > 1)
            complement = self.a(complement) if part == 1 else complement
        text = f"{named} {which} {exact}{self.number(part)} {self.be(part > 1)} {complement}"
        test = f"count({ITEMS}) == {total} and count({Noun(attributes).in_box()}) == {part}"
        return Condition(test, text, kind="total", attributes=attributes, min_items=total, max_items=total)

    def every_item_in_box(self) -> Condition:
        """ "all circles touching a wall" """
        noun = self.pick(ANYTHING, self.some_noun(), self.some_noun())
        predicate = self.predicate_within_box()
        nouns = self.noun(noun, plural=True)
        contents = f"{self.pick('all', 'all the', 'all its')} {nouns} {self.signed_complement(predicate)}"
        return Condition(f"All({noun.in_box()}, lambda x: {predicate.signed_test('x')})", contents, kind="all")

    def single_item(self) -> Condition:
        """ "only one item, which is blue" """
        attributes = self.some_attributes()
        complement = self.attribute_predicate(attributes).complement
        text = self.say("which_is", single=self.quantified(exactly(1), ANYTHING).text, what=complement)
        test = f"count({ITEMS}) == 1 and exist({Noun(attributes).in_box()})"
        return Condition(test, text, kind="total", min_items=1, max_items=1)

    def total_in_box(self, most: int = 8) -> Condition:
        """Draws a condition on the number of items in the box, with numbers up to `most`."""
        number = self.choice(range(1, most + 1))
        few = at_most(number) if number > 1 else exactly(1)
        quantity = self.pick(exactly(number), exactly(number), exactly(number), at_least(number), few)
        text = self.quantified(quantity, ANYTHING).text
        modifier = self.pick(None, f"of {text}", f"made of {text}", f"consisting of {text}")
        return self.total(quantity, text, modifier)

    def total(
        self, quantity: Quantity, text: str, modifier: str | None = None, verb_forms: tuple[str, str] | None = None
    ) -> Condition:
        """The condition that the box has a quantity of items."""
        test = quantity.test(ITEMS)
        low, high, _ = quantity
        return Condition(test, text, modifier, verb_forms, kind="total", min_items=low, max_items=high)

    def items_alike(self) -> Condition:
        """ "two circles of the same color" """
        attribute = self.attribute_name()
        noun = Noun(self.attributes_without(attribute))
        number = self.pick(2, 2, 2, 3)
        named = f"{self.pick('', '', 'at least ')}{self.number(number)} {self.noun(noun, True)}"
        same = self.pick("of the same", "of the same", "of same", "with the same", "in the same")
        groups = f"combinations({noun.in_box()}, {number})"
        test = f"exist(filter_obj({groups}, lambda p: all_same_{attribute}(p)))"
        return Condition(test, f"{named} {same} {attribute}", kind="alike", min_items=number)

    def either_item(self) -> Condition:
        """ "either a circle or a square" """
        first, second = self.two_disjoint_nouns()
        text = f"{self.pick('either ', '')}{self.indefinite(first)} or {self.indefinite(second)}"
        return Condition(f"(exist({first.in_box()}) or exist({second.in_box()}))", text, kind="either")

    def one_of_each_value(self) -> Condition:
        """ "a block of each color" """
        attribute = self.attribute_name()
        noun = Noun(self.attributes_without(attribute))
        number = self.pick(1, 1, 1, 2)
        each = self.say("of_each", attribute=attribute)
        each = each if "all" not in each or number > 1 else f"each {attribute}"
        count = "" if number > 1 or self.chance(0.6) else self.pick("exactly ", "only ")
        quantity = exactly(number) if number > 1 or count else SOME
        one = quantity == SOME
        named = self.indefinite(noun) if one else f"{count}{self.number(number)} {self.noun(noun, number > 1)}"
        values = [{"colours": (name,)} if attribute == "color" else {attribute: name} for name in VALUES[attribute]]
        nouns = [Noun(replace(noun.attributes, **value)) for value in values]
        test = " and ".join(quantity.test(each.in_box()) for each in nouns)
        return Condition(test, f"{named} of {each}", kind="variety", min_items=3 * number)

    def exactly_these(self) -> Condition:
        """ "only a circle and two squares": nothing else."""
        nouns = self.two_disjoint_nouns()
        counted = list(zip(nouns, (self.pick(1, 1, 2, 2, 3), self.pick(1, 1, 2)), strict=True))
        first, second = (
            self.indefinite(noun)
            if number == 1 and self.chance(0.4)
            else f"{self.number(number)} {self.noun(noun, number > 1)}"
            for noun, number in counted
        )
        total = sum(number for _, number in counted)
        items = f"{self.number(total)} {self.noun(ANYTHING, True)}"
        text = self.say("exactly_these", first=first, second=second, total=items)
        tests = [f"count({noun.in_box()}) == {number}" for noun, number in counted]
        test = " and ".join([f"count({ITEMS}) == {total}", *tests])
        return Condition(test, text, kind="total", min_items=total, max_items=total)

    def some_and_others(self) -> Condition:
        """ "one black item and two other items", "one black item and the rest yellow" """
        attributes = Attributes(self.colour())
        noun = Noun(attributes)
        number = self.pick(1, 1, 2)
        first = self.quantified(exactly(number), noun).text
        test = f"count({noun.in_box()}) == {number}"
        if self.chance(0.5):
            others = self.pick(1, 2, 2, 3)
            other = f"{self.number(others)} {self.pick('other', 'more', 'other')} {self.noun(ANYTHING, others > 1)}"
            total = number + others
            test = f"count({ITEMS}) == {total} and {test}"
            return Condition(test, f"{first} and {other}", kind="total", min_items=total, max_items=total)
        rest = Attributes(self.colour())
        while rest == attributes:
            rest = Attributes(self.colour())
        the_rest = self.say("the_rest")
        rest_name = self.described_noun(rest, plural=True) if self.chance(0.2) else rest.colours[0]
        text = f"{first} and {the_rest} {self.pick('are ', '', 'are ')}{rest_name}"
        (either,) = Attributes((*attributes.colours, *rest.colours)).tests()
        only = f"All({ITEMS}, lambda x: {either.replace(HOLE, 'x')})"
        test = f"{test} and exist({Noun(rest).in_box()}) and {only}"
        return Condition(test, text, kind="only", min_items=number + 1)

    def all_different(self) -> Condition:
        """ "no two items of the same color" """
        attribute = self.attribute_name()
        test = f"exist({ITEMS}) and count({ITEMS}) == count(get_set_{attribute}s({ITEMS}))"
        return Condition(test, self.say("all_different", attribute=attribute), kind="variety", min_items=2)


def disjoint(one: Attributes, other: Attributes) -> bool:
    """Whether no item can match both, so that comparing their counts makes sense."""
    if one == other:
        return False
    colours = one.colours and other.colours and not set(one.colours) & set(other.colours)
    shapes = one.shape and other.shape and one.shape != other.shape
    sizes = one.size and other.size and one.size != other.size
    return bool(colours or shapes or sizes)


ONLY_WITH_TOTALS = frozenset({"only", "comparison", "variety", "alike"})  # kinds compatible only with total counts
POSITION_KINDS = frozenset({"top", "bottom", "second", "third", "middle", "ends", "same ends", "alternating", "stack"})
COLOUR_KINDS = POSITION_KINDS | ONLY_WITH_TOTALS | {"contains", "predicate"}


def clash(one: Condition, other: Condition) -> bool:
    """Whether the two conditions are contradictory or redundant, or read oddly together."""
    kinds = {one.kind, other.kind}
    if len(kinds) == 1 and one.kind not in ("contains", "predicate"):
        return True
    if kinds & ONLY_WITH_TOTALS and kinds <= COLOUR_KINDS:
        return "only" in kinds or "comparison" in kinds or len(kinds & ONLY_WITH_TOTALS) > 1
    if ("ends" in kinds and kinds & {"top", "bottom", "same ends", "middle"}) or {"same ends", "top"} == kinds:
        return True
    if "only" in kinds and (one.attributes is not None or other.attributes is not None):
        return True
    same_items = one.attributes is not None and one.attributes == other.attributes
    if same_items and (one.negative or other.negative or one.kind == other.kind):
        return True
    return (one.negative and other.negative) or _lacks_room(one, other) or _lacks_room(other, one)


def _lacks_room(one: Condition, other: Condition) -> bool:
    """Whether `one` allows too few items for `other`, or exactly as many, which would be redundant."""
    if one.max_items is None:
        return False
    return other.min_items > one.max_items or (other.min_items == one.max_items and other.kind not in POSITION_KINDS)
