"""A few hand-counted episodes and training runs, and one report on them as text."""

import tempfile
from dataclasses import replace
from pathlib import Path

from matplotlib.colors import to_hex

from lilgym_mp.contrib.report.items import Chart, Table
from lilgym_mp.contrib.report.report_data import load_report_data
from lilgym_mp.contrib.report.writing import chapters
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.episode_files import Header, write_episodes
from lilgym_mp.evaluation.episodes import Episode
from lilgym_mp.evaluation.files import SUFFIX
from lilgym_mp.evaluation.recording_metadata import METADATA_SUFFIX
from lilgym_mp.learning.common.run_directory import EVALUATIONS_FILE, begin_run
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import named

GOLDEN = Path(__file__).with_name("golden_report.md")
SCATTER = Settings("ScatterFlipIt")
ITEM = {"x_loc": 10, "y_loc": 10, "type": "circle", "color": "#0099ff", "size": 20}
BLUE = Scene.from_json([[ITEM], [], []])
HEADER = Header(
    package="0.1.0",
    settings=SCATTER,
    split="dev",
    agent="mine",
    supervision="rewards alone (corpus builtin); no mask",
    actions="greedy",
    mask=False,
    stop_forcing=False,
    seed=0,
    training_seed=0,
    passes=1,
    episodes=0,
    start_scenes=6,
    contexts=4,
    corpus="own",
    tasks_sha256="f" * 64,
    expert=True,
    run="runs/a",
)


def actions(*names):
    return tuple(map(named, names))


def episode(outcome, *names, **changes):
    last = 1.0 if outcome == "success" else -1.0
    made = Episode(
        task=f"task-{outcome}-{len(names)}",
        statement="There is a blue item.",
        program="exist(filter_color(all_items, Color.BLUE))",
        target=False,
        statement_seen=False,
        form_seen=False,
        tags=(),
        outcome=outcome,
        invalid_reason=None,
        actions=actions(*names),
        rewards=(*(-0.1,) * (len(names) - 1), last),
        start=BLUE,
        optimal_actions=2,
    )
    return replace(made, **changes)


# Two successes in six; one of them takes an edit more than necessary.
EPISODES = (
    episode("success", "REMOVE(0, 0)", "STOP", statement_seen=True, form_seen=True),
    episode("success", "ADD(0, 4, CIRCLE, BLUE, SMALL)", "REMOVE(0, 0)", "STOP", statement="No blue.", form_seen=True),
    episode("wrong_stop", "STOP", statement="B", target=True, actions_left=2, program="not exist(all_items)"),
    episode("wrong_stop", "REMOVE(0, 0)", "STOP", statement="B", actions_left=4, optimal_actions=5),
    episode("wrong_stop", "REMOVE(0, 0)", "STOP", statement="C", actions_left=5, optimal_actions=5),
    episode("invalid_action", "REMOVE(18, 4)", statement="C", target=True, invalid_reason="nothing_to_remove"),
)


def written(directory, episodes=EPISODES, **changes):
    """Writes a recording with HEADER, changed; returns its path."""
    directory.mkdir(parents=True, exist_ok=True)
    header = replace(HEADER, episodes=len(episodes), **changes)
    name = f"{header.agent} {header.settings.configuration} {header.split} {header.training_seed} {header.seed}{SUFFIX}"
    write_episodes(directory / name, header, episodes)
    return directory / name


def trained(directory, seed, points, configuration="TowerScratch", **recipe):
    """A PPO run with evaluations: accuracy on all tasks, on tasks with an image, and image accuracy."""
    identity = {
        "learner": "ppo",
        "environment": {"configuration": configuration, "corpus": "own"},
        "recipe": {"seed": seed, **recipe},
        "tasks_sha256": "e" * 64,
    }
    run = begin_run(directory, identity)
    for step in range(1, 3 + seed):
        run.record({"steps": 10 * step, "accuracy": 0.2 * (seed + step)})
    keys = ("steps", "accuracy", "accuracy_with_image", "image_accuracy")
    for index, point in enumerate(points):
        run.record(dict(zip(keys, (32 * index, *point), strict=True)), EVALUATIONS_FILE)


def write_example(directory):
    """Three runs of an agent, one of another, the expert on two configurations, training runs."""
    for seed, kept in enumerate((EPISODES, EPISODES[2:], EPISODES[:2])):
        recording = written(directory, kept, training_seed=seed)
        recording.with_name(recording.name.removesuffix(SUFFIX) + METADATA_SUFFIX).write_text('{"commit": "abc"}')
    # The target is "no blue item": STOP is wrong before the removal and right after it.
    joined, nested = "We see a box with a circle and a blue square.", "We see a box with a square on a triangle."
    solved = replace(EPISODES[0], statement=joined, stop_probabilities=(0.1, 0.9))
    failed = replace(EPISODES[2], statement=nested, stop_probabilities=(0.2,))
    kept = (failed, solved, solved, solved, failed)
    written(directory, kept, agent="sampler", actions="sampled", passes=2, run=str(directory / "ppo-0"))
    for configuration, kept in (("ScatterFlipIt", EPISODES[:2]), ("TowerScratch", EPISODES[2:3])):
        own = {"agent": "expert", "run": None, "training_seed": None, "supervision": "has the program"}
        written(directory, kept, settings=Settings(configuration), start_scenes=len(kept), **own)
    trained(directory / "ppo-0", 0, [(0, 0.1, 0), (0, 0.5, 0), (0, 0.9, 0)], mask=False)
    trained(directory / "ppo-1", 1, [(0, 0.3, 0), (0, 0.7, 0)], mask=False)
    trained(directory / "nlvr-0", 0, [(0, 0.2, 0), (0, 0.4, 0.25)], mask=False, nlvr_reward=True)


def report_text(directory):
    """Every table of the report on the recordings, and what its charts show."""
    items = [item for made in chapters(load_report_data([directory])).values() for item in made]
    return "\n".join(part for item in items for part in (*_described(item), ""))


def _described(item):
    if isinstance(item, Table):
        yield item.markdown()
        return
    yield f"**{item.item}. {item.title}**: {item.note}\n"
    if isinstance(item, Chart):
        if item.figure.legends:
            yield "- legend: " + ", ".join(text.get_text() for text in item.figure.legends[0].get_texts())
        texts = [text.get_text() for part in (item.figure, *item.figure.subfigs) for text in part.texts]
        yield from (f"- {line}" for text in texts for line in text.splitlines())
        for axes in item.figure.axes:
            drawn = [f"- {axes.get_title(loc='left')}", *(f"  - {part}" for part in _drawn(axes))]
            yield from drawn if len(drawn) > 1 or drawn[0] != "- " else ()


def _drawn(axes):
    """The bars by series, and the lines."""
    for bars in axes.containers:
        if hasattr(bars, "patches"):
            spans = [] if bars.errorbar is None else bars.errorbar.lines[2][0].get_segments()
            heights = ", ".join(f"{bar.get_x() + bar.get_width() / 2:.2f}: {bar.get_height():.2f}" for bar in bars)
            intervals = "".join(f" [{low:.2f}, {high:.2f}]" for (_, low), (_, high) in spans)
            yield f"bars {to_hex(bars.patches[0].get_facecolor())} {heights}{intervals}"
    for line in axes.lines:
        if line.get_linestyle() != "None" and len(line.get_xdata()):
            points = ", ".join(f"{x:.2f}: {y:.2f}" for x, y in line.get_xydata())
            yield f"line {to_hex(line.get_color())} {line.get_linestyle()} {points}"


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        write_example(Path(place))
        GOLDEN.write_text(report_text(Path(place)))
