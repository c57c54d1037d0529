"""From a meaning to a statement, in one of many ways to say it."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence

from lilgym_mp.generator.phrase_realisation import (
    ATTRIBUTE_NAMES,
    BOX_NAMES,
    Phrase,
    Phrases,
    Style,
    article,
    conjugated,
    listed,
    pluralised,
)
from lilgym_mp.generator.semantics import (
    ANYTHING,
    NONE,
    SOME,
    BoxCount,
    BoxesCompared,
    BoxIs,
    Clause,
    Compared,
    Condition,
    Conditions,
    Ends,
    Evenly,
    Every,
    EveryTower,
    Extreme,
    Has,
    HasLook,
    ItemCount,
    Joined,
    Level,
    Look,
    NotEvery,
    Noun,
    Order,
    Parity,
    PictureVaried,
    Purely,
    Quantity,
    Share,
    SharedCount,
    Varied,
)

Frame = Callable[[], str]
EACH_BOX = Quantity(3, 3)
SHORT_FORMS = (
    ("There is ", "There's "),
    ("there is ", "there's "),
    (" does not ", " doesn't "),
    (" do not ", " don't "),
    (" is not ", " isn't "),
    (" are not ", " aren't "),
)


def random_style(rng: random.Random, appearance: str) -> Style:
    """How one writer of statements about `appearance` talks."""
    item = "block" if appearance == "tower" else rng.choice(("item", "item", "object", "object", "thing", "shape"))
    return Style(
        item=item,
        tower=rng.choice(("tower", "tower", "tower", "tower", "stack")),
        wall=rng.choice(("wall", "wall", "edge", "side")),
        picture=rng.choice(("picture", "picture", "image")),
        digits=rng.random() < 0.2,
    )


def statement(clause: Clause, rng: random.Random, style: Style) -> str:
    """The clause as a sentence: mostly with capital and full stop, now and then as people type."""
    text = Sentences(rng, style).clause(clause)
    if rng.random() < 0.25:
        for long, short in SHORT_FORMS:
            text = text.replace(long, short)
    manner = rng.random()
    if manner < 0.12:
        return text
    text = text[0].upper() + text[1:]
    return text if manner < 0.22 else text + "."


class Sentences(Phrases):
    """Whole statements, in lower case."""

    def clause(self, clause: Clause) -> str:
        return self.rng.choice(self.frames(clause))()

    def frames(self, clause: Clause) -> Sequence[Frame]:
        match clause:
            case ItemCount(quantity, noun):
                return self.count_frames(quantity, noun)
            case SharedCount():
                return self.share_frames(clause)
            case BoxCount():
                return self.box_frames(clause)
            case EveryTower(conditions):
                return self.each_tower_frames(conditions)
            case BoxIs():
                return self.named_box_frames(clause)
            case Every():
                return self.every_frames(clause)
            case NotEvery(noun, trait):
                return [
                    lambda: f"not every {self.noun(noun, False)} {self.predicate(trait, False)}",
                    lambda: f"not all of the {self.noun(noun, True)} {self.predicate(trait, True)}",
                    lambda: f"not all {self.noun(noun, True)} {self.predicate(trait, True)}",
                ]
            case Compared():
                return self.comparison_frames(clause)
            case BoxesCompared():
                return self.box_comparison_frames(clause)
            case PictureVaried(attribute, quantity):
                return self.variety_frames(ATTRIBUTE_NAMES[attribute], quantity)
            case Evenly(noun, same):
                return self.even_frames(noun, same)
            case Parity(noun, even):
                kind = "an even" if even else "an odd"
                return [
                    lambda: f"the number of {self.noun(noun, True)} is {kind[3:]}",
                    lambda: f"there is {kind} number of {self.noun(noun, True)}",
                    lambda: f"the {self.style.picture} has {kind} number of {self.noun(noun, True)}",
                ]
            case Extreme(noun, conditions):
                return self.extreme_frames(noun, conditions)
            case Joined(every, clauses):
                return self.joined_frames(every, clauses)

    # Items of the picture

    def there(self, phrase: Phrase) -> str:
        return f"there {self.be(phrase.plural)} {phrase.text}"

    def count_frames(self, quantity: Quantity, noun: Noun) -> list[Frame]:
        frames: list[Frame] = [
            lambda: self.there(self.quantified(quantity, noun)),
            lambda: f"{self.pick('we', 'you can', 'I can')} see {self.quantified(quantity, noun).text}",
            lambda: self.picture_has(self.quantified(quantity, noun).text),
        ]
        if noun.traits:
            frames += [lambda: self.subject_first(quantity, noun)] * 3
            if quantity == NONE:
                frames += [lambda: self.none_of(noun)] * 2
            return frames
        frames += [
            lambda: self.seen(self.quantified(quantity, noun)),
            lambda: f"in the {self.style.picture}, {self.there(self.quantified(quantity, noun))}",
            lambda: f"{self.there(self.quantified(quantity, noun))} in the {self.style.picture}",
            lambda: f"{self.there(self.quantified(quantity, noun))} {self.pick('in total', 'altogether', 'overall')}",
        ]
        if quantity == NONE:
            frames += [
                lambda: f"there {self.pick('is', 'are')} not any {self.noun(noun, True)}".replace(
                    "is not any", "are not any"
                ),
                lambda: self.picture_lacks(self.noun(noun, True)),
            ]
        elif quantity.low > 1 and not quantity.soft:
            frames.append(lambda: f"the number of {self.noun(noun, True)} is {self.bare_range(quantity)}")
        if quantity == SOME:
            frames += [
                lambda: f"somewhere there is {self.some(noun)}",
                lambda: f"{self.some(noun)} is {self.pick('in', 'inside')} one of the boxes",
            ]
        if quantity.low > 1 and noun == Noun(noun.look):
            frames.append(
                lambda: f"the {self.pick('', 'three ')}boxes hold {self.quantified(quantity, noun).text} in total"
            )
        return frames

    def picture_has(self, things: str) -> str:
        return f"the {self.style.picture} {self.pick('has', 'shows', 'contains')} {things}"

    def picture_lacks(self, things: str) -> str:
        return f"the {self.style.picture} does not {self.pick('show', 'have', 'contain')} any {things}"

    def quantity_of(self, has: Has) -> Phrase:
        return self.quantified(has.quantity, has.noun)

    def bare_range(self, quantity: Quantity) -> str:
        """A number without its noun: "at least three"."""
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

    def subject_first(self, quantity: Quantity, noun: Noun) -> str:
        """ "two circles touch a wall": the last trait is the verb phrase."""
        trait = noun.traits[-1]
        subject = self.quantified(quantity, Noun(noun.look, noun.traits[:-1]))
        return f"{subject.text} {self.predicate(trait, subject.plural)}"

    def none_of(self, noun: Noun) -> str:
        trait = noun.traits[-1]
        rest = Noun(noun.look, noun.traits[:-1])
        plural = self.chance(0.3)
        if self.chance(0.4):
            return f"not a single {self.noun(rest, False)} {self.predicate(trait, False)}"
        return f"none of the {self.noun(rest, True)} {self.predicate(trait, plural)}"

    def share_frames(self, clause: SharedCount) -> list[Frame]:
        quantity, noun, share, trait = clause.quantity, clause.noun, clause.share, clause.trait

        def told() -> str:
            opening = self.pick("there", "picture", "see")
            named = self.quantified(quantity, noun)
            picture = f"the {self.style.picture} has {named.text}"
            text = {"there": self.there(named), "picture": picture, "see": f"we see {named.text}"}[opening]
            joint = self.pick(", and", " and", ", and")
            return f"{text}{joint} {self.share(share, quantity, trait, 'them')}"

        if quantity == Quantity(1, 1) and share is Share.ALL:
            only = self.noun(noun, plural=False)
            return [
                told,
                lambda: f"the only {only} {self.predicate(trait, False)}",
                lambda: f"the one and only {only} {self.predicate(trait, False)}",
            ]
        return [told]

    def every_frames(self, clause: Every) -> list[Frame]:
        noun, predicate = clause.noun, clause.trait
        frames: list[Frame] = [
            lambda: f"{self.pick('every', 'each')} {self.noun(noun, False)} {self.predicate(predicate, False)}",
            lambda: f"all of the {self.noun(noun, True)} {self.predicate(predicate, True)}",
            lambda: f"all {self.pick('', 'the ')}{self.noun(noun, True)} {self.predicate(predicate, True)}",
        ]
        if not isinstance(predicate, HasLook) or not predicate.holds or noun.look != Look():
            return frames
        look = predicate.look
        if noun == ANYTHING:
            return [
                *frames,
                lambda: f"everything in the {self.style.picture} {self.predicate(predicate, False)}",
                lambda: f"{self.pick('only', 'nothing but')} {self.look(look, True)} can be seen",
                lambda: f"there are only {self.look(look, True)}",
                lambda: f"the {self.style.picture} {self.pick('has', 'contains')} nothing but {self.look(look, True)}",
            ]
        if len(noun.traits) == 1 and noun.traits[0].holds:
            return [
                *frames,
                *[lambda: f"only {self.look(look, True)} {self.predicate(noun.traits[0], True)}"] * 2,
                lambda: f"everything that {self.predicate(noun.traits[0], False)} {self.predicate(predicate, False)}",
            ]
        return frames

    def comparison_frames(self, clause: Compared) -> list[Frame]:
        one, other, order = clause.one, clause.other, clause.order

        def compared() -> tuple[str, str]:
            """The words for "more blue items" and what follows "than"."""
            first = self.noun(one, True)
            same_noun = one.look.shape == other.look.shape and len(other.look.colours) == 1 and not other.traits
            if same_noun and other.look.size is None and self.chance(0.5):
                return first, f"{self.colours(other.look.colours)} ones"
            return first, self.noun(other, True)

        if order is Order.EQUAL:
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

        frames: list[Frame] = [
            lambda: f"there {be} {than()}",
            lambda: f"the {self.style.picture} has {than()}",
        ]
        if margin is None:
            frames.append(lambda: f"there are {word} {self.noun(one, True)} than there are {self.noun(other, True)}")
            if order is Order.MORE:
                frames.append(lambda: "the {} outnumber the {}".format(*compared()))
        return frames

    def variety_frames(self, name: str, quantity: Quantity) -> list[Frame]:
        items = pluralised(self.style.item)
        if quantity == Quantity(1, 1):
            return [
                lambda: f"all {self.pick('', 'the ', 'of the ')}{items} have the same {name}",
                lambda: f"there is only one {name} in the {self.style.picture}",
                lambda: f"every {self.style.item} has the same {name}",
            ]
        if quantity == EACH_BOX:
            return [
                lambda: f"all three {name}s {self.pick('appear', 'occur', 'can be seen')} in the {self.style.picture}",
                lambda: f"there are {items} of all three {name}s",
            ]
        return [
            lambda: f"the {self.style.picture} has {items} of {self.different(quantity, name)}",
            lambda: f"we see {items} of {self.different(quantity, name)}",
            lambda: f"there are {items} of {self.different(quantity, name)}",
        ]

    # Boxes

    def box_frames(self, clause: BoxCount) -> list[Frame]:
        quantity, conditions, towers = clause.quantity, clause.conditions, clause.towers
        word = self.style.tower if towers else "box"
        several = pluralised(word)

        def with_phrase() -> str:
            named = self.described_boxes(quantity, conditions, towers)
            opening = self.pick("there", "there", "see", "picture")
            text = {"there": self.there(named), "see": f"we see {named.text}"}
            return text.get(opening, f"the {self.style.picture} has {named.text}")

        def with_verb() -> str:
            subject = self.box_subject(quantity, word)
            return f"{subject.text} {self.have(conditions, subject.plural)}"

        if quantity == EACH_BOX:
            return [with_verb]
        frames: list[Frame] = [with_phrase, with_phrase, with_verb]
        if (quantity.low == quantity.high and quantity.low) or (quantity.low and quantity.high is None):
            frames.append(lambda: self.of_the_boxes(quantity, several, conditions))
        if quantity == NONE:
            frames.append(lambda: f"none of the {several} {self.have(conditions, False)}")
        if quantity == SOME and len(conditions) == 1 and isinstance(conditions[0], Has) and conditions[0].quantity.low:
            has = conditions[0]
            frames.append(
                lambda: f"{self.pick('in', 'inside')} some {word} {self.there(self.quantified(has.quantity, has.noun))}"
            )
        return frames

    def box_subject(self, quantity: Quantity, word: str) -> Phrase:
        several = pluralised(word)
        if quantity == EACH_BOX:
            text = self.pick(
                f"every {word}", f"each {word}", f"all {several}", f"all three {several}", f"all the {several}"
            )
            return Phrase(text, text.startswith("all"))
        words = self.quantity(quantity)
        return Phrase(f"{words.text} {several if words.plural else word}", words.plural)

    def of_the_boxes(self, quantity: Quantity, several: str, conditions: Conditions) -> str:
        if quantity.high is None:
            number = f"at least {self.number(quantity.low)}"
        else:
            number = f"{self.pick('exactly', 'only', 'just')} {self.number(quantity.low)}"
        return f"{number} of the {several} {self.have(conditions, quantity.low > 1)}"

    def described_boxes(self, quantity: Quantity, conditions: Conditions, towers: bool) -> Phrase:
        """ "two towers with a blue top", with what can go before the noun there."""
        word = self.style.tower if towers else "box"
        words = self.quantity(quantity)
        first, rest = conditions[0], conditions[1:]
        noun = pluralised(word) if words.plural else word
        before, after = "", conditions
        if towers and _is_height(first) and self.chance(0.4):
            assert isinstance(first, Has)
            before, after = self.number(first.quantity.low) + "-block ", rest
        elif towers and isinstance(first, Purely) and len(first.look.colours) == 1 and self.chance(0.5):
            before, after = self.colours(first.look.colours) + " ", rest
        tail = f" {self.attributed(after, words.plural, towers)}" if after else ""
        if words.text == "a":
            return Phrase(article(before + noun) + tail, plural=False)
        return Phrase(f"{words.text} {before}{noun}{tail}", words.plural)

    def attributed(self, conditions: Conditions, plural: bool, towers: bool) -> str:
        """The conditions after the noun: "with two circles", "that has no square"."""
        first = conditions[0]
        if towers and len(conditions) == 1 and _is_height(first) and self.chance(0.4):
            assert isinstance(first, Has)
            return self.tall(first.quantity, plural)
        if all(isinstance(condition, Ends) for condition in conditions) and not plural and self.chance(0.3):
            ends = [self.end_clause(end) for end in conditions if isinstance(end, Ends)]
            return " and ".join(f"whose {text}" for text in ends)
        if self.chance(0.25):
            return f"that {self.have(conditions, plural)}"
        return f"with {self.possessions(conditions)}"

    def tall(self, quantity: Quantity, plural: bool) -> str:
        number = self.number(quantity.low)
        blocks = "block" if quantity.low == 1 else "blocks"
        return self.pick(f"of height {number}", f"that {self.be(plural)} {number} {blocks} {self.pick('tall', 'high')}")

    def end_clause(self, end: Ends) -> str:
        name = (
            self.pick("top", "top block") if end.level is Level.TOP else self.pick("base", "bottom block", "base block")
        )
        return f"{name} is {self.colours(end.colours)}"

    def have(self, conditions: Conditions, plural: bool) -> str:
        """The conditions as a verb phrase: "has two circles and no square"."""
        only = conditions[0]
        if len(conditions) == 1 and only == Has(NONE, ANYTHING):
            return f"{self.be(plural)} empty"
        contents = all(isinstance(condition, (Has, Purely)) for condition in conditions)
        verb = self.pick("has", "contains", "holds") if contents else "has"
        return f"{conjugated(verb, plural)} {self.possessions(conditions)}"

    def possessions(self, conditions: Conditions) -> str:
        first, *rest = conditions
        if _is_height(first) and rest and isinstance(rest[0], Varied | Purely):
            assert isinstance(first, Has)
            return listed([self.all_described(first.quantity, rest[0]), *map(self.possession, rest[1:])])
        texts = [self.possession(condition) for condition in conditions]
        *most, last = conditions
        lacks_last = isinstance(last, Has) and last.quantity == NONE
        if most and lacks_last and not any(isinstance(c, Has) and c.quantity == NONE for c in most):
            return f"{listed(texts[:-1])} but {texts[-1]}"
        return listed(texts)

    def all_described(self, quantity: Quantity, condition: Varied | Purely) -> str:
        """ "three blocks of two colors", "two objects, all of them blue" """
        number = self.quantified(quantity, ANYTHING)
        if isinstance(condition, Varied):
            items = pluralised(self.style.item)
            return number.text + self.variety(condition.attribute, condition.quantity, items).removeprefix(items)
        if quantity.low == 1:
            return f"{number.text}, which is {self.look_complement(condition.look, False)}"
        share = "both" if quantity.low == 2 else "all"
        return f"{number.text}, {share} of them {self.look_complement(condition.look, True)}"

    def each_tower_frames(self, conditions: Conditions) -> list[Frame]:
        word = self.style.tower
        return [
            lambda: f"{self.pick('every', 'each')} {word} {self.have(conditions, False)}",
            lambda: f"all {self.pick('', 'the ', 'of the ')}{pluralised(word)} {self.have(conditions, True)}",
        ]

    def named_box_frames(self, clause: BoxIs) -> list[Frame]:
        name = BOX_NAMES[clause.index]
        word = self.style.tower if clause.towers else "box"
        conditions = clause.conditions
        only = conditions[0]
        frames: list[Frame] = [lambda: f"the {name} {word} {self.have(conditions, False)}"]
        if len(conditions) > 1:
            return frames
        if isinstance(only, Ends):
            end = "top" if only.level is Level.TOP else "base"
            frames.append(lambda: f"the {self.pick(end)} of the {name} {word} is {self.colours(only.colours)}")
        elif _is_height(only) and clause.towers:
            quantity = only.quantity if isinstance(only, Has) else SOME
            blocks = "block" if quantity.low == 1 else "blocks"
            frames.append(
                lambda: f"the {name} {word} is {self.number(quantity.low)} {blocks} {self.pick('tall', 'high')}"
            )
        elif isinstance(only, Has) and only.noun != ANYTHING:
            frames += [
                lambda: f"{self.pick('in', 'inside')} the {name} {word} {self.there(self.quantity_of(only))}",
                lambda: f"{self.there(self.quantity_of(only))} in the {name} {word}",
            ]
        return frames

    def box_comparison_frames(self, clause: BoxesCompared) -> list[Frame]:
        one, other = BOX_NAMES[clause.one], BOX_NAMES[clause.other]
        noun, order = clause.noun, clause.order
        if clause.towers:
            tower = self.style.tower
            if order is Order.EQUAL:
                return [
                    lambda: (
                        f"the {one} {tower} is as {self.pick('tall', 'high')} as the {other} {self.pick('one', tower)}"
                    ),
                    lambda: f"the {one} {tower} and the {other} {tower} have the same height",
                ]
            tall = ("taller", "higher") if order is Order.MORE else ("shorter", "lower")
            return [lambda: f"the {one} {tower} is {self.pick(*tall)} than the {other} {self.pick('one', tower)}"]
        if order is Order.EQUAL:
            return [
                lambda: f"the {one} box has as many {self.noun(noun, True)} as the {other} {self.pick('one', 'box')}",
                lambda: f"the {one} box and the {other} box have the same number of {self.noun(noun, True)}",
            ]
        return [
            lambda: f"the {one} box has {order} {self.noun(noun, True)} than the {other} {self.pick('one', 'box')}",
            lambda: f"there are {order} {self.noun(noun, True)} in the {one} box than in the {other} one",
        ]

    def even_frames(self, noun: Noun, same: bool) -> list[Frame]:
        if same:
            return [
                lambda: f"all {self.pick('', 'three ', 'the ')}boxes have the same number of {self.noun(noun, True)}",
                lambda: f"each box has the same number of {self.noun(noun, True)}",
                lambda: f"there are equally many {self.noun(noun, True)} in each box",
            ]
        return [
            lambda: f"no two boxes have the same number of {self.noun(noun, True)}",
            lambda: f"each box has a different number of {self.noun(noun, True)}",
        ]

    def extreme_frames(self, noun: Noun, conditions: Conditions) -> list[Frame]:
        if noun == ANYTHING and self.style.item == "block":
            name = f"the {self.pick('tallest', 'highest')} {self.style.tower}"
            ends = [end for end in conditions if isinstance(end, Ends)]
            if len(conditions) == 1 and ends:
                end = "top" if ends[0].level is Level.TOP else "base"
                return [
                    lambda: f"{name} {self.have(conditions, False)}",
                    lambda: f"the {end} of {name} is {self.colours(ends[0].colours)}",
                ]
            return [lambda: f"{name} {self.have(conditions, False)}"]
        return [lambda: f"the box with the most {self.noun(noun, True)} {self.have(conditions, False)}"]

    # Several clauses

    def joined_frames(self, every: bool, clauses: tuple[Clause, ...]) -> list[Frame]:
        if every:
            frames: list[Frame] = [lambda: self.conjoined(clauses)]
        else:
            frames = [
                lambda: f"either {' or '.join(self.clause(part) for part in clauses)}",
                lambda: ", or ".join(self.clause(part) for part in clauses),
            ]
        counts = [part for part in clauses if isinstance(part, ItemCount) and not part.noun.traits]
        if len(counts) == len(clauses) and not any(_is_upper_bound(part.quantity) for part in counts):
            frames += [lambda: self.together(counts, every)] * 4
        return frames

    def conjoined(self, clauses: Sequence[Clause]) -> str:
        *most, last = (self.clause(part) for part in clauses)
        joints = [", and", " and", ", and", ", while"]
        if _denies(clauses[-1]) != _denies(clauses[0]):
            joints = [", but", " but"]
        return f"{', '.join(most)}{self.pick(*joints)} {last}"

    def together(self, counts: Sequence[ItemCount], every: bool) -> str:
        """ "there are two circles and a blue square" """
        if every and all(part.quantity == NONE for part in counts):
            texts = [self.noun(part.noun, True) for part in counts]
            return f"there are {self.pick(f'neither {texts[0]} nor {texts[1]}', f'no {texts[0]} and no {texts[1]}')}"
        phrases = [self.quantified(part.quantity, part.noun) for part in counts]
        joint = "or" if not every else "but" if _denies(counts[0]) != _denies(counts[-1]) else "and"
        text = listed([phrase.text for phrase in phrases], joint)
        if joint == "and" and self.chance(0.2) and len(counts) == 2:
            text = f"both {text}"
        elif joint == "or" and self.chance(0.4) and len(counts) == 2:
            text = f"either {text}"
        opening = self.pick(f"there {self.be(phrases[0].plural)}", f"the {self.style.picture} has", "we see")
        return f"{opening} {text}"


def _is_height(condition: Condition) -> bool:
    """Whether the condition is "with exactly so many blocks"."""
    match condition:
        case Has(Quantity(low, high, False), noun):
            return low == high and low > 0 and noun == ANYTHING
        case _:
            return False


def _is_upper_bound(quantity: Quantity) -> bool:
    """Whether it is "at most two", which would seem to bound everything listed after it."""
    return quantity.low == 0 and quantity != NONE


def _denies(clause: Clause) -> bool:
    match clause:
        case ItemCount(quantity, _) | BoxCount(quantity, _, _):
            return quantity == NONE
        case NotEvery():
            return True
        case _:
            return False
