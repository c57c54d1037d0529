"""A statement as plain words: lower case, digits for numbers, slips of the typing hand repaired."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from functools import lru_cache

NUMBERS = {
    word: str(number)
    for number, word in enumerate(
        ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")
    )
}
CONTRACTIONS = (
    ("can't", "can not"),
    ("won't", "will not"),
    ("doesnt", "does not"),
    ("isnt", "is not"),
    ("arent", "are not"),
    ("dont", "do not"),
)
LOST_FIRST_LETTER = {"ll": "all", "t": "at", "tleast": "atleast", "tmost": "atmost"}  # as a statement's first word
SHORTEST = 3  # letters of a word that is repaired
LONG = 7  # letters from which on two slips are repaired
LONGEST = 30  # letters: no longer word is looked at
CACHED_WORDS = 20_000
_WORD = re.compile(r"[a-z]+|[0-9]+")
_NOT = re.compile(r"n't\b")
_IS = re.compile(r"\b(there|it|that|which|here)'s\b")
_POSSESSIVE = re.compile(r"'s\b|'")


def normalised_words(statement: str, known: Collection[str], *, unknown: str | None = None) -> list[str]:
    """The words of the statement in lower case: no punctuation, "3" for "three", "is not" for "isn't".

    A word that is not among `known` (lower case) becomes the known word that it nearly is: two known words typed
    as one, else the only nearest one, at most one slip away (two from 7 letters on; a slip is a letter too many, too
    few, wrong, or changing places with the next). A first word such as "ll" gets back the "a" that it has lost: many
    official statements begin so. Other words stay, or become `unknown` where that is given.
    """
    speller = _speller(known if isinstance(known, frozenset) else frozenset(known))
    words: list[str] = []
    for word in _plain_words(statement):
        words += speller.repaired(word, unknown)
    return words


def plain_words(statement: str) -> list[str]:
    """The words of the statement as `normalised_words` gives them, but that nothing is repaired."""
    words = (word.lstrip("0") or "0" if word.isdigit() else word for word in _plain_words(statement))
    return [NUMBERS.get(word, word) for word in words]


def _plain_words(statement: str) -> list[str]:
    text = statement.lower().replace("\N{RIGHT SINGLE QUOTATION MARK}", "'")
    for short, long in CONTRACTIONS:
        text = text.replace(short, long)
    text = _POSSESSIVE.sub("", _IS.sub(r"\1 is", _NOT.sub(" not", text)))
    words: list[str] = _WORD.findall(text)
    return [LOST_FIRST_LETTER.get(word, word) for word in words[:1]] + words[1:]


@lru_cache(maxsize=8)
def _speller(known: frozenset[str]) -> _Speller:
    return _Speller(known)


class _Speller:
    """Known words, findable by what is left of them when one or two letters are lost."""

    def __init__(self, known: frozenset[str]) -> None:
        self.known = known | NUMBERS.keys()
        self._by_rest: dict[str, set[str]] = {}
        for word in self.known:
            if SHORTEST <= len(word) <= LONGEST:
                for rest in _rests(word, _reach(word)):
                    self._by_rest.setdefault(rest, set()).add(word)
        self._nearest = lru_cache(maxsize=CACHED_WORDS)(self._find)

    def repaired(self, word: str, unknown: str | None) -> list[str]:
        """The word, as digits where it is a number; two where they were typed as one."""
        if word.isdigit():
            return [word.lstrip("0") or "0"]
        found = (word,) if word in self.known else self._nearest(word) if len(word) <= LONGEST else ()
        if not found:
            return [word if unknown is None else unknown]
        return [NUMBERS.get(part, part) for part in found]

    def _find(self, word: str) -> tuple[str, ...]:
        """The known words that were meant; none when that is not certain."""
        cuts = [(word[:at], word[at:]) for at in range(1, len(word))]
        splits = [cut for cut in cuts if cut[0] in self.known and cut[1] in self.known]
        if len(splits) == 1:
            return splits[0]
        if len(word) < SHORTEST:
            return ()
        reach = _reach(word)
        candidates: set[str] = set()
        for rest in _rests(word, reach):
            candidates |= self._by_rest.get(rest, set())
        for slips in range(1, reach + 1):
            near = [other for other in candidates if min(_reach(other), reach) >= slips == _slips(word, other, reach)]
            if len(near) > 1:
                near = [other for other in near if (other[0], other[-1]) == (word[0], word[-1])]
                return (near[0],) if len(near) == 1 else ()
            if near:
                return (near[0],)
        return ()


def _reach(word: str) -> int:
    return 2 if len(word) >= LONG else 1


def _rests(word: str, losses: int) -> Iterator[str]:
    """The word, and what is left of it when up to so many letters are lost."""
    rests = {word}
    for _ in range(losses):
        rests |= {rest[:at] + rest[at + 1 :] for rest in rests for at in range(len(rest))}
    return iter(rests)


def _slips(one: str, other: str, most: int) -> int:
    """The letters too many, too few, wrong or exchanged with a neighbour between the words; `most` + 1 for more."""
    if abs(len(one) - len(other)) > most:
        return most + 1
    before: list[int] = []
    row = list(range(len(other) + 1))
    for i, letter in enumerate(one, start=1):
        new = [i]
        for j, its in enumerate(other, start=1):
            cost = min(row[j] + 1, new[j - 1] + 1, row[j - 1] + (letter != its))
            if i > 1 and j > 1 and letter == other[j - 2] and one[i - 2] == its:
                cost = min(cost, before[j - 2] + 1)
            new.append(cost)
        before, row = row, new
    return row[-1]
