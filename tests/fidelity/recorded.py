"""The release's recorded episodes, and the environments that must repeat them."""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym

from lilgym_mp.envs.registration import environment_id
from lilgym_mp.wrappers import StopForcing

Json = dict[str, Any]


class Recording(NamedTuple):
    """Which of the release's environments was recorded."""

    config: str  # such as "tower-flipit"
    split: str
    stop_forcing: bool

    def environment(self, official_data: Path) -> gym.Env[Any, Any]:
        """Ours, with the same data, rules and stop forcing."""
        env = gym.make(environment_id(*self.config.split("-")), corpus=official_data, split=self.split, rules="release")
        return StopForcing(env, mode="replace", allow_evaluation=True) if self.stop_forcing else env


RECORDINGS = [
    Recording(f"{appearance}-{start}", split, stop_forcing)
    for appearance in ("tower", "scatter")
    for start, split in (("scratch", "train"), ("scratch", "dev"), ("flipit", "dev"))
    for stop_forcing in (False, True)
]


def episodes(golden: Path) -> Iterator[Json]:
    with gzip.open(golden / "episodes.jsonl.gz", "rt", encoding="utf-8") as file:
        yield from map(json.loads, file)


def recording_of(episode: Json) -> Recording:
    return Recording(episode["config"], episode["split"], episode["stop_forcing"])
