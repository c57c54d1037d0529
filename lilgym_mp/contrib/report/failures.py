"""Film strips of recorded failures."""

from __future__ import annotations

from collections.abc import Iterator

from lilgym_mp.contrib.report.behaviour import ERROR_KINDS, error_kind
from lilgym_mp.contrib.report.charts import FilmStrip, film_strips
from lilgym_mp.contrib.report.items import Chart, Item
from lilgym_mp.contrib.report.report_data import ReportData
from lilgym_mp.evaluation.episodes import Episode, Recording, scenes
from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.render import draw


def failures(data: ReportData) -> Iterator[Item]:
    """For each agent, the first recorded example of each kind of error."""
    for agent in data.agents:
        examples: dict[str, FilmStrip] = {}
        runs = [run for entry in data.main_results if entry.agent == agent for run in entry.runs]
        for run, episode in [(each, episode) for each in runs for episode in each.episodes]:
            kind = error_kind(episode)
            if kind is not None and kind not in examples:
                examples[kind] = film_strip(run, episode, kind)
        shown = [examples[kind] for kind in ERROR_KINDS if kind in examples]
        if shown:
            yield Chart("Failures", f"An example of each kind of error: {agent}", film_strips(shown), raster=True)


def film_strip(run: Recording, episode: Episode, kind: str) -> FilmStrip:
    """The start scene and the scene after each action, with the command that opens the task."""
    settings = run.header.settings
    reason = f" ({episode.invalid_reason})" if episode.invalid_reason else ""
    outcome = f"{episode.outcome}{reason}".replace("_", " ")
    task = f"--corpus {settings.corpus} --split {run.header.split} --task {episode.task}"
    head = [
        f"“{episode.statement}”  Make it {str(episode.target).lower()}.",
        f"{settings.configuration}, {run.header.split}, task {episode.task}: {outcome}, reward {episode.reward:+.1f}",
        f"Kind of error: {kind}. Open the task with: lilgym-mp play {settings.configuration} {task}",
    ]
    visited = scenes(settings.dynamics(), episode.start, episode.actions)
    captions = ["start", *(f"{step}. {describe(action)}" for step, action in enumerate(episode.actions, start=1))]
    return FilmStrip(head, [(draw(scene, "half"), text) for scene, text in zip(visited, captions, strict=True)])
