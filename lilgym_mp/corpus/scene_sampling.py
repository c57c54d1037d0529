"""The sampler of random scenes of an appearance, and of changes by one item."""

from __future__ import annotations

from functools import cache

from lilgym_mp.scene.appearances import APPEARANCES, make_appearance, part_of
from lilgym_mp.scene.appearances.base import optional
from lilgym_mp.scene.appearances.sampling import Sampler


@cache
def sampler_of(appearance: str) -> Sampler:
    """The sampler of an appearance's scenes. Raises UnsupportedAppearance naming the appearances that have one."""
    samplers = {name: optional(make_appearance(name), "sampler") for name in APPEARANCES}
    return part_of(appearance, "sampler of scenes", {name: each for name, each in samplers.items() if each is not None})
