"""Synchronous templates for conditions of boxes: "two circles", "a black base", "nothing but squares"."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from lilgym_mp.corpus.generator.lexicon import pluralised
from lilgym_mp.corpus.generator.phrases import (
    ANYTHING,
    COLOURS,
    HOLE,
    SHAPES,
    AttributeWords,
    NounTemplate,
    PhraseTemplates,
    PredicateTemplate,
    TrainingPair,
    bound,
    box_items,
    item_set,
)
from lilgym_mp.corpus.generator.program_text import items_in_box, quantity_test
from lilgym_mp.corpus.generator.quantities import NONE, SOME, Quantity, at_least, at_most, exactly

ITEMS = items_in_box(HOLE)  # program text: the items of the tested box
TRIES = 12  # attempts to find compatible conditions
BOX_WORDS = (("left", "first", "left most"), ("middle", "second", "center"), ("right", "third", "last"))
ORDERS = {"more": ">", "fewer": "<", "equal": "==", "at least": ">="}
TWO_COLOURS = (("yellow", "black"), ("yellow", "blue"), ("black", "blue"))


@dataclass(frozen=True, slots=True)
class ConditionTemplate:
    """A condition of boxes: its words and its test. At least one of `contents` and `verb_forms` is set."""

    program: str  # test of a box
    contents: str | None = None  # follows "has" or "with"
    modifier: str | None = None  # follows the noun: "of three blocks"
    verb_forms: tuple[str, str] | None = None  # singular and plural
    negative: bool = False  # listed last, after "but"
    kind: str = "contains"
    attributes: AttributeWords | None = None  # attributes of the counted items
    min_items: int = 0  # fewest items of a box that satisfies it
    max_items: int | None = None  # most items

    def test(self, box: str) -> str:
        """The program text that tests this box expression."""
        return self.program.replace(HOLE, box)


WeightedTemplate = tuple[float, Callable[[], TrainingPair]]  # weight, template
WeightedCondition = tuple[float, Callable[[], ConditionTemplate]]  # probability, template; else `contains_some`


class BoxConditionTemplates(PhraseTemplates):
    """Conditions of boxes of both appearances."""

    max_in_box = 6  # items that a statement requires in one box

    # Each appearance has its own
    @cached_property
    def weighted_statements(self) -> Sequence[WeightedTemplate]: ...
    @cached_property
    def weighted_conditions(self) -> Sequence[WeightedCondition]: ...
    def attributes(self) -> AttributeWords: ...
    def attribute_name(self) -> str: ...
    def attributes_without(self, attribute: str) -> AttributeWords: ...  # random words with no value for the attribute
    def predicate(self) -> PredicateTemplate: ...
    def box_word(self) -> str: ...
    def box_count(self) -> TrainingPair: ...

    def condition(self) -> ConditionTemplate:
        draw = self.rng.random()
        for probability, make in self.weighted_conditions:
            draw -= probability
            if draw < 0:
                return make()
        return self.contains_some()

    def colour(self) -> tuple[str, ...]:
        return (self.choice(COLOURS),)

    def two_disjoint_nouns(self) -> tuple[NounTemplate, NounTemplate]:
        """Noun phrases of attribute words such that no item matches both."""
        while not disjoint(one := self.attributes(), other := self.attributes()):
            pass
        return NounTemplate(one), NounTemplate(other)

    # Words about several items

    def have_same(self, attribute: str) -> str:
        return self.pick(
            f"have the same {attribute}", f"are the same {attribute}", f"are of the same {attribute}",
            f"are of same {attribute}", f"share the same {attribute}", f"have same {attribute}",
            f"are in the same {attribute}" if attribute == "color" else f"are of one {attribute}",
            f"have only one {attribute}",
        )  # fmt: skip

    def variety_words(self, attribute: str, number: int) -> str:
        name = f"{attribute}s"
        if number == 1:
            return self.pick(
                f"only one {attribute}", f"a single {attribute}", f"the same {attribute}", f"only 1 {attribute}",
                f"one {attribute}", f"just one {attribute}",
            )  # fmt: skip
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

    def comparison(self, one: NounTemplate, other: NounTemplate, order: str, margin: int | None) -> str:
        first, second = self.noun(one, plural=True), self.noun(other, plural=True)
        same_shape = one.attributes.shape == other.attributes.shape and not one.predicates and not other.predicates
        if same_shape and other.attributes.colours and not other.attributes.size and self.chance(0.5):
            second = self.pick(f"{self.colours(other.attributes.colours)} ones", self.colours(other.attributes.colours))
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

    def comparison_test(
        self, one: NounTemplate, other: NounTemplate, order: str, margin: int | None, source: str
    ) -> str:
        first, second = f"count({item_set(one, source)})", f"count({item_set(other, source)})"
        if margin is not None:
            return f"{first} == {second} + {margin}"
        return f"{first} {ORDERS[order]} {second}"

    def conditions(self, number: int) -> list[ConditionTemplate]:
        """Compatible conditions, negative ones last; fewer than `number` if TRIES do not suffice."""
        found: list[ConditionTemplate] = []
        for _ in range(TRIES):
            if len(found) == number:
                break
            condition = self.condition()
            if not any(clash(condition, other) for other in found):
                found.append(condition)
        return sorted(found, key=lambda condition: (condition.negative, condition.modifier is None))

    def two_conditions(self) -> tuple[ConditionTemplate, ConditionTemplate]:
        while len(found := self.conditions(2)) < 2:
            pass
        return found[0], found[1]

    def box_verb_phrase(self, conditions: Sequence[ConditionTemplate], plural: bool) -> str:
        """The conditions as a verb phrase: "has two circles but no triangle"."""
        verb = self.pick("has", "has", "has", "contains", "contains", "includes", "holds")
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

    def box_modifier(self, conditions: Sequence[ConditionTemplate], plural: bool) -> str:
        """The conditions as a modifier after the noun: "with two circles", "that has only blue blocks"."""
        first, *others = conditions
        if first.modifier is not None and (first.contents is None or self.chance(0.5)):
            rest = [condition for condition in others if condition.contents is not None]
            if len(rest) == len(others):
                tail = self.conjoined([text for condition in others if (text := condition.contents)], others)
                return (
                    f"{first.modifier} {self.pick('with', 'with', 'and', 'that has')} {tail}"
                    if tail
                    else first.modifier
                )
        if any(condition.contents is None for condition in conditions) or self.chance(0.25):
            which = self.pick("that", "that", "which", "which")
            return f"{which} {self.box_verb_phrase(conditions, plural)}"
        opening = self.pick(
            "with", "with", "with", "with", "with", "with", "containing", "having", "that contains", "consisting of",
            "in which there is", "where there is",
        )  # fmt: skip
        if opening == "consisting of" and any(condition.kind in ("contains", "predicate") for condition in conditions):
            opening = "with"  # "a tower consisting of two black blocks" has no others
        if opening == "that contains":
            opening = f"that {self.verb('contains', plural)}"
        if opening in ("consisting of", "in which there is", "where there is") and any(c.negative for c in conditions):
            opening = "with"
        contents = [condition.contents for condition in conditions if condition.contents]
        return f"{opening} {self.conjoined(contents, conditions)}"

    def conjoined(self, parts: Sequence[str], conditions: Sequence[ConditionTemplate]) -> str:
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

    def contains_some(self) -> ConditionTemplate:
        noun, quantity = NounTemplate(self.attributes()), self.quantity_in_box()
        return self.contains(quantity, noun)

    def contains(self, quantity: Quantity, noun: NounTemplate) -> ConditionTemplate:
        text = self.quantified(quantity, noun).text
        kind = "predicate" if noun.predicates else "contains"
        return ConditionTemplate(
            quantity_test(quantity, box_items(noun)),
            text,
            kind=kind,
            attributes=noun.attributes,
            min_items=quantity.low,
        )

    def contains_none(self) -> ConditionTemplate:
        noun = NounTemplate(self.attributes())
        text = self.noun(noun, plural=self.chance(0.5))
        does = (f"does not {self.pick('have', 'contain')}", f"do not {self.pick('have', 'contain')}")
        anything = self.pick("any ", "any ", "") + self.noun(noun, plural=True)
        without = f"without {self.pick('any ' + text, self.a(self.noun(noun, False)), self.noun(noun, True))}"
        verb_forms = (f"{does[0]} {anything}", f"{does[1]} {anything}")
        return ConditionTemplate(
            quantity_test(NONE, box_items(noun)),
            f"no {text}",
            without,
            verb_forms,
            negative=True,
            attributes=noun.attributes,
        )

    def contains_with_predicate(self) -> ConditionTemplate:
        predicate = self.predicate_within_box()
        return self.contains(self.quantity_in_box(3), NounTemplate(self.attributes(), (predicate,)))

    def predicate_within_box(self) -> PredicateTemplate:
        """A random predicate that does not say which box the item is in."""
        while (predicate := self.predicate()).kind == "box":
            pass
        return predicate

    def contains_only(self) -> ConditionTemplate:
        attributes = self.attributes()
        predicate = self.attribute_predicate(attributes)
        nouns = self.described_noun(attributes, plural=True)
        contents = self.pick(f"only {nouns}", f"only {nouns}", f"nothing but {nouns}", f"only {nouns} in it")
        modifier = None
        verb_forms = None
        if attributes.shape is None and attributes.size is None:
            all_items = f"all {pluralised(self.style.item)} {predicate.complement}"
            contents = self.pick(
                contents,
                f"only {predicate.complement} {pluralised(self.style.item)}",
                all_items,
                f"only {predicate.complement} color",
            )
            modifier = self.pick(
                None, f"made up of only {nouns}",
                f"where all {pluralised(self.style.item)} are {predicate.complement}",
                f"that is all {predicate.complement}", f"consisting of only {nouns}",
            )  # fmt: skip
            verb_forms = self.pick(None, (f"is made of only {nouns}", f"are made of only {nouns}"))
        return ConditionTemplate(
            f"All({ITEMS}, lambda x: {predicate.signed_test('x')})",
            contents,
            modifier,
            verb_forms,
            kind="only",
        )

    def box_variety(self) -> ConditionTemplate:
        attribute, number = self.attribute_name(), self.pick(1, 2, 2, 3, 3)
        words, quantity = self.variety_words(attribute, number), exactly(number)
        if self.chance(0.2):
            words, quantity = self.bounded_variety_words(attribute)
        nouns = pluralised(self.style.item)
        contents = f"{nouns} {self.pick('of', 'of', 'in', 'with')} {words}"
        if quantity.low > 1 and (attribute != "shape" or "different" in words) and self.chance(0.4):
            contents = words
        if quantity == exactly(1) and self.chance(0.4):
            contents = self.pick(
                f"all {nouns} of the same {attribute}", f"all {nouns} in the same {attribute}",
                f"only one {attribute}", f"{nouns} of same {attribute}",
            )  # fmt: skip
        return ConditionTemplate(
            quantity_test(quantity, f"get_set_{attribute}s({ITEMS})"), contents, kind="variety",
            min_items=quantity.low,
        )  # fmt: skip

    def bounded_variety_words(self, attribute: str) -> tuple[str, Quantity]:
        """Words for a bound on the number of values, with its quantity."""
        name, two = f"{attribute}s", self.number(2)
        least = (
            f"at least {two} {name}", f"at least {two} different {name}", f"more than one {attribute}",
            f"different {name}", f"more than {self.number(1)} {attribute}", f"{two} or more {name}",
        )  # fmt: skip
        most = (f"at most {two} {name}", f"no more than {two} {name}", f"less than {self.number(3)} {name}")
        return (self.choice(least), at_least(2)) if self.chance(0.7) else (self.choice(most), Quantity(1, 2))

    def contains_more(self) -> ConditionTemplate:
        one, other = self.two_disjoint_nouns()
        order = self.pick("more", "more", "fewer", "equal")
        words = self.comparison(one, other, order, None)
        return ConditionTemplate(self.comparison_test(one, other, order, None, ITEMS), words, kind="comparison")

    def total_and_part(self) -> ConditionTemplate:
        """ "four items of which two are blue" """
        attributes = self.attributes()
        total = self.pick(2, 3, 3, 4, 4, self.max_in_box)
        part = 1 + int(self.rng.random() * (total - 1))
        predicate = self.attribute_predicate(attributes)
        named = self.quantified(exactly(total), ANYTHING).text
        which = self.pick("of which", "of which", "out of which", "where", "and", "in which")
        exact = self.pick("", "", "exactly ", "only ")
        complement = self.described_noun(attributes, part > 1) if attributes.shape else predicate.complement
        if attributes.shape and part == 1:
            complement = self.a(complement)
        text = f"{named} {which} {exact}{self.number(part)} {self.be(part > 1)} {complement}"
        noun = NounTemplate(attributes)
        return ConditionTemplate(
            f"count({ITEMS}) == {total} and count({box_items(noun)}) == {part}", text,
            kind="total", attributes=attributes, min_items=total, max_items=total,
        )  # fmt: skip

    def every_item_in_box(self) -> ConditionTemplate:
        """ "all circles touching a wall" """
        noun = self.pick(ANYTHING, NounTemplate(self.attributes()), NounTemplate(self.attributes()))
        predicate = self.predicate_within_box()
        nouns = self.noun(noun, plural=True)
        contents = f"{self.pick('all', 'all the', 'all its')} {nouns} {self.signed_complement(predicate)}"
        return ConditionTemplate(
            f"All({box_items(noun)}, lambda x: {predicate.signed_test('x')})",
            contents,
            kind="all",
        )

    def single_item(self) -> ConditionTemplate:
        """ "only one item, which is blue" """
        attributes = self.attributes()
        predicate = self.attribute_predicate(attributes)
        one = self.quantified(exactly(1), ANYTHING).text
        text = self.pick(
            f"{one} which is {predicate.complement}", f"{one} and it is {predicate.complement}",
            f"{one}, which is {predicate.complement}", f"{one} and it's {predicate.complement}",
        )  # fmt: skip
        return ConditionTemplate(
            f"count({ITEMS}) == 1 and exist({box_items(NounTemplate(attributes))})", text,
            kind="total", min_items=1, max_items=1,
        )  # fmt: skip

    def total_in_box(self, most: int) -> ConditionTemplate:
        number = 1 + int(self.rng.random() * most)
        quantity = self.pick(
            exactly(number), exactly(number), exactly(number), at_least(number),
            at_most(number) if number > 1 else exactly(1),
        )  # fmt: skip
        text = self.quantified(quantity, ANYTHING).text
        modifier = self.pick(None, f"of {text}", f"made of {text}", f"consisting of {text}")
        return ConditionTemplate(
            quantity_test(quantity, ITEMS), text, modifier, kind="total",
            min_items=quantity.low, max_items=quantity.high,
        )  # fmt: skip

    def items_alike(self) -> ConditionTemplate:
        """ "two circles of the same color" """
        attribute = self.attribute_name()
        noun, number = NounTemplate(self.attributes_without(attribute)), self.pick(2, 2, 2, 3)
        text = (
            f"{self.pick('', '', 'at least ')}{self.number(number)} {self.noun(noun, True)} "
            f"{self.pick('of the same', 'of the same', 'of same', 'with the same', 'in the same')} {attribute}"
        )
        groups = f"combinations({box_items(noun)}, {number})"
        test = f"exist(filter_obj({groups}, lambda p: all_same_{attribute}(p)))"
        return ConditionTemplate(test, text, kind="alike", min_items=number)

    def either_item(self) -> ConditionTemplate:
        """ "either a circle or a square" """
        first, second = self.two_disjoint_nouns()
        text = f"{self.pick('either ', '')}{self.indefinite(first)} or {self.indefinite(second)}"
        return ConditionTemplate(
            f"(exist({box_items(first)}) or exist({box_items(second)}))",
            text,
            kind="either",
        )

    def one_of_each_value(self) -> ConditionTemplate:
        """ "a block of each color" """
        attribute = self.attribute_name()
        noun = NounTemplate(self.attributes_without(attribute))
        number = self.pick(1, 1, 1, 2)
        each = self.pick(
            f"each {attribute}", f"every {attribute}", f"each of the {attribute}s", f"all three {attribute}s",
            f"each of the three {attribute}s",
        )  # fmt: skip
        each = each if "all" not in each or number > 1 else f"each {attribute}"
        count = "" if number > 1 or self.chance(0.6) else self.pick("exactly ", "only ")
        quantity = exactly(number) if number > 1 or count else SOME
        named = (
            self.indefinite(noun) if quantity == SOME else f"{count}{self.number(number)} {self.noun(noun, number > 1)}"
        )
        names = {"color": COLOURS, "shape": SHAPES, "size": ("small", "medium", "big")}[attribute]
        values = [{"colours": (name,)} if attribute == "color" else {attribute: name} for name in names]
        nouns = [NounTemplate(replace(noun.attributes, **value)) for value in values]
        test = " and ".join(quantity_test(quantity, box_items(each)) for each in nouns)
        return ConditionTemplate(test, f"{named} of {each}", kind="variety", min_items=3 * number)

    def exactly_these(self) -> ConditionTemplate:
        """ "only a circle and two squares": nothing else."""
        noun_templates = self.two_disjoint_nouns()
        numbers = self.pick(1, 1, 2, 2, 3), self.pick(1, 1, 2)
        named = [
            self.indefinite(noun)
            if number == 1 and self.chance(0.4)
            else f"{self.number(number)} {self.noun(noun, number > 1)}"
            for noun, number in zip(noun_templates, numbers, strict=True)
        ]
        total = sum(numbers)
        item = f"{self.number(total)} {self.noun(ANYTHING, True)}"
        text = self.pick(
            f"only {named[0]} and {named[1]}", f"{named[0]} and {named[1]} only",
            f"{named[0]}, {named[1]} and nothing else", f"{item}, {named[0]} and {named[1]}",
            f"{item}: {named[0]} and {named[1]}", f"just {named[0]} and {named[1]}",
            f"exactly {item}, {named[0]} and {named[1]}",
        )  # fmt: skip
        tests = [f"count({box_items(noun)}) == {number}" for noun, number in zip(noun_templates, numbers, strict=True)]
        test = " and ".join([f"count({ITEMS}) == {total}", *tests])
        return ConditionTemplate(test, text, kind="total", min_items=total, max_items=total)

    def some_and_others(self) -> ConditionTemplate:
        """ "one black item and two other items", "one black item and the rest yellow" """
        attributes = AttributeWords(self.colour())
        noun, number = NounTemplate(attributes), self.pick(1, 1, 2)
        first = self.quantified(exactly(number), noun).text
        if self.chance(0.5):
            others = self.pick(1, 2, 2, 3)
            other = f"{self.number(others)} {self.pick('other', 'more', 'other')} {self.noun(ANYTHING, others > 1)}"
            total = number + others
            return ConditionTemplate(
                f"count({ITEMS}) == {total} and count({box_items(noun)}) == {number}",
                f"{first} and {other}", kind="total", min_items=total, max_items=total,
            )  # fmt: skip
        rest = AttributeWords(self.colour())
        while rest == attributes:
            rest = AttributeWords(self.colour())
        the_rest = self.pick(
            "the rest", "the others", f"all the other {pluralised(self.style.item)}",
            f"all other {pluralised(self.style.item)}", "all the others",
        )  # fmt: skip
        rest_name = self.described_noun(rest, plural=True) if self.chance(0.2) else rest.colours[0]
        text = f"{first} and {the_rest} {self.pick('are ', '', 'are ')}{rest_name}"
        either = AttributeWords((*attributes.colours, *rest.colours)).tests()[0]
        counts = f"count({box_items(noun)}) == {number} and exist({box_items(NounTemplate(rest))})"
        test = f"{counts} and All({ITEMS}, lambda x: {bound(either, 'x')})"
        return ConditionTemplate(test, text, kind="only", min_items=number + 1)

    def all_different(self) -> ConditionTemplate:
        """ "no two items of the same color" """
        attribute = self.attribute_name()
        nouns = pluralised(self.style.item)
        text = self.pick(
            f"no two {nouns} of the same {attribute}", f"no {nouns} of the same {attribute}",
            f"{nouns} all of different {attribute}s", f"all {nouns} of different {attribute}s",
        )  # fmt: skip
        test = f"exist({ITEMS}) and count({ITEMS}) == count(get_set_{attribute}s({ITEMS}))"
        return ConditionTemplate(test, text, kind="variety", min_items=2)


def disjoint(one: AttributeWords, other: AttributeWords) -> bool:
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


def clash(one: ConditionTemplate, other: ConditionTemplate) -> bool:
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
    if (
        one.attributes is not None
        and one.attributes == other.attributes
        and (one.negative or other.negative or one.kind == other.kind)
    ):
        return True
    if one.negative and other.negative:
        return True
    return any(_lacks_room(a, b) for a, b in ((one, other), (other, one)))


def _lacks_room(one: ConditionTemplate, other: ConditionTemplate) -> bool:
    """Whether `one` allows too few items for `other`, or exactly as many, which would be redundant."""
    if one.max_items is None:
        return False
    return other.min_items > one.max_items or (other.min_items == one.max_items and other.kind not in POSITION_KINDS)
