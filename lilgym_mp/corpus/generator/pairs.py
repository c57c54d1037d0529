"""Statement-program pairs: streams for training parsers, and statements by level, for people and language models."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from random import Random
from typing import NamedTuple

from lilgym_mp.corpus.generator.boxes import Statements
from lilgym_mp.corpus.generator.noise import with_noise
from lilgym_mp.corpus.generator.scatter import ScatterStatements
from lilgym_mp.corpus.generator.tower import TowerStatements
from lilgym_mp.corpus.generator.writer import TrainingPair
from lilgym_mp.scene.appearances import APPEARANCES, part_of
from lilgym_mp.scene.choices import choose

BOUND_SHARE = 0.4
TEMPLATES: dict[str, type[Statements]] = {"tower": TowerStatements, "scatter": ScatterStatements}
# "one of the boxes has ...", read as at least one by some people and as exactly one by others
AMBIGUOUS = re.compile(r"(?:^|, |\b(?:and|but|or|while|also|either|where) )(?:one|1) (?:out )?of\b")


class Level(NamedTuple):
    """What the programs of a level may be."""

    size: int  # most names and numbers in a program
    excluded: re.Pattern[str]  # program words that only higher levels have


_ITEM_RELATIONS = r"get_(?!set_)"  # "touching a circle", "above a blue block"
_BOX_PAIRS = r"combinations|all_same_attribute"  # "two towers of the same height"
LEVELS = {
    1: Level(14, re.compile(rf"box|All|is_top|is_bottom|is_second|is_third|touching|{_ITEM_RELATIONS}|{_BOX_PAIRS}")),
    2: Level(16, re.compile(rf"{_ITEM_RELATIONS}|{_BOX_PAIRS}")),
    3: Level(22, re.compile(_BOX_PAIRS)),
    4: Level(30, re.compile(r"(?!)")),
    5: Level(60, re.compile(r"(?!)")),
}


def templates_of(appearance: str) -> type[Statements]:
    """The generator's templates for an appearance. Raises ValueError naming the appearances that have some."""
    choose("appearance", appearance, APPEARANCES)
    return part_of(appearance, "generator of statements", TEMPLATES)


def training_pairs(
    appearance: str, seed: int, *, noise: bool = True, bound_share: float = BOUND_SHARE
) -> Iterator[TrainingPair]:
    """Endless pairs, deterministic in the arguments.

    With `noise` statements are typed as people do (`with_noise`), otherwise in lower case without a full stop.
    People differ over bare numbers: in a share `bound_share` of the pairs "two" can mean at least two, and "one of the
    boxes" exactly one. With 0 a statement always has the same meaning. Raises ValueError for an unknown appearance.
    """
    sampler = templates_of(appearance)(Random(f"pairs {appearance} {seed}"))
    while True:
        sampler.style = replace(sampler.random_style(), bare_number_is_bound=sampler.chance(bound_share))
        statement, program = sampler.sample()
        yield TrainingPair(with_noise(statement, sampler.rng) if noise else statement, program)


def level_of(program: str) -> int | None:
    """The lowest level that admits the program; None if it is longer than those of the highest."""
    size = len(re.findall(r"\w+", program))
    admitting = (level for level, (most, excluded) in LEVELS.items() if size <= most and not excluded.search(program))
    return next(admitting, None)


def check_level(level: int) -> None:
    """Raises ValueError for an unknown level, naming the choices."""
    if level not in LEVELS:
        raise ValueError(f"unknown level {level!r}; choose from {', '.join(map(str, LEVELS))}")


def statements(appearance: str, level: int, rng: Random) -> Iterator[TrainingPair]:
    """Endless statements of a level in correct spelling and grammar, each with one meaning, and their programs.

    Numbers are exact; wordings that people read in two ways are left out. The call itself draws from `rng`, before the
    first statement is asked for. Raises ValueError for an unknown appearance or level.
    """
    sampler = templates_of(appearance)(rng)
    check_level(level)
    return _statements(sampler, level)


def _statements(sampler: Statements, level: int) -> Iterator[TrainingPair]:
    while True:
        sampler.style = replace(sampler.random_style(), sloppy=False)
        text, program = sampler.sample()
        if level_of(program) == level and not AMBIGUOUS.search(text):
            text = text.replace("atleast", "at least")
            yield TrainingPair(f"{text[0].upper()}{text[1:]}.", program)
