"""/watch: what recorded agents did in each step, and what they went by."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Path, Query, Request, Response

from lilgym_mp.analysis.phenomena import Phenomenon
from lilgym_mp.appearances import InvalidReason
from lilgym_mp.evaluation.metrics import ENDS
from lilgym_mp.web import recording_views
from lilgym_mp.web.app_services import ServicesOf
from lilgym_mp.web.templating import page

router = APIRouter()
api = APIRouter(prefix="/api/watch", tags=["watch"])

RecordingId = Annotated[str, Path(pattern=r"^[0-9a-f]{16}$", description="as the list of recordings gives it")]
OutcomeName = Literal["success", "wrong_stop", "invalid_action", "horizon"]


@router.get("/watch", include_in_schema=False)
def watch_page(request: Request) -> Response:
    return page(
        request,
        "watch.html",
        outcomes=list(ENDS),
        invalid_reasons=[str(reason) for reason in InvalidReason],
        phenomena=[phenomenon.value for phenomenon in Phenomenon],
    )


@api.get("/recordings")
def recordings(services: ServicesOf) -> recording_views.RecordingsBody:
    """The recordings in the directory of runs, and the runs there whose agents can be recorded."""
    return recording_views.recordings_body(services.recordings)


@api.get("/recordings/{recording_id}")
def recording(recording_id: RecordingId, services: ServicesOf) -> recording_views.RecordingBody:
    """A recording: who played what, how it ended, and which other recordings are of the same tasks."""
    return recording_views.recording_body(services.recordings, recording_id)


@api.get("/recordings/{recording_id}/episodes")
def episodes(
    recording_id: RecordingId,
    services: ServicesOf,
    success: bool | None = None,
    outcome: OutcomeName | None = None,
    invalid_reason: InvalidReason | None = None,
    seen: Annotated[bool | None, Query(description="whether the statement is among the training tasks'")] = None,
    phenomenon: Annotated[str | None, Query(max_length=60)] = None,
    target: bool | None = None,
    task: Annotated[str | None, Query(max_length=200)] = None,
    text: Annotated[str, Query(max_length=200, description="in the statement or the task's id")] = "",
    offset: Annotated[int, Query(ge=0, le=10_000_000)] = 0,
) -> recording_views.EpisodesBody:
    """Episodes that pass the filters, at most 100 from `offset` on."""
    filters = recording_views.Filters(success, outcome, invalid_reason, seen, phenomenon, target, task, text)
    return recording_views.episodes_body(recording_views.opened(services.recordings, recording_id), filters, offset)


@api.get("/recordings/{recording_id}/episodes/{index}")
def episode(
    recording_id: RecordingId, index: Annotated[int, Path(ge=0, le=10_000_000)], services: ServicesOf
) -> recording_views.EpisodeBody:
    """An episode step by step: scenes, actions, legal places, and what the agent went by."""
    return recording_views.episode_body(recording_views.opened(services.recordings, recording_id), index)


router.include_router(api)
