"""Corpora of statements, programs and start scenes: loading, validation, splits, the official release, vocabularies.

docs/corpus.md describes the file format, docs/official_data.md the official release.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lilgym_mp.corpus.faults import CorpusError, Fault, NoTasksError
from lilgym_mp.corpus.loading import load_all_tasks, load_tasks
from lilgym_mp.corpus.locations import official_directory
from lilgym_mp.corpus.tasks import Provenance, TaskSet, contexts
from lilgym_mp.submodules import submodule_getter

if TYPE_CHECKING:
    from lilgym_mp.corpus.checking import check_corpus
    from lilgym_mp.corpus.tokens import Vocabulary, VocabularyError, words
    from lilgym_mp.corpus.writing import write_corpus

__all__ = [
    "CorpusError",
    "Fault",
    "NoTasksError",
    "Provenance",
    "TaskSet",
    "Vocabulary",
    "VocabularyError",
    "check_corpus",
    "contexts",
    "load_all_tasks",
    "load_tasks",
    "official_directory",
    "words",
    "write_corpus",
]


def __getattr__(name: str) -> Any:
    """Imports, on first use, what a running environment does not need."""
    match name:
        case "Vocabulary" | "VocabularyError" | "words":
            from lilgym_mp.corpus import tokens as module
        case "check_corpus":
            from lilgym_mp.corpus import checking as module
        case "write_corpus":
            from lilgym_mp.corpus import writing as module
        case _:
            return submodule_getter(__name__)(name)
    return getattr(module, name)
