"""Statements about the items of a picture, with their programs."""

from __future__ import annotations

from dataclasses import replace

from lilgym_mp.generator.lexicon import pluralised
from lilgym_mp.generator.semantics import NONE, SOME, Quantity
from lilgym_mp.generator.template_conditions import Conditions, Said, in_box
from lilgym_mp.generator.template_phrases import ALL_ITEMS, ANYTHING, Look, Noun, Phrase, exactly, items, numbered


class ItemFrames(Conditions):
    """What is said of items, whatever the appearance."""

    def existential(self, phrase: Phrase) -> str:
        """There being so many of something, in one of many ways."""
        text, plural = phrase
        draw = self.rng.random()
        if draw < 0.72:
            there = "there are" if plural else "there is"
            if self.voice.sloppy and self.chance(0.3):
                there = self.pick("there is", "there is", "there", "there are", "there have", "there exists")
            elif self.chance(0.06):
                there = self.pick("there's", "there exists", "there can be seen", "here is") if not plural else there
            return f"{there} {text}"
        if draw < 0.84:
            return text
        if draw < 0.92:
            be = self.be(plural)
            return self.pick(
                f"{text} {be} present", f"{text} can be seen", f"{text} {be} in the {self.voice.picture}",
                f"{text} {be} shown", f"{text} {self.verb('exists', plural)}",
            )  # fmt: skip
        subject = self.pick("we can see", "i see", "you can see", f"the {self.voice.picture} has",
                            f"the {self.voice.picture} contains", f"the {self.voice.picture} shows", "we have",
                            f"in the {self.voice.picture} there {self.be(plural)}")  # fmt: skip
        return f"{subject} {text}"

    def somewhere(self) -> str:
        """Words that add nothing: wherever in the picture."""
        if self.chance(0.88):
            return ""
        boxes = pluralised(self.voice.box)
        return self.pick(" in total", " in all", " altogether", f" in the {self.voice.picture}", f" in the {boxes}",
                         f" in the three {boxes}", " overall", " total")  # fmt: skip

    def counted(self) -> Said:
        noun = Noun(self.look())
        quantity = self.quantity(7)
        return Said(
            self.existential(self.quantified(quantity, noun)) + self.somewhere(), numbered(quantity, items(noun))
        )

    def total(self) -> Said:
        number = self.pick(2, 3, 4, 5, 5, 6, 6, 7, 7, 8, 8, 9, 10)
        quantity = self.pick(exactly(number), exactly(number), Quantity(number, None), Quantity(0, number))
        return Said(
            self.existential(self.quantified(quantity, ANYTHING)) + self.somewhere(),
            numbered(quantity, ALL_ITEMS),
        )

    def number_told(self) -> Said:
        """ "the number of blue blocks is three" """
        noun, number = Noun(self.look()), self.pick(1, 2, 2, 3, 3, 4, 5, 6)
        adverb, quantity = self.pick(
            ("", exactly(number)), ("exactly ", exactly(number)), ("at least ", Quantity(number, None)),
            ("at most ", Quantity(0, number)), ("more than ", Quantity(number + 1, None)),
            ("less than ", Quantity(0, number - 1)),
        )  # fmt: skip
        total = self.pick("the number of", "the total number of", "number of", "the count of", "total number of")
        text = f"{total} {self.noun(noun, plural=True)} is {adverb}{self.number(number)}"
        return Said(text, numbered(quantity, items(noun)))

    def with_trait(self) -> Said:
        """Items with one or two traits."""
        noun = self.traited()
        return self.saying(self.quantity(4, none=0.06), noun)

    def traited(self) -> Noun:
        noun = Noun(self.look(), (self.trait(),))
        if self.chance(0.12):
            second = self.trait()
            if second.kind != noun.traits[0].kind:
                noun = noun.also(second)
        return noun

    def saying(self, quantity: Quantity, noun: Noun) -> Said:
        """So many items with traits: existence, subject first, or "one of the ..."."""
        program = numbered(quantity, items(noun))
        draw = self.rng.random()
        *rest, last = noun.traits
        subject_noun = Noun(noun.look, tuple(rest))
        if draw < 0.6:
            return Said(self.existential(self.quantified(quantity, noun)), program)
        if draw < 0.63 and quantity == SOME:
            there = self.existential(Phrase(self.some(subject_noun), plural=False))
            joint = self.pick(" and it", ", and it", " and that", f" and the {self.voice.item}", ". it")
            return Said(f"{there}{joint} {self.predicate(last, plural=False)}", program)
        if quantity == NONE and draw < 0.85:
            none = self.pick("none of the", "none of the", "not one of the", "no one of the")
            text = f"{none} {self.noun(subject_noun, plural=True)} {self.predicate(last, plural=self.chance(0.4))}"
            return Said(text, program)
        if draw < 0.74 and quantity.low == 1 and quantity.high in (1, None):
            one = self.of_the(quantity)
            text = f"{one} {self.noun(subject_noun, plural=True)} {self.predicate(last, plural=False)}"
            return Said(text, program)
        if draw < 0.82 and quantity.low > 1 and not quantity.vague:
            words = self.determiner(quantity)
            if not words.text.endswith((" of", "total")):
                of_the = f"{words.text} of the {self.noun(subject_noun, plural=True)}"
                return Said(f"{of_the} {self.predicate(last, words.plural)}", program)
        subject = self.quantified(quantity, subject_noun)
        there = self.existential(subject) if self.chance(0.3) else subject.text
        text = f"{subject.text} {self.predicate(last, subject.plural)}"
        if there != subject.text and last.holds:
            text = f"{there} {self.modifier(last, subject.plural)}"
        return Said(text, program)

    def of_the(self, quantity: Quantity) -> str:
        if quantity == exactly(1):
            if self.voice.bare_number_is_bound:
                return "one of the"
            return self.pick("exactly one of the", "only one of the", "just one of the", "exactly 1 of the")
        if self.voice.bare_number_is_bound:
            return self.pick("at least one of the", "at least 1 of the", "some of the")
        return self.pick("one of the", "one of the", "at least one of the", "at least 1 of the", "some of the")

    def definite(self) -> Said:
        """ "the black triangle is touching a wall": taken as one being there that does."""
        noun = self.traited()
        *rest, last = noun.traits
        named = Noun(noun.look, tuple(rest))
        the = self.pick("the", "the", "the", "", "a")
        if the == "a":
            text = f"{self.some(named)} {self.predicate(last, plural=False)}"
        else:
            text = f"{the} {self.noun(named, plural=False)} {self.predicate(last, plural=False)}".strip()
        return Said(text, numbered(SOME, items(noun)))

    def the_only(self) -> Said:
        """There being just one, and it has a trait."""
        noun, trait = Noun(self.look()), self.trait()
        all_of_them = items(noun)
        program = f"count({all_of_them}) == 1 and exist({items(noun.also(trait))})"
        one = self.quantified(exactly(1), noun).text
        predicate = self.predicate(trait, plural=False)
        text = self.pick(
            f"the only {self.noun(noun, plural=False)} {predicate}",
            f"there is {one} and it {predicate}",
            f"there is {one} and that {predicate}",
            f"there is {one}, and it {predicate}",
            f"there is {one} and this {self.voice.item} {predicate}",
        )
        return Said(text, program)

    def shared(self) -> Said:
        """So many items, of which so many have a trait."""
        noun, trait = Noun(self.look()), self.trait()
        total = self.pick(2, 2, 3, 3, 4)
        part = self.pick("all", "none", *(exactly(n) for n in range(1, total)))
        number = f"count({items(noun)}) == {total}"
        named = self.quantified(exactly(total), noun).text
        joint = self.pick(" and", ",", ", and", " of which", " out of which")
        of_them = "" if "which" in joint else " of them"
        if part == "all":
            words = self.pick("both", "all") if total == 2 else self.pick("all", "all", f"all {self.number(total)}")
            subject, plural = f"{words}{of_them}", True
            quantity = exactly(total)
        elif part == "none":
            words = "neither" if total == 2 else "none"
            subject, plural, quantity = f"{words}{of_them}", False, NONE
        else:
            assert isinstance(part, Quantity)
            words = self.pick("", "exactly ", "only ") + self.number(part.low)
            subject, plural, quantity = f"{words}{of_them}", part.low > 1, part
        having = numbered(quantity, items(noun.also(trait)))
        text = f"there {self.be(True)} {named}{joint} {subject} {self.predicate(trait, plural)}"
        return Said(text, f"{number} and {having}")

    def every(self) -> Said:
        """All such items have the trait, and there are some."""
        noun, trait = self.pick(ANYTHING, *[Noun(self.look())] * 4), self.trait()
        if self.chance(0.2):
            noun, trait = self.traited(), self.look_trait(Look(self.colour()))
            noun = Noun(Look(shape=noun.look.shape, size=noun.look.size), noun.traits)
        program = f"All({items(noun)}, lambda x: {trait.tested('x')})"
        several, single = self.noun(noun, plural=True), self.noun(noun, plural=False)
        the_several = f"all the {several}" if several == single else f"the {several}"
        text = self.pick(
            f"all {several} {self.predicate(trait, plural=True)}",
            f"all the {several} {self.predicate(trait, plural=True)}",
            f"all of the {several} {self.predicate(trait, plural=True)}",
            f"every {single} {self.predicate(trait, plural=False)}",
            f"each {single} {self.predicate(trait, plural=False)}",
            f"each of the {several} {self.predicate(trait, plural=False)}",
            f"{the_several} {self.predicate(trait, plural=True)}",
            f"{the_several} {self.be(True)} all {trait.told or trait.core}" if trait.holds else
            f"the {several} {self.predicate(trait, plural=True)}",
        )  # fmt: skip
        return Said(text, program)

    def not_every(self) -> Said:
        noun, trait = Noun(self.look()), self.trait()
        if not trait.holds:
            trait = replace(trait, holds=True)
        program = f"exist({items(noun.also(replace(trait, holds=False)))})"
        several, single = self.noun(noun, plural=True), self.noun(noun, plural=False)
        text = self.pick(
            f"not all {several} {self.predicate(trait, plural=True)}",
            f"not all the {several} {self.predicate(trait, plural=True)}",
            f"not all of the {several} {self.predicate(trait, plural=True)}",
            f"not every {single} {self.predicate(trait, plural=False)}",
            f"at least one {single} {self.predicate(replace(trait, holds=False), plural=False)}",
        )
        return Said(text, program)

    def only_those(self) -> Said:
        """ "only blue circles are touching a wall": something does, and all that do are such."""
        look, trait = self.look(), replace(self.trait(), holds=True)
        predicate = self.predicate(trait, plural=True)
        all_look = self.look_trait(look)
        program = f"All({items(Noun(traits=(trait,)))}, lambda x: {all_look.tested('x')})"
        several = self.plain_noun(look, plural=True)
        text = self.pick(
            f"only {several} {predicate}",
            f"only the {several} {predicate}",
            f"every {self.voice.item} {self.modifier(trait, False)} is {all_look.core}",
            f"all {pluralised(self.voice.item)} {self.modifier(trait, True)} are "
            f"{several if look.shape else all_look.core}",
            f"no {self.voice.item} other than {several} {self.predicate(trait, False)}",
        )
        return Said(text, program)

    def same_all(self) -> Said:
        """All such items share an attribute, or do not."""
        attribute = self.attribute()
        noun = Noun(self.look_free_of(attribute))
        if self.chance(0.3):
            noun = noun.also(replace(self.trait(), holds=True))
        several = self.noun(noun, plural=True)
        program = f"all_same_{attribute}({items(noun)})"
        if self.chance(0.3):
            text = self.pick(
                f"not all {several} {self.have_same(attribute)}",
                f"not all of the {several} {self.have_same(attribute)}",
                f"there are {several} of different {attribute}s",
                f"the {several} have different {attribute}s",
                f"the {several} {self.pick('are not', 'do not have')} the same {attribute}".replace(
                    "are not the same", "are not of the same"
                ),
            )
            values = f"get_set_{attribute}s({items(noun)})"
            return Said(text, f"ge(count({values}), 2)")
        text = self.pick(
            f"all {several} {self.have_same(attribute)}",
            f"all the {several} {self.have_same(attribute)}",
            f"all of the {several} {self.have_same(attribute)}",
            f"the {several} {self.have_same(attribute)}",
            f"the {several} all {self.have_same(attribute)}",
            f"every {self.noun(noun, plural=False)} has the same {attribute}",
        )
        return Said(text, program)

    def variety(self) -> Said:
        """How many colours, shapes or sizes the picture has."""
        attribute = self.attribute()
        number = self.pick(1, 2, 2, 3, 3)
        values = f"get_set_{attribute}s({ALL_ITEMS})"
        words = self.variety_words(attribute, number)
        several = pluralised(self.voice.item)
        there = self.pick(f"there are {several}", several, f"the {self.voice.picture} has {several}",
                          f"the {pluralised(self.voice.box)} have {several}", f"there is {several}")  # fmt: skip
        named = f"there {self.be(number > 1)} {words} in the {self.voice.picture}"
        if attribute == "shape" and "different" not in words:
            named = f"{several} of {words} are in the {self.voice.picture}"
        text = self.pick(f"{there} {self.pick('of', 'of', 'with', 'in')} {words}",
                         named)  # fmt: skip
        return Said(text, f"count({values}) == {number}")

    def compared(self) -> Said:
        """More of these than of those."""
        one, other = self.two_looks()
        first, second = Noun(one), Noun(other)
        order, margin = self.pick("more", "more", "fewer", "equal", "more", "fewer", "equal", "at least"), None
        if order == "more" and self.chance(0.15):
            margin = self.pick(1, 1, 2, 3)
        words = self.comparison(first, second, order, margin)
        text = self.pick(
            f"there are {words}", f"there are {words}", f"the {self.voice.picture} has {words}", f"there is {words}",
            words,
        )  # fmt: skip
        if order == "equal" and self.chance(0.3):
            text = self.pick(
                f"the number of {self.noun(first, True)} {self.pick('is the same as', 'equals', 'is equal to')} "
                f"the number of {self.noun(second, True)}",
                f"the number of {self.noun(first, True)} and {self.noun(second, True)} is "
                f"{self.pick('the same', 'equal')}",
                f"number of {self.noun(first, True)} and number of {self.noun(second, True)} are "
                f"{self.pick('the same', 'equal', 'same')}",
            )
        if order in ("more", "fewer") and margin is None and self.chance(0.2):
            greater = self.pick("more than", "greater than", "bigger than",
                                "higher than") if order == "more" else self.pick(
                "less than", "fewer than", "smaller than", "lower than")  # fmt: skip
            number = self.pick("the number of", "number of", "the total number of")
            text = f"{number} {self.noun(first, True)} is {greater} {number} {self.noun(second, True)}"
        return Said(text, self.comparison_test(first, second, order, margin, ALL_ITEMS))

    def joined(self) -> Said:
        """Two statements in one."""
        one, other = self.short(), self.short()
        words, operator = self.pick(
            (" and ", "and"), (", and ", "and"), (" and ", "and"), (", but ", "and"), (" or ", "or"),
            (", while ", "and"), (". also ", "and"),
        )  # fmt: skip
        second = other.text
        if one.text.startswith("there ") and second.startswith(("there is ", "there are ")) and self.chance(0.5):
            second = second.split(" ", 2)[2]
        either = "either " if operator == "or" and self.chance(0.3) else ""
        return Said(either + one.text + words + second, f"({one.program}) {operator} ({other.program})")

    def short(self) -> Said:
        return self.pick(self.counted, self.with_trait, self.boxes_with)()

    def two_counted(self) -> Said:
        """ "there are two circles and one black square" """
        one, other = self.two_looks()
        first, second = self.quantity(4, none=0), self.quantity(4, none=0.2)
        nouns = Noun(one), Noun(other)
        opening = self.existential(self.quantified(first, nouns[0]))
        joint = "but" if second == NONE and self.chance(0.6) else self.pick("and", "and", "and", ", and", "as well as")
        text = f"{opening} {joint} {self.quantified(second, nouns[1]).text}".replace(" ,", ",")
        return Said(text, f"({numbered(first, items(nouns[0]))}) and ({numbered(second, items(nouns[1]))})")

    # Boxes

    def both(self) -> Said:
        """ "both black triangles touch a wall" """
        noun, trait = Noun(self.look()), self.trait()
        several = self.noun(noun, plural=True)
        negative = self.chance(0.2)
        trait = replace(trait, holds=True) if negative else trait
        if negative:
            text = f"neither of the {self.pick('two ', '')}{several} {self.predicate(trait, plural=False)}"
            trait = replace(trait, holds=False)
        else:
            both = self.pick("both", "both the", "both of the", "the two")
            text = f"{both} {several} {self.predicate(trait, plural=True)}"
        every = f"All({items(noun)}, lambda x: {trait.tested('x')})"
        return Said(text, f"count({items(noun)}) == 2 and {every}")

    def excepted(self) -> Said:
        """ "all items except one are blue" """
        noun = ANYTHING if self.chance(0.5) else Noun(Look(shape=self.look().shape))
        trait = self.look_trait(Look(self.colour())) if self.chance(0.6) else replace(self.trait(), holds=True)
        number = self.pick(1, 1, 1, 2)
        several, count = self.noun(noun, plural=True), self.number(number)
        predicate = self.predicate(trait, plural=True)
        text = self.pick(
            f"all {several} except {count} {predicate}", f"all the {several} but {count} {predicate}",
            f"all but {count} of the {several} {predicate}", f"all {several} {predicate} except {count}",
            f"all except {count} of the {several} {predicate}", f"all the {several} {predicate} except for {count}",
        )  # fmt: skip
        others = items(noun.also(replace(trait, holds=False)))
        return Said(text, f"exist({items(noun.also(trait))}) and count({others}) == {number}")

    def mostly(self) -> Said:
        """ "most circles are blue" """
        noun, trait = Noun(self.look()), replace(self.trait(), holds=True)
        if self.chance(0.5):
            trait = self.look_trait(Look(self.colour()))
            noun = Noun(Look(shape=noun.look.shape))
        several = self.noun(noun, plural=True)
        predicate = self.predicate(trait, plural=True)
        most = self.pick("most of the", "most", "most of", "a majority of the", "more than half of the")
        text = f"{most} {several} {predicate}"
        others = items(noun.also(replace(trait, holds=False)))
        return Said(text, f"count({items(noun.also(trait))}) > count({others})")

    def no_two(self) -> Said:
        """ "no two items are the same color" """
        attribute = self.attribute()
        noun = Noun(self.look_free_of(attribute))
        several = self.noun(noun, plural=True)
        text = self.pick(
            f"no two {several} {self.have_same(attribute)}", f"no two {several} have the same {attribute}",
            f"all the {several} have different {attribute}s", f"all {several} are of different {attribute}s",
            f"there are no two {several} of the same {attribute}",
        )  # fmt: skip
        values = f"get_set_{attribute}s({items(noun)})"
        return Said(text, f"exist({items(noun)}) and count({items(noun)}) == count({values})")

    def in_one_box(self) -> Said:
        """ "all the circles are in the same box", "a circle and a square are in the same box" """
        box = self.box_word()
        same = self.pick(f"in the same {box}", f"in one {box}", f"in the same {box}", f"in a single {box}")
        if self.chance(0.5):
            noun = Noun(self.look())
            several = self.noun(noun, plural=True)
            text = self.pick(f"all {several} are {same}", f"all the {several} are {same}",
                             f"the {several} are all {same}",
                             f"all of the {several} are {same}", f"only one {box} has {several}")  # fmt: skip
            has = f"exist({items(noun, in_box('b'))})"
            return Said(text, f"count(filter_obj(all_boxes, lambda b: {has})) == 1")
        one, other = self.two_looks()
        first, second = self.few(3), self.few(3)
        nouns = Noun(one), Noun(other)
        things = f"{self.quantified(first, nouns[0]).text} and {self.quantified(second, nouns[1]).text}"
        text = self.pick(f"there are {things} {same}", f"{things} are {same}", f"there is {things} {same}")
        tests = f"{numbered(first, items(nouns[0], in_box('b')))} and {numbered(second, items(nouns[1], in_box('b')))}"
        return Said(text, f"exist(filter_obj(all_boxes, lambda b: {tests}))")

    def box_word(self) -> str:
        raise NotImplementedError

    def boxes_with(self) -> Said:
        raise NotImplementedError
