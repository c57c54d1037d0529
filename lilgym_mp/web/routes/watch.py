"""/watch: recorded episodes step by step, with the agents' predictions."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Request, Response

from lilgym_mp.analysis.phenomena import Phenomenon
from lilgym_mp.appearances import InvalidReason
from lilgym_mp.evaluation.metrics import FINAL_OUTCOMES
from lilgym_mp.web import recording_views
from lilgym_mp.web.app_services import Services
from lilgym_mp.web.field_types import OutcomeName
from lilgym_mp.web.scene_images import png
from lilgym_mp.web.templating import render_page

router = APIRouter()
api = APIRouter(prefix="/api/watch", tags=["watch"])

RecordingId = Annotated[str, Path(pattern=r"^[0-9a-f]{16}$", description="as returned by the list of recordings")]


@router.get("/watch", include_in_schema=False)
def watch_page(request: Request) -> Response:
    return render_page(
        request,
        "watch.html",
        outcomes=list(FINAL_OUTCOMES),
        invalid_reasons=[str(reason) for reason in InvalidReason],
        phenomena=[phenomenon.value for phenomenon in Phenomenon],
    )


@api.get("/recordings")
def recordings(services: Services) -> recording_views.RecordingsBody:
    """The recordings in the runs directory, and its runs whose agents can be recorded."""
    return recording_views.recordings_body(services.run_directory)


@api.get("/recordings/{recording_id}")
def recording(recording_id: RecordingId, services: Services) -> recording_views.RecordingBody:
    """A recording: agent, settings, outcome counts, and other recordings of the same tasks."""
    return recording_views.recording_body(services.run_directory, recording_id)


@api.get("/recordings/{recording_id}/episodes")
def episodes(
    recording_id: RecordingId,
    services: Services,
    success: bool | None = None,
    outcome: OutcomeName | None = None,
    invalid_reason: InvalidReason | None = None,
    seen: Annotated[bool | None, Query(description="whether the statement occurs in the training tasks")] = None,
    phenomenon: Annotated[str | None, Query(max_length=60)] = None,
    target: bool | None = None,
    task: Annotated[str | None, Query(max_length=200)] = None,
    text: Annotated[str, Query(max_length=200, description="contained in the statement or the task's id")] = "",
    offset: Annotated[int, Query(ge=0, le=10_000_000)] = 0,
) -> recording_views.EpisodesBody:
    """Episodes that match the filters: at most 100, starting at `offset`."""
    filters = recording_views.EpisodeFilters(success, outcome, invalid_reason, seen, phenomenon, target, task, text)
    recording = recording_views.read_recording(services.run_directory, recording_id)
    return recording_views.episodes_body(recording, filters, offset)


@api.get("/recordings/{recording_id}/episodes/{index}")
def episode(
    recording_id: RecordingId, index: Annotated[int, Path(ge=0, le=10_000_000)], services: Services
) -> recording_views.EpisodeBody:
    """An episode step by step: scenes, actions, legal cells, and the agent's predictions."""
    return recording_views.episode_body(recording_views.read_recording(services.run_directory, recording_id), index)


@api.get("/recordings/{recording_id}/episodes/{index}/picture", response_class=Response)
def picture(
    recording_id: RecordingId, index: Annotated[int, Path(ge=0, le=10_000_000)], services: Services
) -> Response:
    """The start scene of an episode, as a PNG image."""
    recording = recording_views.read_recording(services.run_directory, recording_id)
    return Response(png(recording_views.find_episode(recording, index).start), media_type="image/png")


router.include_router(api)
