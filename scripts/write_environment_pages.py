"""Writes docs/environments/*.md from the code, a page for each configuration."""

from __future__ import annotations

import argparse
import inspect
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

import lilgym_mp
from lilgym_mp.actions import BOX_NAMES, describe
from lilgym_mp.appearances import Appearance, InvalidReason, Scatter, Tower
from lilgym_mp.corpus import load_tasks
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.envs.batched import BatchedEnv
from lilgym_mp.envs.engine import Settings as BatchSettings
from lilgym_mp.envs.single import LilGymEnv
from lilgym_mp.evaluation.settings import CONFIGURATIONS, Settings
from lilgym_mp.rules import RULE_SETS, Outcome, make_dynamics
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, SIZE_PIXELS, Item, Scene, Size

TARGET = Path(__file__).resolve().parent.parent / "docs" / "environments"
FILE_NAMES = {name: f"{appearance}_{start}.md" for name, (appearance, start) in CONFIGURATIONS.items()}

ABOUT = {
    ("tower", "scratch"): "Build towers in three empty boxes until the statement is true, then STOP.",
    ("tower", "flipit"): "Change the towers of a start scene until the statement's truth has flipped, then STOP.",
    ("scatter", "scratch"): "Put items anywhere into three empty boxes until the statement is true, then STOP.",
    ("scatter", "flipit"): "Add and remove items of a start scene until the statement's truth has flipped, then STOP.",
}
STARTS = {
    "scratch": "Every episode starts from three empty boxes, and the target is always `True`.",
    "flipit": "Every episode starts from a scene of the corpus, and the target is the opposite of the statement's "
    "truth there: `False` where it is true, `True` where it is false. So no start is solved by STOP.",
}
PARTS = {
    "image": "the scene",
    "statement": "what is to become true or false, in words",
    "target": "1: make the statement true; 0: make it false",
}
KEYWORDS = {
    "corpus": '`"builtin"`; `"lilgym"`, the official data ([how to get it](../official_data.md)); or the path of '
    "[a corpus](../corpus.md)",
    "split": '`"train"`, `"dev"` or `"test"`: the tasks to draw from',
    "rules": '`"paper"` or `"release"` ([where they differ](../fidelity.md))',
    "horizon": "actions an episode; `None`: the rule set's",
    "grid": 'Scatter\'s columns and rows, or `"native"`: a cell for each pixel; without effect in Tower',
    "image_size": '`"half"` or `"native"`',
    "render_mode": '`"human"` (a window; the extra `human`), `"rgb_array"` or `"ansi"`; `None`: no pictures for people',
    "observation": '`"text"`, or `"arrays"` for learners that take no texts (Stable-Baselines3)',
    "render_cells": "pictures for people show cells with column and row numbers; in Tower names of boxes",
    "num_envs": "how many environments",
    "copy": "`False`: images are valid until the next call only, which saves copying them",
    "autoreset_mode": "Gymnasium's `NEXT_STEP`, `SAME_STEP` or `DISABLED`",
    "evaluation": "`True`: every task of the split once, in file order, instead of at random",
}
GIVEN = ("self", "appearance", "start", "settings")  # fixed by the id, or no keyword
OUTCOMES = {
    Outcome.SUCCESS: "STOP where the statement has the target value",
    Outcome.WRONG_STOP: "STOP where it has not",
    Outcome.INVALID_ACTION: "an illegal action; the scene stays as it was",
    Outcome.HORIZON: "the last action that the horizon allows, legal and not STOP",
    Outcome.CONTINUES: "any other legal action; the episode goes on",
}
REASONS = {
    InvalidReason.SEPARATOR: "the cell lies on a separator between boxes",
    InvalidReason.OVERLAP: "the new item finds no free place in the cell",
    InvalidReason.OUT_OF_BOX: "the new item would reach over the box's right or lower wall",
    InvalidReason.NOTHING_TO_REMOVE: "nothing overlaps the cell",
    InvalidReason.FULL_TOWER: "ADD to a tower of four blocks",
    InvalidReason.EMPTY_TOWER: "REMOVE from a box without blocks",
}
REASONS_OF = {
    "tower": (InvalidReason.FULL_TOWER, InvalidReason.EMPTY_TOWER),
    "scatter": (
        InvalidReason.SEPARATOR,
        InvalidReason.OVERLAP,
        InvalidReason.OUT_OF_BOX,
        InvalidReason.NOTHING_TO_REMOVE,
    ),
}


