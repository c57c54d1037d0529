"""Objects shared by all routes, and the FastAPI dependency that provides them."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Request

from lilgym_mp.web.catalogue import Catalogue
from lilgym_mp.web.live_games import LiveGames
from lilgym_mp.web.program_evaluator import ProgramEvaluator
from lilgym_mp.web.run_directory import RunDirectory
from lilgym_mp.web.serve_options import ServeOptions
from lilgym_mp.web.store import Database
from lilgym_mp.web.trained_partners import TrainedPartners


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
