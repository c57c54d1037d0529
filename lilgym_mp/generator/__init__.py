"""Statements, programs and start scenes made by rule: the endless corpus, and most of the builtin one.

A random `meanings` tree of some level (`levels`) becomes a program (`sources`) and a statement (`wording`); the
statement is read back by a grammar of its own (`reading`) and judged scene by scene (`interpretation`) before
`entries` lets it pass. docs/corpus.md tells what each level holds and what is checked.
"""

from lilgym_mp.generator.entries import Draft, Entry, drafts, proven, worded
from lilgym_mp.generator.generated import Recipe, generated_entries, generated_tasks
from lilgym_mp.generator.levels import LEVELS, random_meaning
from lilgym_mp.generator.starts import Start, Stock

__all__ = [
    "LEVELS",
    "Draft",
    "Entry",
    "Recipe",
    "Start",
    "Stock",
    "drafts",
    "generated_entries",
    "generated_tasks",
    "proven",
    "random_meaning",
    "worded",
]
