"""/beat: ten tasks that a person and a trained agent both play, their score, and a picture of it to share."""

from __future__ import annotations

import io
from collections.abc import Sequence
from functools import lru_cache
from random import Random
from typing import Annotated, NamedTuple

from fastapi import APIRouter, HTTPException, Query, Request, Response

from lilgym_mp.contrib.web.app_services import AppServices, Services
from lilgym_mp.contrib.web.bodies import JSON, ConfigurationName, RandomId, SplitName
from lilgym_mp.contrib.web.responses import render_page
from lilgym_mp.contrib.web.routes.play import LoadedEpisode, load_episode
from lilgym_mp.contrib.web.runs import PARSER, FoundFile
from lilgym_mp.corpus.matching import well_spelt_ids
from lilgym_mp.evaluation import evaluate
from lilgym_mp.evaluation.film import ScoreLine, score_picture
from lilgym_mp.scene import Scene

router = APIRouter()
api = APIRouter(prefix="/api/beat", tags=["beat"])

TASKS = 10
Episodes = Annotated[list[RandomId], Query(min_length=1, max_length=TASKS)]
Opponent = Annotated[str, Query(max_length=100, description="an included agent, or one of `--runs`")]


class Row(NamedTuple):
    """A task, and how many actions each took to solve it; None: not solved."""

    statement: str
    target: bool
    scene: Scene  # in which the person stopped
    you: int | None
    agent: int | None
    shortest: int | None


@router.get("/beat", include_in_schema=False)
def beat_page(request: Request, services: Services) -> Response:
    """The page on which a person plays against an agent."""
    agents = {name: title for name, title in services.runs.agents().items() if services.runs.plays(name)}
    return render_page(request, "beat.html", sizes=services.sizes(), agents=agents, agent=PARSER)


@api.get("/tasks")
def tasks(
    services: Services,
    configuration: ConfigurationName = "TowerFlipIt",
    split: SplitName = "dev",
    seed: Annotated[int, Query(ge=0, le=10**9)] = 0,
) -> JSON:
    """The ids of ten tasks; the same ones for the same arguments."""
    ids = well_spelt_ids(services.tasks(configuration, split))
    return {"tasks": Random(seed).sample(ids, min(TASKS, len(ids)))}


@api.get("/round")
def score(services: Services, episode: Episodes, agent: Opponent = PARSER) -> JSON:
    """The score of the episodes that are over. Responds with 422 if the agent does not play them."""
    rows = _rows(services, episode, agent)
    verdict, summary = _told(rows, _name(services, agent))
    shown = [{name: value for name, value in row._asdict().items() if name != "scene"} for row in rows]
    return {"rows": shown, "verdict": verdict, "summary": summary}


@api.get("/picture", response_class=Response)
def picture(services: Services, episode: Episodes, agent: Opponent = PARSER) -> Response:
    """The same as a PNG image. Responds with 409 before an episode is over."""
    rows = _rows(services, episode, agent)
    name = _name(services, agent)
    if not rows:
        raise HTTPException(409, "no episode is over yet")
    title = load_episode(services, episode[0]).row.configuration
    verdict, summary = _told(rows, name, "Player")
    lines = [
        ScoreLine(f"Make it {str(row.target).lower()}: {row.statement}", row.scene, (row.you, row.agent, row.shortest))
        for row in rows
    ]
    buffer = io.BytesIO()
    score_picture([f"{title}: {verdict}", summary], ["player", name, "shortest"], lines).save(buffer, "PNG")
    return Response(buffer.getvalue(), media_type="image/png")


def _name(services: AppServices, agent: str) -> str:
    """The opponent's name, as shown."""
    return services.runs.agents().get(agent, agent).partition(" (")[0]


def _rows(services: AppServices, ids: Sequence[str], agent: str) -> list[Row]:
    loaded = [load_episode(services, each) for each in ids]
    return [_row(services, each, agent) for each in loaded if each.over]


def _row(services: AppServices, loaded: LoadedEpisode, agent: str) -> Row:
    row = loaded.row
    task = loaded.task
    solved = row.outcome == "success" and not row.shown_solution
    file = services.runs.file_of(agent)
    others = _others(services, agent, file, row.configuration, row.split, task.id)
    return Row(task.statement, task.target, loaded.state.scene, len(row.actions) if solved else None, *others)


@lru_cache(1_000)
def _others(
    services: AppServices, agent: str, file: FoundFile | None, configuration: str, split: str, task_id: str
) -> tuple[int | None, int | None]:
    """The actions with which the agent, of this file, solves a task, and of a shortest solution."""
    solved = None
    if agent != PARSER or agent in services.runs.agents():
        settings = services.settings(configuration)
        opponent = services.runs.agent(agent)
        plays = opponent.description.configurations
        if configuration not in plays:
            raise HTTPException(422, f"this agent plays {', '.join(plays)}, not {configuration}; choose another")
        (played,) = evaluate(opponent.policy(settings), settings, split, task_ids=[task_id])
        solved = len(played.actions) if played.is_success else None
    return solved, services.shortest(configuration, services.tasks(configuration, split).by_id(task_id))


def _told(rows: Sequence[Row], agent: str, player: str = "You") -> tuple[str, str]:
    """Who won, by tasks solved and then by actions taken for them, and the numbers."""
    own = [row.you for row in rows if row.you is not None]
    agents = [row.agent for row in rows if row.agent is not None]
    mine = (len(own), -sum(own))
    other = (len(agents), -sum(agents))
    verdict = "A draw." if mine == other else f"{player if mine > other else agent} won."
    theirs = f"{agent} {len(agents)} in {sum(agents)}"
    shortest = f"The shortest solutions of all take {sum(row.shortest or 0 for row in rows)}."
    return verdict, f"{player} solved {len(own)} of {len(rows)} in {sum(own)} actions, {theirs}. {shortest}"