def page(configuration: str) -> str:
    """The page of a configuration, in Markdown."""
    settings = Settings(configuration)
    sections = (_opening, _tasks, _observations, _actions, _rewards, _infos, _keywords, _versions)
    return "\n\n".join(part for section in sections for part in section(settings)) + "\n"


def index() -> str:
    """The page that lists the others."""
    rows = [
        (
            f"[{name}]({FILE_NAMES[name]})",
            ABOUT[CONFIGURATIONS[name]],
            f"{Settings(name).dynamics().appearance.action_count:,}",
        )
        for name in CONFIGURATIONS
    ]
    films = "\n\n".join(f"**[{name}]({FILE_NAMES[name]})**\n\n{_film(name)}" for name in CONFIGURATIONS)
    return (
        "\n\n".join(
            [
                "# The environments",
                "Four configurations: two appearances of scenes, two ways to start. The films show the agent "
                "`parse-and-plan`, which comes with the package, on tasks that it was not trained on.",
                _table(("configuration", "what is to be done", "actions"), rows),
                films,
                "Two agents can share any of them: [a proposer and a verifier](../proposer_verifier.md). These pages "
                "are written by `scripts/write_environment_pages.py` from the code.",
            ]
        )
        + "\n"
    )


def _film(configuration: str) -> str:
    return f"![An episode of {configuration}](../pictures/{configuration}.gif)"


def _opening(settings: Settings) -> Iterator[str]:
    name = settings.configuration
    yield f"# {name}"
    yield ABOUT[settings.appearance, settings.start]
    yield _film(name)
    yield f'```python\nimport gymnasium as gym\nimport lilgym_mp\n\nenv = gym.make("{settings.id}")\n```'
    yield f"![The first scene of the film with names of places](../pictures/{name}.png)"
    yield 'The second picture is what `render_mode="rgb_array", render_cells=True` gives.'


def _tasks(settings: Settings) -> Iterator[str]:
    yield "## Tasks"
    counts = [len(load_tasks("builtin", settings.appearance, settings.start, split)) for split in SPLITS]
    told = ", ".join(f"{count:,} in {split}" for split, count in zip(SPLITS, counts, strict=True))
    yield f"{STARTS[settings.start]} The builtin corpus has {told}."


def _observations(settings: Settings) -> Iterator[str]:
    yield "## Observations"
    text, arrays = (_space(settings, observation=form) for form in ("text", "arrays"))
    native = _space(settings, image_size="native")["image"]
    yield _table(
        ("key", "what", '`observation="text"` (default)', '`observation="arrays"`'),
        [(f"`{key}`", PARTS[key], _kind(text[key]), _kind(arrays[key])) for key in text],
    )
    yield (
        f'Images are red, green and blue, {_kind(native)} with `image_size="native"`. The token ids of `"arrays"` '
        "are those of the corpus's train split, padded with 0."
    )


def _space(settings: Settings, **keywords: Any) -> spaces.Dict:
    space = gym.make(settings.id, **keywords).observation_space
    assert isinstance(space, spaces.Dict)
    return space


def _kind(space: spaces.Space[Any]) -> str:
    if isinstance(space, spaces.Text):
        return "a text"
    if isinstance(space, spaces.Discrete):
        return f"int, 0 .. {space.n - 1}"
    assert isinstance(space, spaces.Box)
    low, high = np.min(space.low), np.max(space.high)
    return f"{space.dtype} {space.shape}, {low} .. {high}"


