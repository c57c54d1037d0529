"""Statements, programs and start scenes: loading, checking, splits, the official release, words.

docs/corpus.md describes the file format; imports of this package are light.
"""

from lilgym_mp.corpus.checking import CorpusReport, TaskCount, check_corpus
from lilgym_mp.corpus.faults import CorpusError, Fault
from lilgym_mp.corpus.jsonlines import write_corpus
from lilgym_mp.corpus.loading import load_tasks
from lilgym_mp.corpus.places import official_directory, user_cache
from lilgym_mp.corpus.released import ALL_FILE_NAMES as RELEASED_FILE_NAMES
from lilgym_mp.corpus.tasks import Provenance, TaskSet, contexts
from lilgym_mp.corpus.tokens import Vocabulary, VocabularyError, words

__all__ = [
    "RELEASED_FILE_NAMES",
    "CorpusError",
    "CorpusReport",
    "Fault",
    "Provenance",
    "TaskCount",
    "TaskSet",
    "Vocabulary",
    "VocabularyError",
    "check_corpus",
    "contexts",
    "load_tasks",
    "official_directory",
    "user_cache",
    "words",
    "write_corpus",
]
