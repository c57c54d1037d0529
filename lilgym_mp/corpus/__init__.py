"""Corpora of statements, programs and start scenes: loading, validation, splits, the official release, vocabularies.

docs/corpus.md describes the file format, docs/official_data.md the official release.
"""

from lilgym_mp.corpus.checking import CorpusReport, TaskCount, check_corpus
from lilgym_mp.corpus.faults import CorpusError, Fault, NoTasksError
from lilgym_mp.corpus.jsonlines import write_corpus
from lilgym_mp.corpus.loading import load_all_tasks, load_tasks
from lilgym_mp.corpus.locations import official_directory, user_cache
from lilgym_mp.corpus.tasks import Provenance, TaskSet, contexts
from lilgym_mp.corpus.tokens import Vocabulary, VocabularyError, statement_form, words

__all__ = [
    "CorpusError",
    "CorpusReport",
    "Fault",
    "NoTasksError",
    "Provenance",
    "TaskCount",
    "TaskSet",
    "Vocabulary",
    "VocabularyError",
    "check_corpus",
    "contexts",
    "load_all_tasks",
    "load_tasks",
    "official_directory",
    "statement_form",
    "user_cache",
    "words",
    "write_corpus",
]
