"""Generates statements with programs, in two ways (docs/generators.md).

`meanings` makes the generated corpora and most of the builtin corpus: tasks with start scenes, in checked wordings.
`templates`, with `training_pairs`, makes a stream of more varied wordings without scenes.
"""

from lilgym_mp.generator.meanings.generated_corpus import CorpusSpec, generated_entries, load_generated
from lilgym_mp.generator.meanings.sampling import LEVELS, random_meaning
from lilgym_mp.generator.meanings.start_selection import ScenePool, StartScene
from lilgym_mp.generator.meanings.validation import Draft, Entry, drafts, realise, validate_draft

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
