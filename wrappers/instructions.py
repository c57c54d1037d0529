"""The rules of an environment in words, for language models."""

from __future__ import annotations

from collections.abc import Iterator

from lilgym_mp.actions import BOX_NAMES, describe
from lilgym_mp.appearances import Appearance, Grid
from lilgym_mp.rules import Dynamics, Outcome
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, IMAGE_HEIGHT, IMAGE_WIDTH

ANSWER = "Answer with one action: its name on a line of its own, such as {example}."
ANSWER_RULES = (
    "Actions within sentences do not count. If several lines are actions, write your choice as Action: {example}."
)


def instructions(dynamics: Dynamics) -> str:
    """The task, rewards, cell grid, actions and answer format."""
    return "\n".join(
        [
            "You edit a picture of three boxes, one action at a time. You are told a statement about the picture, and"
            " whether to make it true or false. When it is as wanted, STOP.",
            reward_line(dynamics),
            scale_line(),
            *cell_lines(dynamics.appearance),
            *dynamics.appearance.explain(dynamics.rules.placement),
            answer_line(dynamics.appearance),
            ANSWER_RULES.format(example=describe(dynamics.appearance.example)),
        ]
    )


def reward_line(dynamics: Dynamics) -> str:
    """The rewards, and when episodes end."""
    reward = {outcome: f"{signal.reward:+g}" for outcome, signal in dynamics.rules.signals.items()}
    return (
        f"Rewards: STOP {reward[Outcome.SUCCESS]} if the statement is as wanted, else {reward[Outcome.WRONG_STOP]};"
        f" an illegal action {reward[Outcome.INVALID_ACTION]}; each of these ends the episode. Any other action"
        f" {reward[Outcome.CONTINUES]}; the episode also ends with action {dynamics.horizon}, and if that is no STOP,"
        f" its reward is {reward[Outcome.HORIZON]}."
    )


def scale_line() -> str:
    """The coordinate system."""
    return (
        f"Scene: three boxes of {BOX_SIDE} x {BOX_SIDE} pixels; (x, y) is an item's top-left corner in its box,"
        " y grows downwards."
    )


def cell_lines(appearance: Appearance) -> Iterator[str]:
    """The grid of cells; nothing for appearances whose actions name only boxes."""
    if appearance.grid is None:
        return
    columns, rows = appearance.grid
    width, height = cell_size(appearance.grid)
    places = box_columns(appearance.grid)
    boxes = ", ".join(f"{name} {first}-{last}" for name, (first, last) in zip(BOX_NAMES, places, strict=True))
    used = {column for first, last in places for column in range(first, last + 1)}
    separators = [column for column in range(columns) if column not in used]
    half = len(separators) // (BOX_COUNT - 1)
    between = " and ".join(f"{part[0]}-{part[-1]}" for part in (separators[:half], separators[half:]) if part)
    yield (
        f"Cells (column, row) of {width} x {height} pixels: columns of the boxes {boxes}; columns {between} are"
        f" separators, where nothing can be; rows 0-{rows - 1} from the top. A box's cell covers x from {width} *"
        f" (column - its first column) and y from {height} * row."
    )


def cell_size(grid: Grid) -> tuple[int, int]:
    """Width and height of a cell in pixels."""
    return IMAGE_WIDTH // grid[0], IMAGE_HEIGHT // grid[1]


def box_columns(grid: Grid) -> list[tuple[int, int]]:
    """The first and last column of each box."""
    width, _ = cell_size(grid)
    return [(box * BOX_PITCH // width, (box * BOX_PITCH + BOX_SIDE) // width - 1) for box in range(BOX_COUNT)]


def answer_line(appearance: Appearance) -> str:
    """The answer format."""
    return ANSWER.format(example=describe(appearance.example))
