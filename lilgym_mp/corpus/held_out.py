"""Digests of dev and test statements, which generated training statements must not repeat.

The package ships the digests of the builtin and the official statements, so that training does not depend on which
files are installed. `scripts/digest_held_out.py` adds those of further installed splits.
"""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.resources import files

from lilgym_mp.corpus.faults import NoTasksError
from lilgym_mp.corpus.loading import load_all_tasks
from lilgym_mp.corpus.locations import BUILTIN, OFFICIAL
from lilgym_mp.corpus.tokens import normalised

FILE = "held_out_statements.txt"  # of lilgym_mp.data: comments after "#", then a digest per line
SPLITS = ("dev", "test")
DIGITS = 16  # hexadecimal


def statement_digest(statement: str) -> str:
    """A digest that statements equal in their words share."""
    return hashlib.sha256(f"lilgym_mp builtin {normalised(statement)}".encode()).hexdigest()[:DIGITS]


@cache
def shipped_digests() -> frozenset[str]:
    """The digests in the package's file."""
    lines = (files("lilgym_mp.data") / FILE).read_text(encoding="ascii").splitlines()
    return frozenset(line for line in lines if not line.startswith("#"))


def corpus_digests(corpus: str) -> frozenset[str]:
    """The digests of the corpus's dev and test statements, as far as it has them. Raises CorpusError."""
    try:
        return frozenset(
            statement_digest(task.statement) for tasks in load_all_tasks(corpus, splits=SPLITS) for task in tasks
        )
    except NoTasksError:
        return frozenset()


def held_out_digests(corpus: str) -> frozenset[str]:
    """The digests to exclude in training on the corpus: those shipped, and those of a corpus of the user's own."""
    return shipped_digests() if corpus in (BUILTIN, OFFICIAL) else shipped_digests() | corpus_digests(corpus)


def digests_sha256(digests: frozenset[str]) -> str:
    """The checksum by which a training run identifies what it excluded."""
    return hashlib.sha256("\n".join(sorted(digests)).encode()).hexdigest()
