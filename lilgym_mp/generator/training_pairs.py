"""An endless stream of statements with their programs, for training parsers: many wordings, no scenes."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from typing import NamedTuple

from lilgym_mp.choices import choose
from lilgym_mp.generator.noise import with_noise
from lilgym_mp.generator.template_boxes import Frames
from lilgym_mp.generator.template_phrases import Voice
from lilgym_mp.generator.template_scatter import ScatterFrames, scatter_voice
from lilgym_mp.generator.template_tower import TowerFrames, tower_voice

BOUND_SHARE = 0.4


class Pair(NamedTuple):
    """A statement and the program that says what it means."""

    statement: str
    program: str


KINDS: dict[str, tuple[type[Frames], Callable[[random.Random], Voice]]] = {
    "tower": (TowerFrames, tower_voice),
    "scatter": (ScatterFrames, scatter_voice),
}


def training_pairs(
    appearance: str, seed: int, *, noise: bool = True, bound_share: float = BOUND_SHARE
) -> Iterator[Pair]:
    """Endless pairs, the same for the same arguments.

    `noise` types statements as people do (`with_noise`); without it they are in lower case, without a full stop.
    A share `bound_share` of them comes from writers for whom a bare number can mean at least that many, and "one of the
    boxes" exactly one: people differ there. With 0 a statement always has the same meaning.
    Raises ValueError for an unknown appearance.
    """
    frames, voice = choose("appearance", appearance, KINDS)
    return _pairs(frames, voice, random.Random(f"pairs {appearance} {seed}"), noise, bound_share)


def _pairs(
    frames: type[Frames], voice: Callable[[random.Random], Voice], rng: random.Random, noise: bool, bound_share: float
) -> Iterator[Pair]:
    speaker = frames(rng, voice(rng))
    while True:
        speaker.voice = voice(rng)._replace(bare_number_is_bound=rng.random() < bound_share)
        text, program = speaker.said()
        yield Pair(with_noise(text, rng) if noise else text, program)
