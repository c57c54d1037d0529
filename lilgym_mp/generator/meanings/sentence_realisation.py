"""Realises a meaning as an English statement, choosing at random among templates."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from typing import TypeGuard

from lilgym_mp.generator.lexicon import Phrase, Style, article, conjugated, listed, pluralised
from lilgym_mp.generator.meanings import semantics as sem
from lilgym_mp.generator.meanings.phrase_realisation import ATTRIBUTE_NAMES, BOX_NAMES, PhraseRealiser
from lilgym_mp.generator.quantities import NONE, SOME, Quantity, exactly

Template = Callable[[], str]
EACH_BOX = ALL_VALUES = exactly(3)  # every box; every value of an attribute
IN_TOTAL = ("in total", "altogether", "overall")
CONTRACTIONS = (
    ("There is ", "There's "),
    ("there is ", "there's "),
    (" does not ", " doesn't "),
    (" do not ", " don't "),
    (" is not ", " isn't "),
    (" are not ", " aren't "),
)


def random_style(rng: random.Random, appearance: str) -> Style:
    """A random style for statements about `appearance`."""
    item = "block" if appearance == "tower" else rng.choice(("item", "item", "object", "object", "thing", "shape"))
    return Style(
        item=item,
        tower=rng.choice(("tower", "tower", "tower", "tower", "stack")),
        wall=rng.choice(("wall", "wall", "edge", "side")),
        picture=rng.choice(("picture", "picture", "image")),
        digits=rng.random() < 0.2,
    )


def realise_statement(clause: sem.Clause, rng: random.Random, style: Style) -> str:
    """The clause as a sentence, mostly with a capital and full stop and sometimes with contractions."""
    text = SentenceRealiser(rng, style).clause(clause)
    if rng.random() < 0.25:
        for long, short in CONTRACTIONS:
            text = text.replace(long, short)
    draw = rng.random()
    if draw < 0.12:
        return text
    text = text[0].upper() + text[1:]
    return text if draw < 0.22 else text + "."


class SentenceRealiser(PhraseRealiser):
    """Realises clauses as lower-case sentences without a full stop."""

    def clause(self, clause: sem.Clause) -> str:
        return self.rng.choice(self.templates(clause))()

    def templates(self, clause: sem.Clause) -> Sequence[Template]:
        match clause:
            case sem.Count(quantity, noun):
                return self.item_count_templates(quantity, noun)
            case sem.PartitiveCount():
                return self.partitive_templates(clause)
            case sem.BoxCount():
                return self.box_count_templates(clause)
            case sem.EveryTower(conditions):
                word, articles = self.style.tower, ("", "the ", "of the ")
                return [
                    lambda: f"{self.pick('every', 'each')} {word} {self.box_verb_phrase(conditions, False)}",
                    lambda: f"all {self.pick(*articles)}{pluralised(word)} {self.box_verb_phrase(conditions, True)}",
                ]
            case sem.NamedBox():
                return self.named_box_templates(clause)
            case sem.EveryItem(noun, predicate, True):
                return self.every_item_templates(noun, predicate)
            case sem.EveryItem(noun, predicate):
                return [
                    lambda: f"not every {self.noun(noun, False)} {self.verb_phrase(predicate, False)}",
                    lambda: f"not all of the {self.noun(noun, True)} {self.verb_phrase(predicate, True)}",
                    lambda: f"not all {self.noun(noun, True)} {self.verb_phrase(predicate, True)}",
                ]
            case sem.CountComparison():
                return self.count_comparison_templates(clause)
            case sem.BoxComparison():
                return self.box_comparison_templates(clause)
            case sem.Variety(attribute, quantity):
                return self.variety_templates(ATTRIBUTE_NAMES[attribute], quantity)
            case sem.EqualCounts(noun, True):
                return [
                    lambda: (
                        f"all {self.pick('', 'three ', 'the ')}boxes have the same number of {self.noun(noun, True)}"
                    ),
                    lambda: f"each box has the same number of {self.noun(noun, True)}",
                    lambda: f"there are equally many {self.noun(noun, True)} in each box",
                ]
            case sem.EqualCounts(noun):
                return [
                    lambda: f"no two boxes have the same number of {self.noun(noun, True)}",
                    lambda: f"each box has a different number of {self.noun(noun, True)}",
                ]
            case sem.Parity(noun, even):
                parity = "even" if even else "odd"
                return [
                    lambda: f"the number of {self.noun(noun, True)} is {parity}",
                    lambda: f"there is an {parity} number of {self.noun(noun, True)}",
                    lambda: f"the {self.style.picture} has an {parity} number of {self.noun(noun, True)}",
                ]
            case sem.LargestBox(noun, conditions):
                return self.largest_box_templates(noun, conditions)
            case sem.Compound(conjunctive, clauses):
                return self.compound_templates(conjunctive, clauses)

    # Clauses about items

    def there_is(self, phrase: Phrase) -> str:
        return f"there {self.be(phrase.plural)} {phrase.text}"

    def opened(self, opening: str, phrase: Phrase) -> str:
        texts = {"there": self.there_is(phrase), "see": f"we see {phrase.text}"}
        return texts.get(opening, f"the {self.style.picture} has {phrase.text}")

    def item_count_templates(self, quantity: Quantity, noun: sem.NounPhrase) -> list[Template]:
        templates: list[Template] = [
            lambda: self.there_is(self.quantified(quantity, noun)),
            lambda: f"{self.pick('we', 'you can', 'I can')} see {self.quantified(quantity, noun).text}",
            lambda: self.picture_has(self.quantified(quantity, noun).text),
        ]
        if noun.predicates:
            templates += [lambda: self.subject_first(quantity, noun)] * 3
            if quantity == NONE:
                templates += [lambda: self.none_of(noun)] * 2
            return templates
        templates += [
            lambda: self.seen(self.quantified(quantity, noun)),
            lambda: f"in the {self.style.picture}, {self.there_is(self.quantified(quantity, noun))}",
            lambda: f"{self.there_is(self.quantified(quantity, noun))} in the {self.style.picture}",
            lambda: f"{self.there_is(self.quantified(quantity, noun))} {self.pick(*IN_TOTAL)}",
        ]
        if quantity == NONE:
            templates += [
                # one draw without effect keeps corpora of earlier seeds unchanged
                lambda: f"there {self.pick('are', 'are')} not any {self.noun(noun, True)}",
                lambda: self.picture_lacks(self.noun(noun, True)),
            ]
        elif quantity.low > 1 and not quantity.vague:
            templates.append(lambda: f"the number of {self.noun(noun, True)} is {self.bare_range(quantity)}")
        if quantity == SOME:
            templates += [
                lambda: f"somewhere there is {self.indefinite(noun)}",
                lambda: f"{self.indefinite(noun)} is {self.pick('in', 'inside')} one of the boxes",
            ]
        if quantity.low > 1 and noun == sem.NounPhrase(noun.description):
            templates.append(
                lambda: f"the {self.pick('', 'three ')}boxes hold {self.quantified(quantity, noun).text} in total"
            )
        return templates

    def picture_has(self, things: str) -> str:
        return f"the {self.style.picture} {self.pick('has', 'shows', 'contains')} {things}"

    def picture_lacks(self, things: str) -> str:
        return f"the {self.style.picture} does not {self.pick('show', 'have', 'contain')} any {things}"

    def quantity_of(self, has: sem.Count) -> Phrase:
        return self.quantified(has.quantity, has.noun)

    def bare_range(self, quantity: Quantity) -> str:
        """A quantity without its noun: "at least three"."""
        low, high = quantity.low, quantity.high
        if high is None:
            return self.pick(f"at least {self.number(low)}", f"greater than {self.number(low - 1)}")
        if low == high:
            return self.pick("", "exactly ") + self.number(low)
        return (
            f"{self.number(low)} or {self.number(high)}"
            if high == low + 1
            else f"between {self.number(low)} and {self.number(high)}"
        )

    def seen(self, phrase: Phrase) -> str:
        be = self.be(phrase.plural)
        return f"{phrase.text} {self.pick(f'{be} in the {self.style.picture}', f'{be} present', 'can be seen')}"

    def subject_first(self, quantity: Quantity, noun: sem.NounPhrase) -> str:
        """ "two circles touch a wall": the last predicate becomes the verb phrase."""
        predicate = noun.predicates[-1]
        subject = self.quantified(quantity, sem.NounPhrase(noun.description, noun.predicates[:-1]))
        return f"{subject.text} {self.verb_phrase(predicate, subject.plural)}"

    def none_of(self, noun: sem.NounPhrase) -> str:
        predicate = noun.predicates[-1]
        rest = sem.NounPhrase(noun.description, noun.predicates[:-1])
        plural = self.chance(0.3)
        if self.chance(0.4):
            return f"not a single {self.noun(rest, False)} {self.verb_phrase(predicate, False)}"
        return f"none of the {self.noun(rest, True)} {self.verb_phrase(predicate, plural)}"

    def partitive_templates(self, clause: sem.PartitiveCount) -> list[Template]:
        quantity, noun, partitive, predicate = clause.quantity, clause.noun, clause.partitive, clause.predicate

        def two_clauses() -> str:
            opening = self.pick("there", "picture", "see")
            text = self.opened(opening, self.quantified(quantity, noun))
            conjunction = self.pick(", and", " and", ", and")
            return f"{text}{conjunction} {self.partitive(partitive, quantity, predicate, 'them')}"

        if quantity == exactly(1) and partitive is sem.Partitive.ALL:
            singular = self.noun(noun, plural=False)
            return [
                two_clauses,
                lambda: f"the only {singular} {self.verb_phrase(predicate, False)}",
                lambda: f"the one and only {singular} {self.verb_phrase(predicate, False)}",
            ]
        return [two_clauses]

    def every_item_templates(self, noun: sem.NounPhrase, predicate: sem.Predicate) -> list[Template]:
        templates: list[Template] = [
            lambda: f"{self.pick('every', 'each')} {self.noun(noun, False)} {self.verb_phrase(predicate, False)}",
            lambda: f"all of the {self.noun(noun, True)} {self.verb_phrase(predicate, True)}",
            lambda: f"all {self.pick('', 'the ')}{self.noun(noun, True)} {self.verb_phrase(predicate, True)}",
        ]
        if not isinstance(predicate, sem.Matches) or not predicate.positive or noun.description != sem.Description():
            return templates
        description = predicate.description
        if noun == sem.ANYTHING:
            has = ("has", "contains")
            return [
                *templates,
                lambda: f"everything in the {self.style.picture} {self.verb_phrase(predicate, False)}",
                lambda: f"{self.pick('only', 'nothing but')} {self.description(description, True)} can be seen",
                lambda: f"there are only {self.description(description, True)}",
                lambda: f"the {self.style.picture} {self.pick(*has)} nothing but {self.description(description, True)}",
            ]
        if len(noun.predicates) == 1 and noun.predicates[0].positive:
            (given,) = noun.predicates
            return [
                *templates,
                *[lambda: f"only {self.description(description, True)} {self.verb_phrase(given, True)}"] * 2,
                lambda: f"everything that {self.verb_phrase(given, False)} {self.verb_phrase(predicate, False)}",
            ]
        return templates

    def count_comparison_templates(self, clause: sem.CountComparison) -> list[Template]:
        one, other, order = clause.one, clause.other, clause.order

        def compared() -> tuple[str, str]:
            """The words on both sides of the comparison; the second may be elliptical: "black ones"."""
            first = self.noun(one, True)
            same_noun = (
                one.description.shape == other.description.shape
                and len(other.description.colours) == 1
                and not other.predicates
            )
            if same_noun and other.description.size is None and self.chance(0.5):
                return first, f"{self.colours(other.description.colours)} ones"
            return first, self.noun(other, True)

        if order is sem.Order.EQUAL:
            return [
                lambda: "there are as many {} as {}".format(*compared()),
                lambda: f"the number of {self.noun(one, True)} equals the number of {self.noun(other, True)}",
                lambda: f"there are equally many {self.noun(one, True)} and {self.noun(other, True)}",
            ]
        margin = clause.margin
        amount = "" if margin is None else f"exactly {self.number(margin)} "
        be = "is" if margin == 1 else "are"
        word = str(order)

        def than() -> str:
            first, second = compared()
            if margin == 1:
                first = self.noun(one, False)
            return f"{amount}{word} {first} than {second}"

        templates: list[Template] = [
            lambda: f"there {be} {than()}",
            lambda: f"the {self.style.picture} has {than()}",
        ]
        if margin is None:
            templates.append(lambda: f"there are {word} {self.noun(one, True)} than there are {self.noun(other, True)}")
            if order is sem.Order.MORE:
                templates.append(lambda: "the {} outnumber the {}".format(*compared()))
        return templates

    def variety_templates(self, name: str, quantity: Quantity) -> list[Template]:
        items = pluralised(self.style.item)
        if quantity == exactly(1):
            return [
                lambda: f"all {self.pick('', 'the ', 'of the ')}{items} have the same {name}",
                lambda: f"there is only one {name} in the {self.style.picture}",
                lambda: f"every {self.style.item} has the same {name}",
            ]
        if quantity == ALL_VALUES:
            return [
                lambda: f"all three {name}s {self.pick('appear', 'occur', 'can be seen')} in the {self.style.picture}",
                lambda: f"there are {items} of all three {name}s",
            ]
        return [
            lambda: f"the {self.style.picture} has {items} of {self.different_values(quantity, name)}",
            lambda: f"we see {items} of {self.different_values(quantity, name)}",
            lambda: f"there are {items} of {self.different_values(quantity, name)}",
        ]

    # Clauses about boxes

    def box_count_templates(self, clause: sem.BoxCount) -> list[Template]:
        quantity, conditions, towers = clause.quantity, clause.conditions, clause.towers
        word = self.style.tower if towers else "box"
        nouns = pluralised(word)

        def boxes_with_modifier() -> str:
            named = self.described_boxes(quantity, conditions, towers)
            return self.opened(self.pick("there", "there", "see", "picture"), named)

        def boxes_as_subject() -> str:
            subject = self.box_subject(quantity, word)
            return f"{subject.text} {self.box_verb_phrase(conditions, subject.plural)}"

        if quantity == EACH_BOX:
            return [boxes_as_subject]
        templates: list[Template] = [boxes_with_modifier, boxes_with_modifier, boxes_as_subject]
        if (quantity.low == quantity.high and quantity.low) or (quantity.low and quantity.high is None):
            templates.append(lambda: self.partitive_boxes(quantity, nouns, conditions))
        if quantity == NONE:
            templates.append(lambda: f"none of the {nouns} {self.box_verb_phrase(conditions, False)}")
        match conditions:
            case (sem.Count(contained, noun),) if quantity == SOME and contained.low:
                templates.append(
                    lambda: f"{self.pick('in', 'inside')} some {word} {self.there_is(self.quantified(contained, noun))}"
                )
            case _:
                pass
        return templates

    def box_subject(self, quantity: Quantity, word: str) -> Phrase:
        nouns = pluralised(word)
        if quantity == EACH_BOX:
            text = self.pick(f"every {word}", f"each {word}", f"all {nouns}", f"all three {nouns}", f"all the {nouns}")
            return Phrase(text, text.startswith("all"))
        determiner = self.determiner(quantity)
        return Phrase(f"{determiner.text} {nouns if determiner.plural else word}", determiner.plural)

    def partitive_boxes(self, quantity: Quantity, nouns: str, conditions: sem.BoxConditions) -> str:
        if quantity.high is None:
            number = f"at least {self.number(quantity.low)}"
        else:
            number = f"{self.pick('exactly', 'only', 'just')} {self.number(quantity.low)}"
        return f"{number} of the {nouns} {self.box_verb_phrase(conditions, quantity.low > 1)}"

    def described_boxes(self, quantity: Quantity, conditions: sem.BoxConditions, towers: bool) -> Phrase:
        """ "two towers with a blue top"; a height or a single colour may come before the noun: "a blue tower"."""
        word = self.style.tower if towers else "box"
        determiner = self.determiner(quantity)
        first, rest = conditions[0], conditions[1:]
        noun = pluralised(word) if determiner.plural else word
        before, after = "", conditions
        if towers and _is_height(first) and self.chance(0.4):
            before, after = self.number(first.quantity.low) + "-block ", rest
        elif (
            towers and isinstance(first, sem.ContainsOnly) and len(first.description.colours) == 1 and self.chance(0.5)
        ):
            before, after = self.colours(first.description.colours) + " ", rest
        modifier = f" {self.box_modifier(after, determiner.plural, towers)}" if after else ""
        if determiner.text == "a":
            return Phrase(article(before + noun) + modifier, plural=False)
        return Phrase(f"{determiner.text} {before}{noun}{modifier}", determiner.plural)

    def box_modifier(self, conditions: sem.BoxConditions, plural: bool, towers: bool) -> str:
        """The conditions as a modifier after the noun: "with two circles", "that has no square"."""
        first = conditions[0]
        if towers and len(conditions) == 1 and _is_height(first) and self.chance(0.4):
            return self.tall(first.quantity, plural)
        if all(isinstance(condition, sem.EndColour) for condition in conditions) and not plural and self.chance(0.3):
            ends = [self.end_clause(end) for end in conditions if isinstance(end, sem.EndColour)]
            return " and ".join(f"whose {text}" for text in ends)
        if self.chance(0.25):
            return f"that {self.box_verb_phrase(conditions, plural)}"
        return f"with {self.all_contents(conditions)}"

    def tall(self, quantity: Quantity, plural: bool) -> str:
        height = f"of height {self.number(quantity.low)}"
        return self.pick(height, f"that {self.be(plural)} {self.blocks_tall(quantity)}")

    def blocks_tall(self, quantity: Quantity) -> str:
        blocks = "block" if quantity.low == 1 else "blocks"
        return f"{self.number(quantity.low)} {blocks} {self.pick('tall', 'high')}"

    def end_clause(self, end: sem.EndColour) -> str:
        names = (
            ("top", "top block") if end.position is sem.TowerPosition.TOP else ("base", "bottom block", "base block")
        )
        return f"{self.pick(*names)} is {self.colours(end.colours)}"

    def box_verb_phrase(self, conditions: sem.BoxConditions, plural: bool) -> str:
        """The conditions as a verb phrase: "has two circles and no square"."""
        only = conditions[0]
        if len(conditions) == 1 and only == sem.Count(NONE, sem.ANYTHING):
            return f"{self.be(plural)} empty"
        contents = all(isinstance(condition, (sem.Count, sem.ContainsOnly)) for condition in conditions)
        verb = self.pick("has", "contains", "holds") if contents else "has"
        return f"{conjugated(verb, plural)} {self.all_contents(conditions)}"

    def all_contents(self, conditions: sem.BoxConditions) -> str:
        first, *rest = conditions
        if _is_height(first) and rest and isinstance(rest[0], sem.Variety | sem.ContainsOnly):
            return listed([self.described_total(first.quantity, rest[0]), *map(self.contents, rest[1:])])
        texts = [self.contents(condition) for condition in conditions]
        negative = [isinstance(condition, sem.Count) and condition.quantity == NONE for condition in conditions]
        if len(conditions) > 1 and negative[-1] and not any(negative[:-1]):
            return f"{listed(texts[:-1])} but {texts[-1]}"
        return listed(texts)

    def described_total(self, quantity: Quantity, condition: sem.Variety | sem.ContainsOnly) -> str:
        """ "three blocks of two colors", "two objects, all of them blue" """
        number = self.quantified(quantity, sem.ANYTHING)
        if isinstance(condition, sem.Variety):
            items = pluralised(self.style.item)
            return number.text + self.variety(condition.attribute, condition.quantity, items).removeprefix(items)
        if quantity.low == 1:
            return f"{number.text}, which is {self.description_complement(condition.description, False)}"
        all_of = "both" if quantity.low == 2 else "all"
        return f"{number.text}, {all_of} of them {self.description_complement(condition.description, True)}"

    def named_box_templates(self, clause: sem.NamedBox) -> list[Template]:
        name = BOX_NAMES[clause.index]
        word = self.style.tower if clause.towers else "box"
        conditions = clause.conditions
        only = conditions[0]
        templates: list[Template] = [lambda: f"the {name} {word} {self.box_verb_phrase(conditions, False)}"]
        if len(conditions) > 1:
            return templates
        if isinstance(only, sem.EndColour):
            end = "top" if only.position is sem.TowerPosition.TOP else "base"
            templates.append(lambda: f"the {self.pick(end)} of the {name} {word} is {self.colours(only.colours)}")
        elif _is_height(only) and clause.towers:
            templates.append(lambda: f"the {name} {word} is {self.blocks_tall(only.quantity)}")
        elif isinstance(only, sem.Count) and only.noun != sem.ANYTHING:
            templates += [
                lambda: f"{self.pick('in', 'inside')} the {name} {word} {self.there_is(self.quantity_of(only))}",
                lambda: f"{self.there_is(self.quantity_of(only))} in the {name} {word}",
            ]
        return templates

    def box_comparison_templates(self, clause: sem.BoxComparison) -> list[Template]:
        one, other = BOX_NAMES[clause.one], BOX_NAMES[clause.other]
        noun, order = clause.noun, clause.order
        if clause.towers:
            tower = self.style.tower
            if order is sem.Order.EQUAL:
                return [
                    lambda: (
                        f"the {one} {tower} is as {self.pick('tall', 'high')} as the {other} {self.pick('one', tower)}"
                    ),
                    lambda: f"the {one} {tower} and the {other} {tower} have the same height",
                ]
            tall = ("taller", "higher") if order is sem.Order.MORE else ("shorter", "lower")
            return [lambda: f"the {one} {tower} is {self.pick(*tall)} than the {other} {self.pick('one', tower)}"]
        if order is sem.Order.EQUAL:
            return [
                lambda: f"the {one} box has as many {self.noun(noun, True)} as the {other} {self.pick('one', 'box')}",
                lambda: f"the {one} box and the {other} box have the same number of {self.noun(noun, True)}",
            ]
        return [
            lambda: f"the {one} box has {order} {self.noun(noun, True)} than the {other} {self.pick('one', 'box')}",
            lambda: f"there are {order} {self.noun(noun, True)} in the {one} box than in the {other} one",
        ]

    def largest_box_templates(self, noun: sem.NounPhrase, conditions: sem.BoxConditions) -> list[Template]:
        if noun != sem.ANYTHING or self.style.item != "block":
            return [lambda: f"the box with the most {self.noun(noun, True)} {self.box_verb_phrase(conditions, False)}"]
        name = f"the {self.pick('tallest', 'highest')} {self.style.tower}"
        templates: list[Template] = [lambda: f"{name} {self.box_verb_phrase(conditions, False)}"]
        match conditions:
            case (sem.EndColour(position, colours),):
                end = "top" if position is sem.TowerPosition.TOP else "base"
                templates.append(lambda: f"the {end} of {name} is {self.colours(colours)}")
            case _:
                pass
        return templates

    # Compounds

    def compound_templates(self, conjunctive: bool, clauses: tuple[sem.Clause, ...]) -> list[Template]:
        if conjunctive:
            templates: list[Template] = [lambda: self.conjoined(clauses)]
        else:
            templates = [
                lambda: f"either {' or '.join(self.clause(part) for part in clauses)}",
                lambda: ", or ".join(self.clause(part) for part in clauses),
            ]
        counts = [part for part in clauses if isinstance(part, sem.Count) and not part.noun.predicates]
        if len(counts) == len(clauses) and not any(_is_upper_bound(part.quantity) for part in counts):
            templates += [lambda: self.merged_counts(counts, conjunctive)] * 4
        return templates

    def conjoined(self, clauses: Sequence[sem.Clause]) -> str:
        *first, last = (self.clause(part) for part in clauses)
        joints = [", and", " and", ", and", ", while"]
        if _is_negative(clauses[-1]) != _is_negative(clauses[0]):
            joints = [", but", " but"]
        return f"{', '.join(first)}{self.pick(*joints)} {last}"

    def merged_counts(self, counts: Sequence[sem.Count], conjunctive: bool) -> str:
        """ "there are two circles and a blue square" """
        if conjunctive and all(part.quantity == NONE for part in counts):
            texts = [self.noun(part.noun, True) for part in counts]
            return f"there are {self.pick(f'neither {texts[0]} nor {texts[1]}', f'no {texts[0]} and no {texts[1]}')}"
        phrases = [self.quantified(part.quantity, part.noun) for part in counts]
        conjunction = (
            "or" if not conjunctive else "but" if _is_negative(counts[0]) != _is_negative(counts[-1]) else "and"
        )
        text = listed([phrase.text for phrase in phrases], conjunction)
        if conjunction == "and" and self.chance(0.2) and len(counts) == 2:
            text = f"both {text}"
        elif conjunction == "or" and self.chance(0.4) and len(counts) == 2:
            text = f"either {text}"
        opening = self.pick(f"there {self.be(phrases[0].plural)}", f"the {self.style.picture} has", "we see")
        return f"{opening} {text}"


def _is_height(condition: sem.BoxCondition) -> TypeGuard[sem.Count]:
    """Whether the condition fixes the number of items in the box."""
    match condition:
        case sem.Count(Quantity(low, high, False), noun):
            return low == high and low > 0 and noun == sem.ANYTHING
        case _:
            return False


def _is_upper_bound(quantity: Quantity) -> bool:
    """Whether the quantity is an upper bound, which would seem to apply to everything listed after it."""
    return quantity.low == 0 and quantity != NONE


def _is_negative(clause: sem.Clause) -> bool:
    match clause:
        case sem.Count(quantity, _) | sem.BoxCount(quantity, _, _):
            return quantity == NONE
        case sem.EveryItem(_, _, positive):
            return not positive
        case _:
            return False
