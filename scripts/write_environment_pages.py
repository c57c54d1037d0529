"""Writes docs/environments/*.md from the code: what all configurations share, and a page for each appearance."""

from __future__ import annotations

import argparse
import inspect
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from lilgym_mp.corpus import load_tasks
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.envs.batched import BatchedEnv
from lilgym_mp.envs.config import EnvConfig, SingleConfig
from lilgym_mp.envs.engine import BatchSettings
from lilgym_mp.envs.rules import RULE_SETS, Outcome
from lilgym_mp.envs.single import LilGymEnv
from lilgym_mp.evaluation import CONFIGURATIONS, Settings
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, SIZE_PIXELS, Size
from lilgym_mp.scene.actions import BOX_NAMES, describe
from lilgym_mp.scene.appearances import Appearance, InvalidReason, Scatter

TARGET = Path(__file__).resolve().parent.parent / "docs" / "environments"

ABOUT = {
    ("tower", "scratch"): "Build towers in three empty boxes until the statement is true, then STOP.",
    ("tower", "flipit"): "Change the towers of a start scene until the statement's truth has flipped, then STOP.",
    ("scatter", "scratch"): "Put items anywhere in three empty boxes until the statement is true, then STOP.",
    ("scatter", "flipit"): "Add and remove items of a start scene until the statement's truth has flipped, then STOP.",
}
PARTS = {
    "image": "the scene, RGB",
    "statement": "the statement, in English",
    "target": "1: make the statement true; 0: make it false",
}
KEYWORDS = {
    "corpus": '`"builtin"`; `"lilgym"`, the official data ([how to get it](../official_data.md)); or the path of '
    "[a corpus](../corpus.md)",
    "split": '`"train"`, `"dev"` or `"test"`: the tasks to draw from',
    "rules": '`"paper"` or `"release"` ([where they differ](../spec.md#rule-sets))',
    "horizon": "maximum number of actions per episode; `None`: the rule set's",
    "grid": 'columns and rows of Scatter, or `"native"`, one cell per pixel; ignored in Tower',
    "image_size": '`"half"` or `"native"`',
    "render_mode": '`"human"` (a window; the extra `human`), `"rgb_array"` or `"ansi"`; `None`: no rendering',
    "observation": '`"text"`, or `"arrays"` for learners that do not accept text (Stable-Baselines3)',
    "vocabulary": 'with `observation="arrays"`: a `Vocabulary` or the path of a saved one; `None`: the words of the '
    "train split",
    "length": 'with `observation="arrays"`: number of token ids; `None`: that of the longest statement',
    "sampler": "chooses the tasks ([choosing tasks](../vectorised.md#choosing-tasks)); `None`: uniform draws",
    "render_cells": "rendered frames show the grid with column and row numbers; in Tower, box names",
}
NOT_KEYWORDS = ("self", "configuration", "settings")  # or fixed by the id
OUTCOMES = {
    Outcome.SUCCESS: "STOP in a scene where the statement has the target value",
    Outcome.WRONG_STOP: "STOP in any other scene",
    Outcome.INVALID_ACTION: "an illegal action; the scene does not change",
    Outcome.HORIZON: "the last action within the horizon, if legal and not STOP",
    Outcome.CONTINUES: "any other legal action; the episode goes on",
}
REASONS = {
    InvalidReason.SEPARATOR: "the cell lies on a separator between boxes",
    InvalidReason.OVERLAP: "the new item fits at no pixel of the cell",
    InvalidReason.OUT_OF_BOX: "the new item would cross the right or bottom wall of the box",
    InvalidReason.NOTHING_TO_REMOVE: "no item overlaps the cell",
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


def page(appearance: str) -> str:
    """The Markdown page of both configurations of an appearance."""
    settings = [Settings(name) for name in CONFIGURATIONS if CONFIGURATIONS[name][0] == appearance]
    sections = (_opening(settings), _actions(settings[0]), _illegal(appearance))
    return _joined(sections)


def index() -> str:
    """The Markdown page with what all configurations share."""
    rows = [
        (
            f"[{name}]({appearance}.md)",
            f"{Settings(name).dynamics().appearance.action_count:,}",
            *(f"{len(load_tasks('builtin', appearance, start, split)):,}" for split in SPLITS),
        )
        for name, (appearance, start) in CONFIGURATIONS.items()
    ]
    sections = (
        _introduction(_table(("configuration", "actions", *(f"{split} tasks" for split in SPLITS)), rows)),
        _observations([Settings(name) for name, (_, start) in CONFIGURATIONS.items() if start == "scratch"]),
        _rewards(),
        _infos(),
        _keywords(),
    )
    return _joined(sections)


def _joined(sections: Iterable[Iterator[str]]) -> str:
    """The parts of the sections as paragraphs; lines of prose end at 150 characters."""
    parts = [part for section in sections for part in section]
    for index, part in enumerate(parts):
        if "\n" not in part and not part.startswith(("#", "!")):
            parts[index] = textwrap.fill(part, 150, break_long_words=False, break_on_hyphens=False)
    return "\n\n".join(parts) + "\n"


def _introduction(table: str) -> Iterator[str]:
    yield "# The environments"
    yield (
        "Two appearances, Tower and Scatter, each with two kinds of start, make four configurations. In Scratch, every "
        "episode starts with three empty boxes, and the target is `True`. In FlipIt, it starts with a scene from the "
        "corpus, and the target is the opposite of the statement's truth value there. `reset` draws a start scene "
        "uniformly, not a statement. With the builtin corpus:"
    )
    yield table
    yield (
        "`lilgym_mp.action_masks(env)` says which actions are legal now. `env.unwrapped.encode_action(array)` converts "
        "the released array form to an action index, and `decode_action(index)` the reverse."
    )


def _film(configuration: str) -> str:
    return f"![An episode of {configuration}](../pictures/{configuration}.gif)"


def _opening(settings: Sequence[Settings]) -> Iterator[str]:
    yield f"# {settings[0].appearance.capitalize()}"
    yield "\n".join(f'- `gym.make("{one.id}")`: {ABOUT[one.appearance, one.start]}' for one in settings)
    yield _facts(settings)
    for one in settings:
        yield _film(one.configuration)
    yield (
        "The included `parse-and-plan` plays tasks new to it. With `render_cells=True`, frames "
        f"{'name the boxes' if settings[0].dynamics().appearance.grid is None else 'show the grid'}:"
    )
    for one in settings:
        yield f"![A start scene of {one.configuration} with the grid](../pictures/{one.configuration}.png)"


def _facts(settings: Sequence[Settings]) -> str:
    """The environment at a glance."""
    image, *_ = parts = _space(settings[0]).spaces.items()
    words = {"image": f"`image` {_space_text(image[1])}"}
    paper = RULE_SETS["paper"]
    success, step = (paper.signals[each][0] for each in (Outcome.SUCCESS, Outcome.CONTINUES))
    facts = {
        "action space": f"`Discrete({settings[0].dynamics().appearance.action_count})`",
        "[observation](index.md#observations)": ", ".join(words.get(name, f"`{name}`") for name, _ in parts),
        "[reward](index.md#rewards-and-termination)": (
            f"{success:+g} for STOP where the statement has the target value, {step:+g} for each action before, -1 at "
            "any other end"
        ),
        "horizon": f"{paper.horizon} actions",
        "import": "`import gymnasium as gym, lilgym_mp`",
    }
    return _table(("fact", "value"), facts.items())


def _observations(settings: Sequence[Settings]) -> Iterator[str]:
    yield "## Observations"
    text, arrays = _space(settings[0]), [_space(one, observation="arrays") for one in settings]
    native = _space(settings[0], image_size="native")["image"]
    rows = [
        (
            f"`{key}`",
            PARTS[key],
            _space_text(text[key]),
            " or ".join(dict.fromkeys(_space_text(one[key]) for one in arrays)),
        )
        for key in text
    ]
    yield _table(
        ("key", "contents", '`observation="text"` (default)', '`observation="arrays"` (Tower or Scatter)'), rows
    )
    yield (
        f'With `image_size="native"`, images are {_space_text(native)}. With `observation="arrays"`, statements are '
        "token ids in the vocabulary of the train split, padded with 0."
    )


def _space(settings: Settings, **keywords: Any) -> spaces.Dict:
    space = gym.make(settings.id, **keywords).observation_space
    assert isinstance(space, spaces.Dict)
    return space


def _space_text(space: spaces.Space[Any]) -> str:
    if isinstance(space, spaces.Text):
        return "str"
    if isinstance(space, spaces.Discrete):
        return f"int, 0 .. {space.n - 1}"
    assert isinstance(space, spaces.Box)
    low, high = np.min(space.low), np.max(space.high)
    return f"{space.dtype} {space.shape}, {low} .. {high}"


def _actions(settings: Settings) -> Iterator[str]:
    appearance = settings.dynamics().appearance
    yield "## Actions"
    yield f"`Discrete({appearance.action_count})`:"
    yield from ACTION_TEXTS[settings.appearance](appearance)


def _action_rows(appearance: Appearance, indices: Iterable[int]) -> list[Sequence[object]]:
    actions = [(index, appearance.decode(index)) for index in indices]
    return [(index, f"`{describe(action)}`", f"`{appearance.to_array(action)}`") for index, action in actions]


def _tower_actions(appearance: Appearance) -> Iterator[str]:
    header = ("index", "action", "array form [type, box, colour]")
    yield _table(header, _action_rows(appearance, range(appearance.action_count)))
    yield (
        "ADD puts a block on top of the tower in a box, REMOVE takes the top block away. The "
        "[specification](../spec.md#scenes) has their places in the image."
    )


def _scatter_actions(appearance: Scatter) -> Iterator[str]:
    columns, rows = appearance.grid
    width, height = appearance.cell
    cells = columns * rows
    item_types = (appearance.action_count - 1) // cells - 1
    first_remove = 1 + cells * item_types
    yield _table(
        ("index", "action", "array form [type, x, y, shape, colour, size]"),
        _action_rows(
            appearance,
            (0, 1, item_types, item_types + 1, first_remove - 1, first_remove, first_remove + cells - 1),
        ),
    )
    sizes = ", ".join(str(SIZE_PIXELS[size]) for size in Size)
    yield (
        f"With `cell = {rows} * column + row` and `item_type = 9 * shape + 3 * colour + size`, the index of ADD is "
        f"`1 + {item_types} * cell + item_type` and that of REMOVE `{first_remove} + cell`. shape: 0 circle, 1 square, "
        f"2 triangle; colour: 0 yellow, 1 black, 2 blue; size: 0 small, 1 medium, 2 large ({sizes} pixels)."
    )
    yield (
        f"Cells are {width} x {height} pixels of the native image, which is 380 x 100. The columns of the boxes are "
        f"{', '.join(_columns(width))}; all actions on the others, the separators, are illegal. Rows count from the "
        "top. Choose another grid with `grid=(columns, rows)`."
    )
    yield (
        "ADD puts the item's upper left corner at that of the cell or, if it overlaps an item there, at a free pixel "
        "of the cell such that half of the item lies in the cell or half of the cell is covered. Then the item "
        "snaps to a neighbour up to 4 pixels away. REMOVE takes the item that covers the largest part of the cell."
    )


ACTION_TEXTS: Mapping[str, Callable[[Any], Iterator[str]]] = {"tower": _tower_actions, "scatter": _scatter_actions}


def _columns(width: int) -> Iterator[str]:
    for name, left in zip(BOX_NAMES, range(0, BOX_COUNT * BOX_PITCH, BOX_PITCH), strict=True):
        yield f"{left // width} to {(left + BOX_SIDE) // width - 1} ({name})"


def _illegal(appearance: str) -> Iterator[str]:
    yield "## Illegal actions"
    yield _table(("`invalid_reason`", "when"), [(f"`{reason}`", REASONS[reason]) for reason in REASONS_OF[appearance]])


def _rewards() -> Iterator[str]:
    yield "## Rewards and termination"
    rows: list[Sequence[object]] = []
    for outcome, when in OUTCOMES.items():
        signals = [rules.signals[outcome] for rules in RULE_SETS.values()]
        rows.append((f"`{outcome}`", when, *(_signal(*signal) for signal in signals)))
    horizons = " or ".join(f"{rules.horizon} under `{rules.name}`" for rules in RULE_SETS.values())
    yield _table(("outcome", "when", *(f'`rules="{name}"`' for name in RULE_SETS)), rows)
    yield f"The horizon is {horizons}, unless `horizon=` is given."


def _signal(reward: float, terminated: bool, truncated: bool) -> str:
    flags = "terminated" * terminated + "truncated" * truncated
    return f"**{reward:+g}**, {flags}" if flags else f"**{reward:+g}**"


def _infos() -> Iterator[str]:
    yield "## Info"
    yield _table(
        ("when", "key", "value"),
        [
            ("after `reset`", "`task`", 'the id of the task, as accepted by `reset(options={"task": id})`'),
            ("at the end", "`outcome`", ", ".join(f"`{o}`" for o in OUTCOMES if o is not Outcome.CONTINUES)),
            ("at the end", "`is_success`", "bool"),
            (
                "at the end, if `invalid_action`",
                "`invalid_reason`",
                "[Tower](tower.md#illegal-actions), [Scatter](scatter.md#illegal-actions)",
            ),
        ],
    )
    yield (
        "`env.unwrapped` has `task` (statement, program, target, start scene), `scene`, `goal_reached()` (whether STOP "
        "would be rewarded +1 now), `action_masks()`, `evaluation_tasks()` (every task id of the split) and `horizon` "
        "(`spec.max_episode_steps` is None: there is no TimeLimit)."
    )


def _keywords() -> Iterator[str]:
    yield "## Arguments of `gym.make`"
    single = _parameters(SingleConfig, LilGymEnv)
    yield _table(("argument", "default", "meaning"), _keyword_rows(single))
    batch = _parameters(BatchSettings, BatchedEnv)
    missing = ", ".join(f"`{name}`" for name in single if name not in batch)
    more = ", ".join(f"`{name}`" for name in batch if name not in single)
    yield f"`gym.make_vec` accepts these too, except {missing}, and [also](../vectorised.md#batched) {more}."


def _parameters(*makers: Any) -> dict[str, Any]:
    parameters = [each for maker in makers for each in inspect.signature(maker).parameters.values()]
    return {parameter.name: parameter.default for parameter in parameters if parameter.name not in NOT_KEYWORDS}


def _keyword_rows(parameters: dict[str, Any]) -> list[Sequence[object]]:
    descriptions = {name: each.metadata["description"] for name, each in EnvConfig.settings().items()} | KEYWORDS
    return [(f"`{name}`", f"`{_default(default)}`", descriptions[name]) for name, default in parameters.items()]


def _default(value: object) -> str:
    return str(getattr(value, "name", None) or repr(value))


def _table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    head, *lines = [f"| {' | '.join(map(str, line))} |" for line in (header, *rows)]
    return "\n".join([head, "|" + "---|" * len(header), *lines])


def documents() -> dict[Path, str]:
    """Every page, by path."""
    return {TARGET / "index.md": index(), **{TARGET / f"{name}.md": page(name) for name in ACTION_TEXTS}}


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    TARGET.mkdir(exist_ok=True)
    for path, text in documents().items():
        path.write_text(text)


if __name__ == "__main__":
    main()
