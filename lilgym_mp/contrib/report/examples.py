"""Film strips of recorded episodes: examples of successes and of failures."""

from __future__ import annotations

from collections.abc import Iterator
from textwrap import wrap

from lilgym_mp.contrib.report.behaviour import ERROR_KINDS, error_kind
from lilgym_mp.contrib.report.charts import FilmStrip, film_strips
from lilgym_mp.contrib.report.items import Chart, Item, MissingItem
from lilgym_mp.contrib.report.report_data import EXPERT, ReportData
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.episodes import Episode, Recording, scenes
from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.render import draw

MAX_FRAMES = 10  # frames of a film strip
EXAMPLE_LENGTH = 4  # preferred number of actions of an example


def tasks_and_programs(data: ReportData) -> Iterator[Item]:
    """The trajectory of a success in each configuration."""
    entries = [data.find(EXPERT, name) or data.of(name)[0] for name in data.configurations if data.of(name)]
    chosen = [(e.runs[0], episode) for e in entries if (episode := example_episode(e.runs[0])) is not None]
    item, title = "Figure 1, Figure 2 and Figure 7", "Tasks, trajectories and programs, one per configuration"
    if not chosen:
        yield MissingItem(item, title, "no recorded episode succeeds")
        return
    films = [film_strip(run, episode, *wrap(episode.program, 150, break_on_hyphens=False)) for run, episode in chosen]
    players = dict.fromkeys(run.header.agent for run, _ in chosen)
    note = f"Played by {', '.join(players)}, corpus {data.header.corpus}."
    yield Chart(item, title, film_strips(films), note, raster=True)


def example_episode(run: Recording) -> Episode | None:
    """The first success whose number of actions is closest to EXAMPLE_LENGTH; None without successes."""
    successes = [episode for episode in run.episodes if episode.is_success]
    return min(successes, key=lambda episode: abs(len(episode.actions) - EXAMPLE_LENGTH), default=None)


def film_strip(run: Recording, episode: Episode, *extra: str) -> FilmStrip:
    """The start scene and the scene after each action; `extra`: further lines above the frames."""
    settings = run.header.settings
    reason = f" ({episode.invalid_reason})" if episode.invalid_reason else ""
    outcome = f"{episode.outcome}{reason}".replace("_", " ")
    head = [
        f"“{episode.statement}”  Make it {str(episode.target).lower()}.",
        f"{settings.configuration}, {run.header.split}, task {episode.task}: {outcome}, reward {episode.reward:+.1f}",
        *extra,
    ]
    return FilmStrip(head, _frames(settings, episode), episode.is_success)


def _frames(settings: Settings, episode: Episode) -> list:
    visited = scenes(settings.dynamics(), episode.start, episode.actions)
    captions = ["start", *(f"{step}. {describe(action)}" for step, action in enumerate(episode.actions, start=1))]
    frames = [(draw(scene, "half"), caption) for scene, caption in zip(visited, captions, strict=True)]
    if len(frames) > MAX_FRAMES:
        omitted = len(frames) - MAX_FRAMES
        half = MAX_FRAMES // 2
        image, caption = frames[-half]
        frames = [*frames[:half], (image, f"(… {omitted} omitted) {caption}"), *frames[-half + 1 :]]
    return frames


def failures(data: ReportData) -> Iterator[Item]:
    """For each agent, the first recorded example of each kind of error."""
    for agent in data.agents:
        examples: dict[str, FilmStrip] = {}
        runs = [run for entry in data.main_results if entry.agent == agent for run in entry.runs]
        for run, episode in [(each, episode) for each in runs for episode in each.episodes]:
            kind = error_kind(episode)
            if kind is not None and kind not in examples:
                settings = run.header.settings
                task = f"--corpus {settings.corpus} --split {run.header.split} --task {episode.task}"
                command = f"lilgym-mp play {settings.configuration} {task}"
                hint = f"Kind of error: {kind}. Open the task with: {command}"
                examples[kind] = film_strip(run, episode, hint)
        shown = [examples[kind] for kind in ERROR_KINDS if kind in examples]
        if shown:
            yield Chart("Failures", f"An example of each kind of error: {agent}", film_strips(shown), raster=True)
