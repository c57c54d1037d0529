"""Realises the parts of a meaning as English phrases: quantities, noun phrases, predicates, box conditions."""

from __future__ import annotations

import random

from lilgym_mp.generator.lexicon import NUMBER_WORDS, Phrase, Style, article, conjugated, pluralised
from lilgym_mp.generator.meanings import semantics as sem
from lilgym_mp.generator.quantities import NONE, SOME, Quantity, exactly
from lilgym_mp.scene import Colour, Size

BOX_NAMES = ("left", "middle", "right")
SIZE_NAMES = {
    Size.SMALL: ("small", "small", "tiny", "little"),
    Size.MEDIUM: ("medium-sized", "medium"),
    Size.LARGE: ("big", "large"),
}
ATTRIBUTE_NAMES = {sem.Attribute.COLOUR: "color", sem.Attribute.SHAPE: "shape", sem.Attribute.SIZE: "size"}
WALL_NAMES = {
    sem.Wall.LEFT: ("the left {wall}", "the {wall} on the left"),
    sem.Wall.RIGHT: ("the right {wall}", "the {wall} on the right"),
    sem.Wall.TOP: ("the top {wall}", "the upper {wall}"),
    sem.Wall.BOTTOM: ("the bottom {wall}", "the floor", "the lower {wall}"),
}


