"""A server's options, the objects shared by all routes, and the FastAPI dependency that provides them."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path
from typing import Annotated

from fastapi import Depends, Request

from lilgym_mp.contrib.web.database import Database
from lilgym_mp.contrib.web.live_games import LiveGames
from lilgym_mp.contrib.web.runs import Runs
from lilgym_mp.corpus import NoTasksError, TaskSet, load_all_tasks
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation import CONFIGURATIONS
from lilgym_mp.programs.task import Task
from lilgym_mp.scene.appearances import APPEARANCES, UnsupportedAppearance
from lilgym_mp.solver import Solver

NOT_PLAYED = ": not in this corpus"  # ends the text of an option that cannot be chosen
LOOPBACK_HOSTS = ("127.0.0.1", "localhost", "::1")


@dataclass(frozen=True, slots=True)
class ServeOptions:
    """Corpus, data locations, access control and limits."""

    corpus: str = "builtin"
    database: Path = Path("lilgym-web.sqlite3")
    runs: Path | None = None  # directory with training runs and recorded episodes
    token: str | None = None  # needed for every page; None: no token is needed
    hosts: tuple[str, ...] | None = (*LOOPBACK_HOSTS, "testserver")  # accepted Host headers; None: any
    host_names: tuple[str, ...] = ()  # names under which a proxy serves the pages, also accepted


class AppServices:
    """The corpus, database, runs and games of one server; tasks, dynamics and solvers are loaded on first use.

    `dynamics(configuration)` and `solver(configuration)` raise ValueError for unknown names; the latter raises
    UnsupportedAppearance.
    """

    def __init__(self, options: ServeOptions) -> None:
        """Raises DatabaseError for an unusable database, CorpusError for an unusable corpus or one without tasks."""
        self.corpus = options.corpus
        next(load_all_tasks(self.corpus, needs_tasks=False))
        self.database = Database(options.database)
        self.runs = Runs(options.runs)
        self.games = LiveGames()
        self.dynamics = cache(lambda configuration: self.settings(configuration).dynamics())
        self.solver = cache(lambda configuration: Solver(self.dynamics(configuration)))

    def settings(self, configuration: str) -> EnvConfig:
        """The environment, with the served corpus. Raises ValueError for an unknown name."""
        return EnvConfig(configuration, self.corpus)

    def tasks(self, configuration: str, split: str) -> TaskSet:
        """Raises ValueError for unknown names, NoTasksError if there are no such tasks, CorpusError for bad data."""
        return self.settings(configuration).tasks(split)

    def shortest(self, configuration: str, task: Task) -> int | None:
        """The number of actions of a shortest solution; None if none is found, or without an expert."""
        with suppress(UnsupportedAppearance):
            return self.solver(configuration).solve(task).steps or None
        return None

    def sizes(self) -> dict[str, dict[str, int]]:
        """The number of tasks by configuration and split; empty ones are left out."""
        sizes: dict[str, dict[str, int]] = {}
        for configuration, split in product(CONFIGURATIONS, SPLITS):
            with suppress(NoTasksError):
                count = len(self.tasks(configuration, split))
                sizes.setdefault(configuration, {})[split] = count
        return sizes

    def appearances(self, *, needs_tasks: bool = True) -> dict[str, str]:
        """Texts of all appearances, by name; those without tasks, or without statements, say so."""
        played = {CONFIGURATIONS[name][0] for name in self.sizes()}
        if not needs_tasks:
            played = {tasks.provenance.appearance for tasks in load_all_tasks(self.corpus, needs_tasks=False)}
        return {name: name + ("" if name in played else NOT_PLAYED) for name in APPEARANCES}


async def get_services(request: Request) -> AppServices:  # async: FastAPI runs sync dependencies in the thread pool
    """FastAPI dependency: what the application's routes share."""
    return request.app.state.services


Services = Annotated[AppServices, Depends(get_services)]