def _actions(settings: Settings) -> Iterator[str]:
    appearance = settings.dynamics().appearance
    yield "## Actions"
    yield (
        f"`Discrete({appearance.action_count})`. `env.unwrapped.encode_action(array)` gives the number of an action in "
        "the array form, `decode_action(number)` the reverse; `lilgym_mp.action_masks(env)` says which are legal now."
    )
    yield from _scatter_actions(appearance) if isinstance(appearance, Scatter) else _tower_actions(appearance)


def _action_rows(appearance: Appearance, numbers: Iterable[int]) -> list[Sequence[object]]:
    actions = [(number, appearance.decode(number)) for number in numbers]
    return [(number, f"`{describe(action)}`", f"`{appearance.to_array(action)}`") for number, action in actions]


def _tower_actions(appearance: Appearance) -> Iterator[str]:
    header = ("number", "action", "array form [type, box, colour]")
    yield _table(header, _action_rows(appearance, range(appearance.action_count)))
    yield (
        "ADD puts a block on top of a box's tower, REMOVE takes the top block away. Where the blocks are, in pixels of "
        "the native image, 380 x 100:"
    )
    blocks = _full_tower()
    x, side = blocks[0].x, blocks[0].side
    yield _table(
        ("box", "its pixels", "its blocks"),
        [
            (name, f"x {left} .. {left + BOX_SIDE - 1}", f"x {left + x} .. {left + x + side - 1}")
            for name, left in zip(BOX_NAMES, range(0, BOX_COUNT * BOX_PITCH, BOX_PITCH), strict=True)
        ],
    )
    tops = ", ".join(str(block.y) for block in blocks)
    yield f"Blocks are {side} pixels wide and high; from below, their top edges are at y = {tops}."


def _full_tower() -> Sequence[Item]:
    """The blocks of a full tower, from below, as the rules put them."""
    dynamics, scene = make_dynamics(Tower()), Scene.empty()
    for _ in range(Tower().box_capacity):
        scene = dynamics.appearance.apply(scene, dynamics.appearance.decode(1), dynamics.rules.placement).scene
    return scene.boxes[0].items


def _scatter_actions(appearance: Scatter) -> Iterator[str]:
    columns, rows = appearance.grid
    width, height = appearance.cell
    cells = columns * rows
    looks = (appearance.action_count - 1) // cells - 1
    first_remove = 1 + cells * looks
    yield _table(
        ("number", "action", "array form [type, x, y, shape, colour, size]"),
        _action_rows(
            appearance,
            (
                0,
                1,
                2,
                4,
                10,
                looks,
                looks + 1,
                first_remove - 1,
                first_remove,
                first_remove + 1,
                first_remove + cells - 1,
            ),
        ),
    )
    sizes = ", ".join(str(SIZE_PIXELS[size]) for size in Size)
    yield (
        f"Cell (column, row) has the number `cell = {rows} * column + row`; `look = 9 * shape + 3 * colour + size`. "
        f"ADD is `1 + {looks} * cell + look`, REMOVE `{first_remove} + cell`. shape: 0 circle, 1 square, 2 triangle; "
        f"colour: 0 yellow, 1 black, 2 blue; size: 0 small, 1 medium, 2 large ({sizes} pixels)."
    )
    yield f"Cells are {width} x {height} pixels of the native image, 380 x 100, and lie so:"
    yield _table(("columns", "where", "pixels"), _column_rows(width))
    yield (
        f"Row r covers y = {height} r .. {height} r + {height - 1}, counted downwards. ADD puts the item's upper left "
        "corner at the cell's, or, where that is taken, at a free pixel of the cell; then the item snaps to a "
        "neighbour up to 4 pixels away. REMOVE takes the item that fills the cell most. Other grids: "
        "`grid=(columns, rows)`."
    )


def _column_rows(width: int) -> Iterator[Sequence[object]]:
    side, gap = BOX_SIDE // width, (BOX_PITCH - BOX_SIDE) // width
    for box, name in enumerate(BOX_NAMES):
        first = box * (side + gap)
        left = box * BOX_PITCH
        yield f"{first} .. {first + side - 1}", f"{name} box", f"x {left} .. {left + BOX_SIDE - 1}"
        if box + 1 < BOX_COUNT:
            between = f"x {left + BOX_SIDE} .. {left + BOX_PITCH - 1}"
            yield f"{first + side} .. {first + side + gap - 1}", "a separator: every action is illegal", between


