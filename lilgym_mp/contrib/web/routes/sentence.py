"""/sentence: type a sentence, see how the shipped parser reads it, and watch the plan that makes it true or false."""

from __future__ import annotations

from threading import Lock
from typing import Annotated

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, StringConstraints

from lilgym_mp.contrib.web.app_services import Services
from lilgym_mp.contrib.web.bodies import JSON, AppearanceName, Name, scene_body, steps_body
from lilgym_mp.contrib.web.responses import in_turn, refusing, render_page
from lilgym_mp.contrib.web.runs import PARSER
from lilgym_mp.corpus.records import SCRATCH
from lilgym_mp.envs.registration import configuration_name, read_configuration
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import STOP
from lilgym_mp.scene.appearances import APPEARANCES

router = APIRouter()
api = APIRouter(prefix="/api/sentence", tags=["sentence"])

EXAMPLES = (
    "There is a blue block.",
    "There are exactly two towers.",
    "The middle tower has a black block on top.",
    "There is no yellow block in the left box.",
    "There are two black items and a blue one.",
    "All towers have a yellow block at the base.",
    "One box is empty.",
)
PLANNING_SECONDS = 20  # a request waits this long for those of others
_PLANNING = Lock()  # one sentence at a time, so that planning occupies one core


class NewSentence(BaseModel):
    """Request to read a visitor's sentence and plan for it."""

    sentence: Annotated[Name, StringConstraints(strip_whitespace=True, min_length=1)]
    appearance: AppearanceName = "tower"
    target: bool = True


@router.get("/sentence", include_in_schema=False)
def sentence_page(request: Request, services: Services) -> Response:
    """The page on which visitors enter sentences of their own."""
    read = {read_configuration(name)[0] for name in services.runs.plays(PARSER)}
    appearances = {name: name + ("" if name in read else ": not in what the agent reads") for name in APPEARANCES}
    return render_page(request, "sentence.html", appearances=appearances, examples=EXAMPLES)


@api.post("")
def read(new: NewSentence, services: Services) -> JSON:
    """The readings with their probabilities, notes on words and doubts, and a short plan from the empty scene.

    A sentence without a known word that means something has no readings.

    Responds with 404 or 422 if the agent cannot plan here, 503 if others keep it busy.
    """
    from lilgym_mp.learning.parsing.agent import ParseAndPlanAgent

    agent = services.runs.agent(PARSER)
    assert isinstance(agent, ParseAndPlanAgent)
    configuration = configuration_name(new.appearance, SCRATCH)
    start = Scene.empty()
    with in_turn(_PLANNING, PLANNING_SECONDS, "many sentences are being read"), refusing():
        plan = agent.planner(services.settings(configuration)).short_plan(start, new.sentence, new.target)
    understood = plan.parse.is_understood
    satisfied = {plan.goals[index].program for index in plan.satisfied}
    return {
        "readings": [
            {"program": program, "probability": probability, "satisfied": program in satisfied}
            for program, probability in plan.probabilities().items()
            if understood
        ],
        "notes": [*plan.parse.notes(), *(f"Unsure: {doubt}." for doubt in plan.parse.doubts if understood)],
        "uncertain": list(plan.parse.uncertain),
        "understood": understood,
        "start": scene_body(start),
        "steps": steps_body(services.dynamics(configuration), start, plan.actions if understood else (STOP,)),
        "success_probability": plan.success_probability,
    }
