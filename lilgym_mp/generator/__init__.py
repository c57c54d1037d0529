"""Statements, programs and start scenes made by rule: the endless corpus, and most of the builtin one.

A random `meanings` tree of some level (`levels`) becomes a program (`sources`) and a statement (`wording`); the
statement is read back by a grammar of its own (`reading`) and judged scene by scene (`interpretation`) before
`entries` lets it pass. docs/corpus.md tells what each level holds and what is checked.
"""

from lilgym_mp.generator.generated_corpus import CorpusSpec, generated_entries, generated_tasks
from lilgym_mp.generator.meaning_sampling import LEVELS, random_meaning
from lilgym_mp.generator.start_selection import ScenePool, StartScene
from lilgym_mp.generator.validation import Draft, Entry, drafts, realise, validate_draft

__all__ = [
    "LEVELS",
    "CorpusSpec",
    "Draft",
    "Entry",
    "ScenePool",
    "StartScene",
    "drafts",
    "generated_entries",
    "generated_tasks",
    "random_meaning",
    "realise",
    "validate_draft",
]
