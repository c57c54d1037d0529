"""Typing noise: spelling mistakes, missing or doubled words, capitals and full stops. The meaning stays the same."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from random import Random

from lilgym_mp.corpus.generator.writer import phrase_tables

MIN_LETTERS = 4  # shorter words are not misspelt
ARTICLES = frozenset({"a", "an", "the"})
NEEDS_ARTICLE = ("only", "other", "same", "most", "single", "couple", "pair")
JOINABLE = frozenset({("at", "least"), ("is", "a"), ("at", "most"), ("a", "box"), ("there", "is"), ("in", "the")})


def with_noise(statement: str, rng: Random) -> str:
    """The statement as people type it: synonyms, articles, word boundaries, spelling, capitals and full stop vary."""
    text = statement.rstrip(" .!")
    text = text[:1].lower() + text[1:]
    draw = rng.random
    if draw() < 0.05:
        synonyms = phrase_tables()["synonyms"]
        text = _edited(text, rng, lambda word, _: word in synonyms, lambda word: [rng.choice(synonyms[word])])
    if draw() < 0.1:
        text = _edited(text, rng, _is_omissible, lambda article: [])
    if draw() < 0.04:
        text = _with_joined_words(text)
    if draw() < 0.02:
        text = _edited(text, rng, lambda word, _: True, lambda word: [word, word])
    if draw() < 0.12:
        text = _edited(text, rng, _is_long_word, lambda word: [_misspelt(word, rng)])
    return _capitalised_and_stopped(text, rng)


def _edited(
    text: str,
    rng: Random,
    applies: Callable[[str, str | None], bool],
    edit: Callable[[str], list[str]],
) -> str:
    """The text with a random one of the words to which the edit applies, given the word after it, replaced."""
    words = text.split(" ")
    pairs = zip(words, (*words[1:], None), strict=True)
    if indices := [index for index, pair in enumerate(pairs) if applies(*pair)]:
        index = rng.choice(indices)
        words[index : index + 1] = edit(words[index])
    return " ".join(words)


def _is_omissible(word: str, following: str | None) -> bool:
    return word in ARTICLES and following is not None and following not in NEEDS_ARTICLE


def _is_long_word(word: str, _: str | None) -> bool:
    return len(word) >= MIN_LETTERS and word.isalpha()


def _misspelt(word: str, rng: Random) -> str:
    misspellings = phrase_tables()["misspellings"]
    if word in misspellings and rng.random() < 0.4:
        return rng.choice(misspellings[word])
    at = rng.randrange(1, len(word) - 1)  # neither the first letter nor the last
    match rng.choice(("swap", "drop", "double", "replace")):
        case "swap":
            return word[:at] + word[at + 1] + word[at] + word[at + 2 :]
        case "drop":
            return word[:at] + word[at + 1 :]
        case "double":
            return word[:at] + word[at] + word[at:]
        case _:
            return word[:at] + rng.choice("aeionrst") + word[at + 1 :]


def _with_joined_words(text: str) -> str:
    words = text.split(" ")
    for index, pair in enumerate(pairwise(words)):
        if pair in JOINABLE:
            return " ".join([*words[:index], "".join(pair), *words[index + 2 :]])
    return text


def _capitalised_and_stopped(text: str, rng: Random) -> str:
    """The text with or without a capital and full stop; rarely without its first letter."""
    draw = rng.random()
    if draw < 0.85:
        text = text[:1].upper() + text[1:]
    if draw > 0.99:
        text = text[1:]
    draw = rng.random()
    stop = "." if draw < 0.82 else "" if draw < 0.95 else " ." if draw < 0.98 else ". "
    return text + stop
