"""Generates statements with programs from synchronous templates, whose parts each have words and program text.

The words are in `data/phrases.toml`. `writer` has quantities, noun phrases and predicates, `conditions` the conditions
of boxes, `items` and `boxes` statements, `tower` and `scatter` those of one appearance, `pairs` streams of them,
`generated_corpus` task sets.
"""

from lilgym_mp.corpus.generator.generated_corpus import (
    CorpusSpec,
    GeneratedStatement,
    generated_entries,
    load_generated,
    split_of,
)
from lilgym_mp.corpus.generator.pairs import LEVELS, level_of, statements, training_pairs
from lilgym_mp.corpus.generator.writer import TrainingPair
from lilgym_mp.submodules import submodule_getter

__all__ = [
    "LEVELS",
    "CorpusSpec",
    "GeneratedStatement",
    "TrainingPair",
    "generated_entries",
    "level_of",
    "load_generated",
    "split_of",
    "statements",
    "training_pairs",
]

__getattr__ = submodule_getter(__name__)