class PhraseRealiser:
    """Realises phrases in one style; `rng` chooses among alternative wordings."""

    def __init__(self, rng: random.Random, style: Style) -> None:
        self.rng = rng
        self.style = style

    def pick(self, *options: str) -> str:
        return self.rng.choice(options)

    def chance(self, probability: float) -> bool:
        return self.rng.random() < probability

    def number(self, value: int) -> str:
        return str(value) if self.style.digits else NUMBER_WORDS[value]

    def be(self, plural: bool) -> str:
        return conjugated("is", plural)

    # Noun phrases

    def description(self, description: sem.Description, plural: bool, *, alone: bool = True) -> str:
        """Adjectives and noun without an article; `alone` if no modifier of the noun follows."""
        noun = self.style.item if description.shape is None else description.shape.name.lower()
        noun = pluralised(noun) if plural else noun
        size = [] if description.size is None else [self.pick(*SIZE_NAMES[description.size])]
        if alone and len(description.colours) == 2 and self.chance(0.4):
            (excluded,) = set(Colour) - description.colours
            return " ".join([*size, noun, f"that {self.be(plural)} not {excluded.name.lower()}"])
        colours = [self.colours(description.colours)] if description.colours else []
        return " ".join([*size, *colours, noun])

    def colours(self, colours: frozenset[Colour]) -> str:
        names = [colour.name.lower() for colour in sorted(colours)]
        self.rng.shuffle(names)
        return " or ".join(names)

    def noun(self, noun: sem.NounPhrase, plural: bool, *, alone: bool = True) -> str:
        words = [
            self.description(noun.description, plural, alone=alone and not noun.predicates),
            *(self.modifier(predicate, plural) for predicate in noun.predicates),
        ]
        return " ".join(words)

    def indefinite(self, noun: sem.NounPhrase) -> str:
        """ "a blue circle" """
        return article(self.noun(noun, plural=False, alone=False))

    def quantified(self, quantity: Quantity, noun: sem.NounPhrase) -> Phrase:
        """ "at least two blue circles" """
        determiner = self.determiner(quantity)
        text = self.noun(noun, determiner.plural)
        if determiner.text == "a":
            return Phrase(article(text), plural=False)
        return Phrase(f"{determiner.text} {text}", determiner.plural)

    def determiner(self, quantity: Quantity) -> Phrase:
        """The determiner for a quantity; "a" also where the noun needs "an"."""
        low, high, vague = quantity
        if vague:
            words = ("several", "quite a few") if low == 3 else ("many", "a lot of", "lots of")
            return Phrase(self.pick(*words), plural=True)
        if quantity == NONE:
            return Phrase("no", plural=self.chance(0.5))
        if quantity == SOME:
            text = self.pick("a", "a", "a", "a", "at least one", "one or more")
            return Phrase(text, plural=text == "one or more")
        return self.range(low, high)

    def range(self, low: int, high: int | None) -> Phrase:
        """The determiner for an exact or bounded number."""
        if high is None:
            options = [f"at least {self.number(low)}", f"no fewer than {self.number(low)}"]
            options += [f"more than {self.number(low - 1)}", f"{self.number(low)} or more"]
            if low == 2:
                options += ["multiple", "more than one"]
        elif low == high:
            options = [f"{adverb} {self.number(low)}" for adverb in ("exactly", "exactly", "exactly", "only", "just")]
            options += [self.number(low)] * 4 if low > 1 else ["a single", f"precisely {self.number(1)}"]
            options += ["a pair of"] if low == 2 else []
        elif low == 0:
            options = [f"at most {self.number(high)}", f"no more than {self.number(high)}"]
            options += [f"fewer than {self.number(high + 1)}", f"not more than {self.number(high)}"]
        else:
            options = [f"at least {self.number(low)} but no more than {self.number(high)}"]
            options += [f"between {self.number(low)} and {self.number(high)}"] if high > low + 1 else []
            options += [f"{self.number(low)} or {self.number(high)}"] * 3 if high == low + 1 else []
        text = self.pick(*options)
        last = text.split()[-1]
        return Phrase(text, plural=last not in ("one", "1", "single") or " or " in text)

    # Predicates

    def modifier(self, predicate: sem.Predicate, plural: bool) -> str:
        """The predicate as a modifier after its noun: "touching the left wall"."""
        be, does, touch = (conjugated(verb, plural) for verb in ("is", "does", "touches"))
        wall = self.wall(predicate) if isinstance(predicate, sem.AtWall) else ""
        match predicate:
            case sem.Matches():
                return f"that {self.verb_phrase(predicate, plural)}"
            case sem.AtWall(_, True, _):
                return self.pick(f"touching or almost touching {wall}", f"very close to {wall} or touching it")
            case sem.AtWall(_, _, True):
                return self.pick(f"touching {wall}", f"that {touch} {wall}", f"against {wall}")
            case sem.AtWall():
                return self.pick(
                    f"not touching {wall}", f"that {does} not touch {wall}", f"that {be} not touching {wall}"
                )
            case sem.InCorner(_, True):
                if plural:
                    return self.pick("in corners", "sitting in corners")
                return self.pick("in a corner", "sitting in a corner", "in a corner of a box", "tucked into a corner")
            case sem.InCorner():
                return self.pick(f"that {be} not in a corner", "not in a corner")
            case sem.InBox(index, positive):
                name = BOX_NAMES[index]
                prepositions = ("in", "inside") if positive else ("outside", "not in")
                return f"{self.pick(*prepositions)} the {name} box"
            case sem.AtPosition(position):
                return self.position(position, plural)
            case sem.RelatedTo(relation, noun, True):
                return self.related_to(relation, noun)
            case sem.RelatedTo(relation, noun):
                return f"not {self.related_to(relation, noun, negated=True)}"
            case sem.RelatedByAttribute():
                return self.in_relation(predicate.relation, self.item_by_attribute(predicate))

    def verb_phrase(self, predicate: sem.Predicate, plural: bool) -> str:
        """The predicate as a verb phrase: "touches the left wall"."""
        be, does, touch = (conjugated(verb, plural) for verb in ("is", "does", "touches"))
        be += "" if predicate.positive else " not"
        wall = self.wall(predicate) if isinstance(predicate, sem.AtWall) else ""
        match predicate:
            case sem.Matches(description):
                return f"{be} {self.description_complement(description, plural)}"
            case sem.AtWall(_, True, _):
                return self.pick(f"{touch} or almost {touch} {wall}", f"{be} very close to {wall} or touching it")
            case sem.AtWall(_, _, True):
                return self.pick(f"{touch} {wall}", f"{be} touching {wall}", f"{be} against {wall}")
            case sem.AtWall():
                return self.pick(f"{does} not touch {wall}", f"{be} touching {wall}")
            case sem.InCorner(_, True):
                sit = conjugated(self.pick("is", "sits", "lies"), plural)
                return f"{sit} {'in corners' if plural else self.pick('in a corner', 'in a corner of a box')}"
            case sem.InCorner():
                return f"{be} in a corner"
            case sem.InBox(index):
                name = BOX_NAMES[index]
                return f"{be} {self.pick(f'in the {name} box', f'inside the {name} box')}"
            case sem.AtPosition(position, True):
                stands = "stands" if position is sem.TowerPosition.BOTTOM else "sits"
                stand = conjugated(self.pick("is", "is", stands), plural)
                return f"{stand} {self.position(position, plural)}"
            case sem.AtPosition(position):
                return f"{be} {self.position(position, plural)}"
            case sem.RelatedTo(sem.Relation.TOUCHING, noun, True) if self.chance(0.5):
                return f"{touch} {self.indefinite(noun)}"
            case sem.RelatedTo(relation, noun, positive):
                if relation in (sem.Relation.ON, sem.Relation.ABOVE) and positive and self.chance(0.4):
                    be = conjugated(self.pick("sits", "rests") if relation is sem.Relation.ON else "lies", plural)
                return f"{be} {self.related_to(relation, noun, negated=not positive)}"
            case sem.RelatedByAttribute():
                return f"{be} {self.in_relation(predicate.relation, self.item_by_attribute(predicate))}"

    def description_complement(self, description: sem.Description, plural: bool) -> str:
        """The complement of "is": adjectives, or a noun phrase if the description has a shape."""
        if description.shape is not None:
            text = self.description(description, plural)
            return text if plural else article(text)
        parts = [] if description.size is None else [self.pick(*SIZE_NAMES[description.size])]
        if len(description.colours) == 2 and not parts and self.chance(0.3):
            return f"either {self.colours(description.colours)}"
        return " and ".join([*parts, *([self.colours(description.colours)] if description.colours else [])])

    def wall(self, predicate: sem.AtWall) -> str:
        name = self.style.wall
        if predicate.wall is not None:
            return self.pick(*WALL_NAMES[predicate.wall]).format(wall=name)
        return article(name) if predicate.positive else f"any {name}"

    def position(self, position: sem.TowerPosition, plural: bool) -> str:
        tower = f"their {pluralised(self.style.tower)}" if plural else f"a {self.style.tower}"
        match position:
            case sem.TowerPosition.TOP:
                return self.pick(f"at the top of {tower}", f"at the very top of {tower}")
            case sem.TowerPosition.BOTTOM:
                return self.pick(f"at the bottom of {tower}", f"at the base of {tower}")
            case sem.TowerPosition.SECOND | sem.TowerPosition.THIRD:
                return self.pick(f"in {position} position from the bottom", f"{position} from the bottom")

    def related_to(self, relation: sem.Relation, noun: sem.NounPhrase, *, negated: bool = False) -> str:
        """ "directly under a blue block" """
        other = f"any {self.noun(noun, plural=False, alone=False)}" if negated else self.indefinite(noun)
        return self.in_relation(relation, other)

    def item_by_attribute(self, predicate: sem.RelatedByAttribute) -> str:
        """ "another item of the same color" """
        name = ATTRIBUTE_NAMES[predicate.attribute]
        if predicate.same:
            return f"{self.pick('another', article(self.style.item).split()[0])} {self.style.item} of the same {name}"
        return f"{article(self.style.item)} of {self.pick('a different', 'another')} {name}"

    def in_relation(self, relation: sem.Relation, other: str) -> str:
        same = f"in the same {self.style.tower}" if self.style.item == "block" else "in the same box"
        match relation:
            case sem.Relation.TOUCHING:
                return self.pick(f"touching {other}", f"in contact with {other}")
            case sem.Relation.NEAR:
                return f"touching or almost touching {other}"
            case sem.Relation.ON:
                return f"{self.pick('directly on top of', 'directly on', 'right on top of', 'directly above')} {other}"
            case sem.Relation.UNDER:
                return f"{self.pick('directly under', 'right below', 'directly below', 'right under')} {other}"
            case sem.Relation.ABOVE:
                return f"{self.pick('above', 'somewhere above', 'higher up than')} {other} {same}"
            case sem.Relation.BELOW:
                return f"{self.pick('below', 'somewhere below', 'lower down than')} {other} {same}"

    def partitive(self, partitive: sem.Partitive, total: Quantity, predicate: sem.Predicate, them: str) -> str:
        """ "both of them touch a wall"; `them` is "them" or "which"."""
        pair = total == exactly(2)
        if partitive is sem.Partitive.ALL and total == exactly(1):
            return f"{'it' if them == 'them' else 'which'} {self.verb_phrase(predicate, plural=False)}"
        match partitive:
            case sem.Partitive.ALL:
                some = "both" if pair else "all"
            case sem.Partitive.NONE:
                some = "neither" if pair else "none"
            case sem.Partitive.SOME:
                some = "at least one"
            case sem.Partitive.ONE:
                some = f"{self.pick('exactly', 'only', 'just')} one"
        return f"{some} of {them} {self.verb_phrase(predicate, plural=partitive is sem.Partitive.ALL)}"

    # Box conditions

    def contents(self, condition: sem.BoxCondition) -> str:
        """The condition as the object of "has" or "with"."""
        items = pluralised(self.style.item)
        match condition:
            case sem.Count(quantity, noun):
                return self.quantified(quantity, noun).text
            case sem.ContainsOnly(description):
                return f"{self.pick('only', 'only', 'nothing but')} {self.description(description, plural=True)}"
            case sem.Variety(attribute, quantity):
                return self.variety(attribute, quantity, items)
            case sem.EndColour(position, colours):
                return self.end(position, colours)
            case sem.MatchingEnds(same):
                ends = self.pick("a top and a base", "a base and a top")
                return f"{ends} of {'the same color' if same else 'different colors'}"
            case sem.PartitiveCount(quantity, noun, partitive, predicate):
                total = self.quantified(quantity, noun).text
                return f"{total}, {self.partitive(partitive, quantity, predicate, 'which')}"

    def variety(self, attribute: sem.Attribute, quantity: Quantity, items: str) -> str:
        name = ATTRIBUTE_NAMES[attribute]
        if quantity == exactly(1):
            return f"{items} of {self.pick('a single', 'only one', 'just one')} {name}"
        if quantity == exactly(3):
            return f"{items} of all three {name}s"
        return f"{items} of {self.different_values(quantity, name)}"

    def different_values(self, quantity: Quantity, name: str) -> str:
        """ "exactly two different colors"; the only unbounded quantity is "at least two"."""
        if quantity.high is None:
            number = self.pick("more than one", f"at least {self.number(2)}", f"{self.number(2)} or more")
        else:
            number = self.pick("", "", "exactly ", "only ") + self.number(quantity.low)
        return f"{number} {name}" if number.endswith("one") else f"{number} {self.pick('', 'different ')}{name}s"

    def end(self, position: sem.TowerPosition, colours: frozenset[Colour]) -> str:
        colour = self.colours(colours)
        if position is sem.TowerPosition.TOP:
            return f"a {colour} {self.pick('top', 'block at the top', 'block on top')}"
        return f"a {colour} {self.pick('base', 'block at the bottom', 'block at the base')}"
