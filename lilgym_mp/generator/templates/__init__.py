"""Endless statement-program pairs for training parsers: many wordings, no scenes.

They come from synchronous templates, whose parts each have words and program text. `phrases` has quantities, noun
phrases and predicates, `conditions` the conditions of boxes, `items` and `boxes` statements, `tower` and `scatter`
those of one appearance.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import replace

from lilgym_mp.choices import choose
from lilgym_mp.generator.noise import with_noise
from lilgym_mp.generator.templates.boxes import StatementTemplates
from lilgym_mp.generator.templates.phrases import TrainingPair
from lilgym_mp.generator.templates.scatter import ScatterTemplates
from lilgym_mp.generator.templates.tower import TowerTemplates

BOUND_SHARE = 0.4


TEMPLATES: dict[str, type[StatementTemplates]] = {"tower": TowerTemplates, "scatter": ScatterTemplates}


def training_pairs(
    appearance: str, seed: int, *, noise: bool = True, bound_share: float = BOUND_SHARE
) -> Iterator[TrainingPair]:
    """Endless pairs, deterministic in the arguments.

    With `noise` statements are typed as people do (`with_noise`), otherwise in lower case without a full stop.
    People differ over bare numbers: in a share `bound_share` of the pairs "two" can mean at least two, and "one of the
    boxes" exactly one. With 0 a statement always has the same meaning. Raises ValueError for an unknown appearance.
    """
    templates = choose("appearance", appearance, TEMPLATES)
    return _pairs(templates(random.Random(f"pairs {appearance} {seed}")), noise, bound_share)


def _pairs(sampler: StatementTemplates, noise: bool, bound_share: float) -> Iterator[TrainingPair]:
    while True:
        sampler.style = replace(sampler.random_style(), bare_number_is_bound=sampler.chance(bound_share))
        statement, program = sampler.sample()
        yield TrainingPair(with_noise(statement, sampler.rng) if noise else statement, program)
