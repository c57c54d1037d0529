"""Generates statements with programs and start scenes: the generated corpora, and most of the builtin corpus.

The stages, each in its module: `meaning_sampling` draws a meaning (`semantics`) of some difficulty level;
`program_realisation` and `sentence_realisation` turn it into a program and an English statement; `statement_grammar`
parses the statement back, and `validation` keeps it only if every parse, evaluated by `interpretation`, agrees with the
program on scenes of a pool (`scene_sampling`); `start_selection` selects start scenes. `training_pairs` uses separate
templates for a stream of more varied statements without scenes. See docs/corpus.md.
"""

from lilgym_mp.generator.generated_corpus import CorpusSpec, generated_entries, load_generated
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
    "load_generated",
    "random_meaning",
    "realise",
    "validate_draft",
]
