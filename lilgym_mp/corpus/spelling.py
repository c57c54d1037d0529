"""Normalises statements to lower-case words, with digits for numbers and spelling errors corrected."""

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
LOST_FIRST_LETTER = {"ll": "all", "t": "at", "tleast": "atleast", "tmost": "atmost"}  # first words of statements
_NEAR_NUMBERS = """
    alone anyone atone bone cone den dine dive done dour eighth eights eighty elevens even everyone fen fight file fine
    fire fiver fives fix flour for foul fours fur give gone gotten hasten height hen hero hive hone hour ken light line
    live lone men might mine mix nice night nines nite none ode often once ones ore our owe pen pine pour right seen
    sevens sever sic sight sin sine sip sir sit someone sour sox tan tea tee teen tend tenor tens tent thee then there
    threes threw tight tin ton tone too tour tow tree twelves twos vine weight wine yen your zeros zone
"""
NEVER_NUMBERS = frozenset(_NEAR_NUMBERS.split())  # English words one error, or one space, away from a number word
MIN_LENGTH = 3  # shortest word that is corrected
LONG = 7  # letters; words at least this long may be corrected by two edits
MAX_LENGTH = 30  # longest word that is corrected
CACHED_WORDS = 20_000
_WORD = re.compile(r"[a-z]+|[0-9]+")
_NOT = re.compile(r"n't\b")
_IS = re.compile(r"\b(there|it|that|which|here)'s\b")
_POSSESSIVE = re.compile(r"'s\b|'")


def normalised_words(statement: str, known: Collection[str]) -> list[str]:
    """The words of the statement in lower case: no punctuation, "3" for "three", "is not" for "isn't".

    A word not in `known` (lower case) is corrected: it is split into two known words typed as one, or replaced by the
    unique nearest known word within Damerau-Levenshtein distance 1 (2 for words of 7 or more letters). No word in
    NEVER_NUMBERS becomes a number. A first word such as "ll", common in the official statements, gets its missing "a"
    back. Other words are kept.
    """
    corrector = _corrector(known if isinstance(known, frozenset) else frozenset(known))
    return [part for word in _plain_words(statement) for part in corrector.corrected(word)]


def plain_words(statement: str) -> list[str]:
    """The words of the statement as in `normalised_words`, without spelling correction."""
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
def _corrector(known: frozenset[str]) -> _SpellingCorrector:
    return _SpellingCorrector(known)


class _SpellingCorrector:
    """Known words indexed by their deletion neighbourhoods (the SymSpell algorithm)."""

    def __init__(self, known: frozenset[str]) -> None:
        self.known = known | NUMBERS.keys()
        self._by_deletion: dict[str, set[str]] = {}
        for word in self.known:
            if MIN_LENGTH <= len(word) <= MAX_LENGTH:
                for deletion in _deletions(word, _max_distance(word)):
                    self._by_deletion.setdefault(deletion, set()).add(word)
        self._nearest = lru_cache(maxsize=CACHED_WORDS)(self._find)

    def corrected(self, word: str) -> list[str]:
        """The corrected word, numbers as digits; two words if they were typed as one."""
        if word.isdigit():
            return [word.lstrip("0") or "0"]
        found = (word,) if word in self.known else self._nearest(word) if len(word) <= MAX_LENGTH else ()
        return [NUMBERS.get(part, part) for part in found or (word,)]

    def _find(self, word: str) -> tuple[str, ...]:
        """The intended known words; empty if none or ambiguous, or a number for a word in NEVER_NUMBERS."""
        found = self._closest(word)
        return () if word in NEVER_NUMBERS and not NUMBERS.keys().isdisjoint(found) else found

    def _closest(self, word: str) -> tuple[str, ...]:
        cuts = [(word[:at], word[at:]) for at in range(1, len(word))]
        splits = [cut for cut in cuts if cut[0] in self.known and cut[1] in self.known]
        if len(splits) == 1:
            return splits[0]
        if len(word) < MIN_LENGTH:
            return ()
        limit = _max_distance(word)
        candidates: set[str] = set()
        for deletion in _deletions(word, limit):
            candidates |= self._by_deletion.get(deletion, set())
        for distance in range(1, limit + 1):
            nearest = [
                other
                for other in candidates
                if min(_max_distance(other), limit) >= distance == _edit_distance(word, other, limit)
            ]
            if len(nearest) > 1:
                nearest = [other for other in nearest if (other[0], other[-1]) == (word[0], word[-1])]
                return (nearest[0],) if len(nearest) == 1 else ()
            if nearest:
                return (nearest[0],)
        return ()


def _max_distance(word: str) -> int:
    return 2 if len(word) >= LONG else 1


def _deletions(word: str, count: int) -> Iterator[str]:
    """All strings obtained by deleting up to `count` letters."""
    found = {word}
    for _ in range(count):
        found |= {text[:at] + text[at + 1 :] for text in found for at in range(len(text))}
    return iter(found)


def _edit_distance(one: str, other: str, limit: int) -> int:
    """The optimal string alignment distance; `limit` + 1 if the lengths differ by more than `limit`."""
    if abs(len(one) - len(other)) > limit:
        return limit + 1
    before: list[int] = []
    row = list(range(len(other) + 1))
    for i, letter in enumerate(one, start=1):
        new = [i]
        for j, other_letter in enumerate(other, start=1):
            cost = min(row[j] + 1, new[j - 1] + 1, row[j - 1] + (letter != other_letter))
            if i > 1 and j > 1 and letter == other[j - 2] and one[i - 2] == other_letter:
                cost = min(cost, before[j - 2] + 1)
            new.append(cost)
        before, row = row, new
    return row[-1]
