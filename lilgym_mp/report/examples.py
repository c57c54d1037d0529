"""Pictures of real tasks: an example, trajectories, programs and failures, from the start scenes that were recorded."""

from __future__ import annotations

from collections.abc import Iterator

from lilgym_mp.actions import describe
from lilgym_mp.evaluation.episodes import RecordedEpisode, Recording
from lilgym_mp.evaluation.recording import scenes
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.render import draw
from lilgym_mp.report.behaviour import ERROR_KINDS, error_kind
from lilgym_mp.report.charts import Strip, strips
from lilgym_mp.report.items import Chart, Item, Lacking
from lilgym_mp.report.report_data import EXPERT, Entry, Gathered

MOST_FRAMES = 10  # of a failure that is shown
EXAMPLE_ACTIONS = 4  # of the first example, if one of that length is there


def pictures(found: Gathered) -> Iterator[Item]:
    """Figures 1, 2 and 7."""
    chosen = [
        (entry.runs[0], episode) for entry in _best_entries(found) if (episode := example(entry.runs[0])) is not None
    ]
    if not chosen:
        for item, title in (("Figure 1", "A task"), ("Figure 2", "Trajectories"), ("Figure 7", "Programs")):
            yield Lacking(item, title, "no episode here ends in success")
        return
    run, episode = max(chosen, key=lambda pair: len(pair[1].actions))
    yield Chart("Figure 1", "A task and a way to complete it", strips([film(run, episode)]), _who(run), raster=True)
    films = [film(run, episode) for run, episode in chosen]
    yield Chart("Figure 2", "Trajectories, one a configuration", strips(films), _who(chosen[0][0]), raster=True)
    programs = [_program(run, episode) for run, episode in chosen[:2]]
    note = "Before the first edit and after the last one: the program is false in one scene and true in the other."
    yield Chart("Figure 7", "Programs and what they are true of", strips(programs), note, raster=True)


def _who(run: Recording) -> str:
    return f"Played by {run.header.agent}, corpus {run.header.corpus}."


def _best_entries(found: Gathered) -> list[Entry]:
    """Of each configuration the expert's entry, else the first agent's."""
    entries = [found.find(EXPERT, name) or next(iter(found.of(name)), None) for name in found.configurations]
    return [entry for entry in entries if entry is not None]


def example(run: Recording) -> RecordedEpisode | None:
    """A success of about EXAMPLE_ACTIONS actions: the first of those nearest to it."""
    successes = [episode for episode in run.episodes if episode.is_success]
    return min(successes, key=lambda episode: abs(len(episode.actions) - EXAMPLE_ACTIONS), default=None)


def film(run: Recording, episode: RecordedEpisode, *extra: str) -> Strip:
    """The start and what each action made of it."""
    settings = run.header.settings
    wanted = "true" if episode.target else "false"
    ends = episode.outcome.replace("_", " ") + (
        f" ({episode.invalid_reason.replace('_', ' ')})" if episode.invalid_reason else ""
    )
    head = [
        f"“{episode.statement}”  Make it {wanted}.",
        f"{settings.configuration}, {run.header.split}, task {episode.task}: {ends}, reward {episode.reward:+.1f}",
        *extra,
    ]
    return Strip(head, _frames(settings, episode), episode.is_success)


def _frames(settings: Settings, episode: RecordedEpisode) -> list:
    seen = scenes(settings.dynamics(), episode.start, episode.actions)
    captions = ["start", *(f"{number}. {describe(action)}" for number, action in enumerate(episode.actions, start=1))]
    frames = [(draw(scene, "half"), caption) for scene, caption in zip(seen, captions, strict=True)]
    if len(frames) > MOST_FRAMES:
        left_out = len(frames) - MOST_FRAMES
        picture, caption = frames[-MOST_FRAMES // 2]
        half = MOST_FRAMES // 2
        frames = [*frames[:half], (picture, f"(… {left_out} left out) {caption}"), *frames[-half + 1 :]]
    return frames


def _program(run: Recording, episode: RecordedEpisode) -> Strip:
    settings = run.header.settings
    seen = scenes(settings.dynamics(), episode.start, episode.actions)
    words = {True: "true", False: "false"}
    frames = [
        (draw(seen[0], "half"), f"start: {words[not episode.target]}" if len(episode.actions) > 1 else "start"),
        (draw(seen[-1], "half"), f"at STOP: {words[episode.target]}"),
    ]
    return Strip([f"“{episode.statement}”", *_wrapped(episode.program.strip())], frames)


def _wrapped(text: str, width: int = 150) -> list[str]:
    return [text[first : first + width] for first in range(0, len(text), width)]


def failures(found: Gathered) -> Iterator[Item]:
    """An example of each kind of failure of each agent, in its hardest configuration."""
    for agent in found.agents:
        examples: dict[str, Strip] = {}
        for configuration in found.configurations:
            entry = found.find(agent, configuration)
            for run in entry.runs if entry is not None else ():
                for episode in run.episodes:
                    kind = error_kind(episode)
                    if kind is not None and kind not in examples:
                        examples[kind] = film(
                            run, episode, f"Kind of failure: {kind}. Look at it with: {_command(run, episode)}"
                        )
        shown = [examples[kind] for kind in ERROR_KINDS if kind in examples]
        if shown:
            yield Chart("Failures", f"An example of each kind of failure: {agent}", strips(shown), raster=True)


def _command(run: Recording, episode: RecordedEpisode) -> str:
    settings = run.header.settings
    place = f"{settings.configuration} --corpus {settings.corpus} --split {run.header.split}"
    return f"lilgym-mp play {place} --task {episode.task}"
