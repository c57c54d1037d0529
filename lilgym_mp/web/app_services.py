"""What routes share: the options, the database, and what is expensive to make."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Request

from lilgym_mp.web.authentication import Logins
from lilgym_mp.web.catalogue import Catalogue
from lilgym_mp.web.corpus_statements import Outcomes
from lilgym_mp.web.live_games import Games
from lilgym_mp.web.program_evaluator import Evaluator
from lilgym_mp.web.run_directory import Recordings
from lilgym_mp.web.serve_options import ServeOptions
from lilgym_mp.web.store import Database
from lilgym_mp.web.trained_partners import TrainedPartners


class Services:
    """Everything that lives as long as the server."""

    def __init__(self, options: ServeOptions, database: Database) -> None:
        """Raises CorpusError where the corpus cannot be used."""
        self.options = options
        self.database = database
        self.logins = Logins(database)
        self.catalogue = Catalogue(options.corpus)
        self.recordings = Recordings(options.runs)
        self.outcomes = Outcomes(self.recordings)
        self.evaluator = Evaluator(options.program_processes, options.program_seconds)
        self.trained_partners = TrainedPartners(self.recordings)
        self.games = Games()

    def close(self) -> None:
        self.evaluator.close()
        self.database.close()


async def services(request: Request) -> Services:  # were it not async, it would wait for a thread
    return request.app.state.services


ServicesOf = Annotated[Services, Depends(services)]