def _rewards(settings: Settings) -> Iterator[str]:
    yield "## Rewards and ends"
    rows: list[Sequence[object]] = []
    for outcome, when in OUTCOMES.items():
        signals = [rules.signals[outcome] for rules in RULE_SETS.values()]
        rows.append((f"`{outcome}`", when, *(_signal(*signal) for signal in signals)))
    horizons = " or ".join(f"{rules.horizon} under `{rules.name}`" for rules in RULE_SETS.values())
    yield _table(("outcome", "when", *(f'`rules="{name}"`' for name in RULE_SETS)), rows)
    yield (
        f"The horizon is {horizons}, or `horizon=`. A STOP as the last action is judged as any STOP. "
        "An illegal action is one of these:"
    )
    yield _table(
        ("`invalid_reason`", "when"), [(f"`{reason}`", REASONS[reason]) for reason in REASONS_OF[settings.appearance]]
    )


def _signal(reward: float, terminated: bool, truncated: bool) -> str:
    flags = "terminated" * terminated + "truncated" * truncated
    return f"**{reward:+g}**, {flags}" if flags else f"**{reward:+g}**"


def _infos(settings: Settings) -> Iterator[str]:
    yield "## Info"
    yield _table(
        ("when", "key", "value"),
        [
            ("after `reset`", "`task`", 'the task\'s id, which `reset(options={"task": id})` takes'),
            ("at the end", "`outcome`", ", ".join(f"`{o}`" for o in OUTCOMES if o is not Outcome.CONTINUES)),
            ("at the end", "`is_success`", "`True` or `False`"),
            ("at the end, with `invalid_action`", "`invalid_reason`", "as above"),
        ],
    )
    yield (
        "`env.unwrapped` has `task` (statement, program, target, start), `scene`, `goal_reached()` (whether STOP would "
        "be rewarded +1 now), `action_masks()`, `horizon` (`spec.max_episode_steps` is None: the "
        "environment ends episodes itself, without a TimeLimit) and `evaluation_tasks()` (every id of the split)."
    )


def _keywords(settings: Settings) -> Iterator[str]:
    yield "## Keywords of `gym.make`"
    single = _parameters(LilGymEnv.__init__)
    yield _table(("keyword", "default", "meaning"), _keyword_rows(single))
    batch = {**_parameters(BatchedEnv.__init__), **_parameters(BatchSettings.of)}
    more = {name: default for name, default in batch.items() if name not in single}
    missing = ", ".join(f"`{name}`" for name in single if name not in batch)
    yield f"`gym.make_vec` takes them as well, but {missing}, and these ([many environments](../vectorised.md)):"
    yield _table(("keyword", "default", "meaning"), _keyword_rows(more))


def _parameters(function: Any) -> dict[str, Any]:
    parameters = inspect.signature(function).parameters.values()
    return {parameter.name: parameter.default for parameter in parameters if parameter.name not in GIVEN}


def _keyword_rows(parameters: dict[str, Any]) -> list[Sequence[object]]:
    return [
        (f"`{name}`", "" if default is inspect.Parameter.empty else f"`{_default(default)}`", KEYWORDS[name])
        for name, default in parameters.items()
    ]


def _default(value: object) -> str:
    return str(getattr(value, "name", None) or repr(value))


def _versions(settings: Settings) -> Iterator[str]:
    yield "## Versions"
    yield (
        f"`v0`, since lilgym_mp {lilgym_mp.__version__}. A change of the rules, of rewards or of the numbers of "
        "actions would be a `v1`. Figures of results should tell corpus, split and rule set."
    )


def _table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def documents() -> dict[Path, str]:
    """Every page by its path."""
    pages = {TARGET / FILE_NAMES[name]: page(name) for name in CONFIGURATIONS}
    return {TARGET / "index.md": index(), **pages}


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    TARGET.mkdir(exist_ok=True)
    for path, text in documents().items():
        path.write_text(text)


if __name__ == "__main__":
    main()
