"""A server's options, the objects shared by all routes, and the FastAPI dependency that provides them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path
from typing import Annotated

from fastapi import Depends, Request

from lilgym_mp.contrib.web.database import Database
from lilgym_mp.contrib.web.live_games import LiveGames
from lilgym_mp.contrib.web.runs import Runs
from lilgym_mp.corpus import NoTasksError, TaskSet, load_all_tasks, load_tasks
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.evaluation import CONFIGURATIONS, Settings
from lilgym_mp.solver import Solver

LOOPBACK_HOSTS = ("127.0.0.1", "localhost", "::1")


@dataclass(frozen=True, slots=True)
class ServeOptions:
    """Corpus, data locations, access control and limits."""

    corpus: str = "builtin"
    database: Path = Path("lilgym-web.sqlite3")
    runs: Path | None = None  # directory with training runs and recorded episodes
    token: str | None = None  # needed for every page; None: no token is needed
    hosts: tuple[str, ...] | None = (*LOOPBACK_HOSTS, "testserver")  # accepted Host headers; None: any


class Catalogue:
    """Loads tasks, dynamics and solvers of the served corpus on first use.

    `dynamics(configuration)` and `solver(configuration)` raise ValueError for unknown names; the latter raises
    UnsupportedAppearance.
    """

    def __init__(self, corpus: str) -> None:
        """Raises CorpusError if there is no such corpus or it has no tasks."""
        self.corpus = corpus
        next(load_all_tasks(corpus))
        self.dynamics = cache(lambda configuration: Settings(configuration, corpus).dynamics())
        self.solver = cache(lambda configuration: Solver(self.dynamics(configuration)))

    def tasks(self, configuration: str, split: str) -> TaskSet:
        """Raises ValueError for unknown names, NoTasksError if there are no such tasks, CorpusError for bad data."""
        settings = Settings(configuration, self.corpus)
        return load_tasks(self.corpus, settings.appearance, settings.start, split)

    def sizes(self) -> dict[str, dict[str, int]]:
        """The number of tasks by configuration and split; empty ones are left out."""
        sizes: dict[str, dict[str, int]] = {}
        for configuration, split in product(CONFIGURATIONS, SPLITS):
            try:
                sizes.setdefault(configuration, {})[split] = len(self.tasks(configuration, split))
            except NoTasksError:
                continue
        return {configuration: splits for configuration, splits in sizes.items() if splits}


class AppServices:
    """Options, database and caches of one server."""

    def __init__(self, options: ServeOptions) -> None:
        """Raises DatabaseError for an unusable database, CorpusError if the corpus cannot be loaded."""
        self.options = options
        self.database = Database(options.database)
        self.catalogue = Catalogue(options.corpus)
        self.runs = Runs(options.runs)
        self.games = LiveGames()

    def close(self) -> None:
        self.runs.close()


async def get_services(request: Request) -> AppServices:  # async: FastAPI runs sync dependencies in the thread pool
    return request.app.state.services


Services = Annotated[AppServices, Depends(get_services)]
