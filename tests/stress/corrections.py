"""Spelling corrections made in the statements of both corpora, for a person to read.

    python -m tests.stress.corrections [--corpora builtin lilgym]

Known are the words of at least two train statements, as in training.
"""

from __future__ import annotations

import argparse
from collections import Counter

from lilgym_mp.corpus import load_all_tasks
from lilgym_mp.corpus.spelling import corrections, plain_words


def words_of(corpus: str, splits: tuple[str, ...]) -> Counter[str]:
    """In how many distinct statements each word occurs."""
    statements = {task.statement for tasks in load_all_tasks(corpus, splits=splits) for task in tasks}
    return Counter(word for statement in statements for word in set(plain_words(statement)))


def corrected(corpus: str) -> dict[str, str]:
    """Each word of the corpus that is corrected, with its correction."""
    known = frozenset(word for word, count in words_of(corpus, ("train",)).items() if count > 1)
    return corrections(" ".join(sorted(words_of(corpus, ("train", "dev", "test")))), known)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpora", nargs="+", default=["builtin", "lilgym"])
    for corpus in parser.parse_args().corpora:
        found = corrected(corpus)
        print(f"{corpus}: {len(found)} words")
        for word, correction in found.items():
            print(f"  {word} -> {correction}")


if __name__ == "__main__":
    main()
