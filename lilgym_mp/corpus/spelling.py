"""Normalises statements to lower-case words, with digits for numbers and spelling errors corrected."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Iterator
from functools import cache, lru_cache
from importlib.resources import files
from typing import NamedTuple

from lilgym_mp.corpus.tokens import NUMERALS
from lilgym_mp.scene.arrays import Strings

NUMBERS = {word: str(number) for number, word in enumerate(NUMERALS)}
CONTRACTIONS = (
    ("can't", "can not"),
    ("won't", "will not"),
    ("doesnt", "does not"),
    ("isnt", "is not"),
    ("arent", "are not"),
    ("dont", "do not"),
    ("ain't", "is not"),
    ("cannot", "can not"),
)
LOST_FIRST_LETTER = {"ll": "all", "t": "at", "tleast": "atleast", "tmost": "atmost"}  # first words of statements
MIN_LENGTH = 3  # shortest word that a correction gives
MIN_REPLACED = 4  # letters; in shorter words no letter is replaced
MIN_VARIED = 5  # letters; a shorter well-spelt word is kept, a longer one can become a variant ("colours": "colors")
MIN_BEHEADED = 5  # letters; shorter words do not get a first letter
CACHED_WORDS = 20_000
FULL_WIDTH = 0xFEE0  # between a full-width sign and its ASCII form
_WORD = re.compile(r"""[^\W\d_]+|[0-9]+|[^\w\s.,;:!?'"()/*…“”‘’–—-]+""")  # letters, digits or signs such as ">"
_INTERJECTION = re.compile(r"\W*[^\W\d_]+\W*,")
_NOT = re.compile(r"n't\b")
_IS = re.compile(r"\b(there|it|that|which|here)'s\b")
_NO = (  # ways to say that there is no such thing, which statements of the corpora say with "no"; "up to"
    (re.compile(r"\bthere (is|are) not an?\b(?! single)"), r"there \1 no"),
    (re.compile(r"\bthere (?:does|do) not exist (?:a single|an?|any)\b"), "there is no"),
    (re.compile(r"\bthere exists? no\b"), "there is no"),
    (re.compile(r"^(\W*)(?:a single|an?|any) ([^,;]*?) (?:does|do) not exist\b(?=\W*$)"), r"\1there is no \2"),
    (
        re.compile(
            r"\b(there (?:is|are)|with|has|have|holds?|contains?) (?:exactly )?(?:zero|0|(?:fewer|less) than (?:one|1))"
            r" (?!or\b|to\b|and\b)(?=[a-z])"
        ),
        r"\1 no ",
    ),
    (re.compile(rf"\bup to (?=\d|(?:{'|'.join(NUMERALS)})\b)"), "at most "),
)
_POSSESSIVE = re.compile(r"'s\b|'")


class WordLists(NamedTuple):
    """The lists of `data/spelling.txt`, which says what they are for; number words are well spelt, too."""

    well_spelt: frozenset[str]
    others: frozenset[str]
    interjections: frozenset[str]


@cache
def word_lists() -> WordLists:
    """The lists in data/spelling.txt; numbers count as well spelt."""
    _, *lists = (files("lilgym_mp.data") / "spelling.txt").read_text(encoding="ascii").split("#")
    well_spelt, *others = (frozenset(text.split("\n", 1)[1].split()) for text in lists)
    return WordLists(well_spelt | NUMBERS.keys(), *others)


def normalised_words(statement: str, known: Collection[str]) -> list[str]:
    """The words of the statement in lower case: no punctuation, "3" for "three", "is not" for "isn't".

    A word not in `known` (lower case) is corrected if it is two words typed as one, or one error away from a single
    word: a letter left out, added or replaced, or two swapped. Corrections give well-spelt words in `known`, or number
    words; other English words are kept, as are words that could be several. A first word such as "ll", common
    in the official statements, gets its missing "a" back; an unknown one before a comma ("Look, ...") is left out.
    """
    return [NUMBERS.get(part, part) for _, parts in _read(statement, known) for part in parts]


def corrections(statement: str, known: Collection[str]) -> dict[str, str]:
    """The words of the statement that `normalised_words` corrects, as typed in lower case, with what they become.

    An empty text means that the word is left out.
    """
    return {typed: " ".join(parts) for typed, parts in _read(statement, known) if parts != (typed,)}


def unread_words(statement: str, known: Collection[str]) -> list[str]:
    """What `normalised_words` leaves out and may mean something: a first word, or a text without words."""
    left_out = [
        typed for typed, parts in _read(statement, known) if not parts and typed not in word_lists().interjections
    ]
    return left_out if _typed_words(statement) else [statement.strip()]


def plain_words(statement: str) -> list[str]:
    """The words of the statement as in `normalised_words`, without spelling correction."""
    return [NUMBERS.get(word, word) for word in _with_first_letter(_typed_words(statement))]


def _typed_words(statement: str) -> list[str]:
    """The words of the statement, and signs, in lower case and without contractions; numbers without leading zeros."""
    text = "".join(map(_plain_sign, statement.lower())).replace("\N{RIGHT SINGLE QUOTATION MARK}", "'")
    for short, long in CONTRACTIONS:
        text = re.sub(rf"\b{short}\b", long, text)
    text = _IS.sub(r"\1 is", _NOT.sub(" not", text))
    for pattern, plain in _NO:
        text = pattern.sub(plain, text)
    text = _POSSESSIVE.sub("", text)
    return [word.lstrip("0") or "0" if word.isdigit() else word for word in _WORD.findall(text)]


def _plain_sign(sign: str) -> str:
    """The ASCII form of a digit of any script and of a full-width sign; others as they are."""
    if sign.isascii():
        return sign
    digit = unicodedata.decimal(sign, None)
    if digit is not None:
        return str(digit)
    return chr(ord(sign) - FULL_WIDTH) if "\uff01" <= sign <= "\uff5e" else sign


def _with_first_letter(words: list[str]) -> list[str]:
    return [LOST_FIRST_LETTER.get(word, word) for word in words[:1]] + words[1:]


def _read(statement: str, known: Collection[str]) -> Iterator[tuple[str, Strings]]:
    """Each word as typed, and the words it is read as."""
    known = known if isinstance(known, frozenset) else frozenset(known)
    well_spelt, others, _ = word_lists()
    words = _typed_words(statement)
    may_leave_out = _INTERJECTION.match(statement.lower()) is not None
    for typed, word in zip(words, _with_first_letter(words), strict=True):
        is_kept = word in known or word in NUMBERS or word in others
        parts = (word,) if is_kept else _corrected(word, known)
        yield typed, () if may_leave_out and parts == (word,) and not {word} & (known | well_spelt) else parts
        may_leave_out = False


@lru_cache(maxsize=CACHED_WORDS)
def _corrected(word: str, known: frozenset[str]) -> Strings:
    well_spelt = word_lists().well_spelt
    choices = well_spelt & (known | NUMBERS.keys())
    cuts = ((word[:at], word[at:]) for at in range(1, len(word)))
    splits = [cut for cut in cuts if choices.issuperset(cut)]
    near = [other for other in choices if len(other) >= MIN_LENGTH and _is_error(word, other)]
    if word in well_spelt:
        near = [other for other in near if len(word) >= MIN_VARIED and len(other) != len(word)]
    elif len(splits) == 1:
        return splits[0]
    if len(near) > 1:
        near = [other for other in near if (other[0], other[-1]) == (word[0], word[-1])]
    return (near[0],) if len(near) == 1 else (word,)


def _is_error(typed: str, word: str) -> bool:
    """Whether `typed` is `word` with a letter left out, added or replaced, or two neighbours swapped."""
    differing = (at for at, (a, b) in enumerate(zip(typed, word, strict=False)) if a != b)
    at = next(differing, min(len(typed), len(word)))
    match len(word) - len(typed):
        case 1:
            return typed[at:] == word[at + 1 :] and (at > 0 or len(typed) >= MIN_BEHEADED)
        case -1:
            return typed[at + 1 :] == word[at:] and at > 0
        case 0 if typed[at + 1 :] == word[at + 1 :]:
            return at > 0 and len(typed) >= MIN_REPLACED
        case 0:
            return typed[at:] == word[at : at + 2][::-1] + word[at + 2 :]
        case _:
            return False
