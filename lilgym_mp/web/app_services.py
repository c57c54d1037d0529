"""A server's options, the objects shared by all routes, and the FastAPI dependency that provides them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from fastapi import Depends, Request

from lilgym_mp.web.catalogue import Catalogue
from lilgym_mp.web.live_games import LiveGames
from lilgym_mp.web.program_evaluator import ProgramEvaluator
from lilgym_mp.web.run_directory import RunDirectory
from lilgym_mp.web.store import Database
from lilgym_mp.web.trained_partners import TrainedPartners

LOOPBACK_HOSTS = ("127.0.0.1", "localhost", "::1")


@dataclass(frozen=True, slots=True)
class ServeOptions:
    """Corpus, data locations, access control and limits."""

    corpus: str = "builtin"
    database: str = "sqlite:///lilgym-web.sqlite3"  # SQLAlchemy URL
    runs: Path | None = None  # directory with training runs and recorded episodes
    requires_tokens: bool = False  # every page needs a login; true beyond loopback
    hosts: tuple[str, ...] | None = (*LOOPBACK_HOSTS, "testserver")  # accepted Host headers; None: any
    requests_per_second: float | None = 40.0  # sustained rate limit per visitor; None: unlimited
    program_seconds: float = 5.0  # time limit for evaluating one program
    program_processes: int = 2  # worker processes that evaluate programs


def database_url(location: str) -> str:
    """`location` itself if it is a URL, else the URL of the SQLite file at that path."""
    return location if "://" in location else f"sqlite:///{location}"


class AppServices:
    """Options, database, caches and worker processes of one server."""

    def __init__(self, options: ServeOptions, database: Database) -> None:
        """Raises CorpusError if the corpus cannot be loaded."""
        self.options = options
        self.database = database
        self.catalogue = Catalogue(options.corpus)
        self.run_directory = RunDirectory(options.runs)
        self.evaluator = ProgramEvaluator(options.program_processes, options.program_seconds)
        self.trained_partners = TrainedPartners(self.run_directory)
        self.games = LiveGames()

    def close(self) -> None:
        self.evaluator.close()
        self.database.close()


async def get_services(request: Request) -> AppServices:  # async: FastAPI runs sync dependencies in the thread pool
    return request.app.state.services


Services = Annotated[AppServices, Depends(get_services)]
