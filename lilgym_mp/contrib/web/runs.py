"""Recordings and agents in the directory given by `--runs`, and the agents shipped with the package.

No part of a request is ever joined to a path: ids are looked up among the files found by listing the directory.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import tempfile
from contextlib import suppress
from functools import lru_cache
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from fastapi import HTTPException

from lilgym_mp.contrib.web.responses import LOGGER, refusing
from lilgym_mp.envs.proposer_verifier import GameSettings, Partner, Role
from lilgym_mp.evaluation.episode_files import Header, Recording, read_episodes, read_header
from lilgym_mp.evaluation.files import SUFFIX, EpisodesError
from lilgym_mp.learning.common.learners import shipped_agents
from lilgym_mp.learning.common.run_directory import AGENT_FILE

if TYPE_CHECKING:
    from lilgym_mp.learning.common.agents import Agent

MAX_FILES = 2_000  # listed per kind
RECORDING_CACHE_SIZE = 6
AGENT_CACHE_SIZE = 8
# Followed by the agent's name, or by the run's id
SHIPPED_PREFIX = "agent:"
RUN_PREFIX = "run:"
PARSER = SHIPPED_PREFIX + "parse-and-plan"  # reads any sentence, plays every configuration


class FoundFile(NamedTuple):
    """A recording, or the agent of a run."""

    id: str  # hash of its path relative to the directory
    name: str  # of a recording, that path without the suffix; of an agent, the path of its run
    path: Path
    stamp: tuple[int, int]  # modification time in ns and size; a change invalidates cache entries


class Runs:
    """Lists the directory on every call, so new and changed files appear without a restart; caches their content.

    Loads agents on first use; there are none if torch is not installed.
    """

    def __init__(self, directory: Path | None) -> None:
        self.directory = directory
        self.requested = Path(tempfile.mkdtemp(prefix="lilgym-mp-"))  # recordings made on request in the browser
        atexit.register(shutil.rmtree, self.requested, ignore_errors=True)
        self._agent = lru_cache(AGENT_CACHE_SIZE)(self._load)

    def recordings(self) -> dict[FoundFile, Header]:
        """Every recording with its header, sorted by name; damaged ones are left out, and logged."""
        files = self._find(f"*{SUFFIX}").values()
        return {file: header for file in files if (header := _header(file)) is not None}

    def read(self, recording_id: str) -> Recording:
        """The recording with that id. Responds with 404 if there is none, 422 if it is unreadable."""
        file = self._find(f"*{SUFFIX}").get(recording_id)
        if file is None:
            raise HTTPException(404, "there is no such recording; it may have been moved: reload the list")
        try:
            return _read(file)
        except EpisodesError as fault:
            raise HTTPException(422, str(fault).replace(str(file.path), file.name)) from None

    def agents(self) -> dict[str, str]:
        """Names of agents to display, by form value."""
        if find_spec("torch") is None:
            return {}
        shipped = {SHIPPED_PREFIX + name: f"{name} (included)" for name in shipped_agents()}
        return shipped | {RUN_PREFIX + run.id: f"run {run.name}" for run in self._find(AGENT_FILE).values()}

    def file_of(self, name: str) -> FoundFile | None:
        """The model file of a run's agent; None for an included agent."""
        return self._find(AGENT_FILE).get(name.removeprefix(RUN_PREFIX))

    def plays(self, name: str) -> tuple[str, ...]:
        """The configurations that an agent plays alone; an agent of the game, or a damaged file, plays none."""
        from lilgym_mp.learning.common.agents import agent_file
        from lilgym_mp.learning.common.learners import find_learner
        from lilgym_mp.learning.common.model_file import read_description

        file = self.file_of(name)
        with suppress(ValueError):
            shipped = Path(name.removeprefix(SHIPPED_PREFIX))
            description = read_description(agent_file(shipped) if file is None else file.path)
            if not find_learner(description.kind).plays_games:
                return description.configurations
        return ()

    def partner(self, name: str, role: Role, game: GameSettings) -> Partner:
        """Responds with 404 if there is no such agent, 422 if it cannot play this side of the game."""
        agent = self.agent(name)
        own = agent.game or game
        with refusing():
            partner = agent.partner(role, own)
        if (own.appearance, own.protocol) != (game.appearance, game.protocol) or partner is None:
            plays = f"{own.appearance} under the protocol {own.protocol}"
            raise HTTPException(422, f"this agent plays {plays}; choose that, and a side that it has learned")
        return partner

    def agent(self, name: str) -> Agent:
        """Responds with 404 if there is no such agent, 422 if its file cannot be read."""
        if name not in self.agents():
            raise HTTPException(404, "there is no such agent; reload the page to see the current ones")
        with refusing():
            file = self.file_of(name)
            return self._agent(name, file)

    def _load(self, name: str, file: FoundFile | None) -> Agent:
        from lilgym_mp.learning.common.agents import load_agent, open_agent

        shipped = name.removeprefix(SHIPPED_PREFIX)
        return load_agent(shipped, "cpu") if file is None else open_agent(file.path.parent, "cpu")

    def _find(self, pattern: str) -> dict[str, FoundFile]:
        """Files by id; requested recordings first, the latest at the top."""
        requested = sorted(_find(self.requested, pattern).values(), key=lambda file: file.stamp, reverse=True)
        found = {file.id: file for file in requested}
        return found if self.directory is None else found | _find(self.directory, pattern)


def _find(directory: Path, pattern: str) -> dict[str, FoundFile]:
    """Files by id."""
    found: dict[str, FoundFile] = {}
    for path in islice(sorted(directory.rglob(pattern)), MAX_FILES):
        with suppress(OSError):  # removed since it was listed
            status = path.stat()
            relative = path.relative_to(directory)
            name = str(relative.parent) if pattern == AGENT_FILE else str(relative).removesuffix(SUFFIX)
            key = hashlib.sha256(os.fsencode(relative)).hexdigest()[:16]
            found[key] = FoundFile(key, name, path, (status.st_mtime_ns, status.st_size))
    return found


@lru_cache(maxsize=MAX_FILES)
def _header(file: FoundFile) -> Header | None:
    try:
        return read_header(file.path)
    except EpisodesError as fault:
        LOGGER.warning("%s", fault)
        return None


@lru_cache(maxsize=RECORDING_CACHE_SIZE)
def _read(file: FoundFile) -> Recording:
    return read_episodes(file.path)
