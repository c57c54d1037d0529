"""The rules of an environment in words, for language models."""

from __future__ import annotations

from collections.abc import Iterator

from lilgym_mp.actions import BOX_NAMES
from lilgym_mp.appearances import Appearance, Scatter
from lilgym_mp.rules import Dynamics, Outcome
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, SIZE_PIXELS, Colour, Shape, Size

ANSWER = "Answer with one action: its name on a line of its own, such as {example}."
ANSWER_RULES = (
    "Actions within sentences do not count. If several lines are actions, write your choice as Action: {example}."
)
TOWER_EXAMPLE, SCATTER_EXAMPLE = "ADD(LEFT, BLUE)", "ADD(3, 4, CIRCLE, BLUE, SMALL)"


def instructions(dynamics: Dynamics) -> str:
    """The task, rewards, cell grid, actions and answer format."""
    return "\n".join(
        [
            "You edit a picture of three boxes, one action at a time. You are told a statement about the picture, and"
            " whether to make it true or false. When it is as wanted, STOP.",
            reward_line(dynamics),
            scale_line(),
            *cell_lines(dynamics.appearance),
            *action_lines(dynamics),
            answer_line(dynamics.appearance),
            ANSWER_RULES.format(example=_example(dynamics.appearance)),
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
    """The grid of cells in Scatter; nothing for Tower, whose actions name only boxes."""
    if not isinstance(appearance, Scatter):
        return
    columns, rows = appearance.grid
    width, height = appearance.cell
    boxes = ", ".join(
        f"{name} {first}-{last}" for name, (first, last) in zip(BOX_NAMES, box_columns(appearance), strict=True)
    )
    used = {column for first, last in box_columns(appearance) for column in range(first, last + 1)}
    separators = [column for column in range(columns) if column not in used]
    half = len(separators) // (BOX_COUNT - 1)
    between = " and ".join(f"{part[0]}-{part[-1]}" for part in (separators[:half], separators[half:]) if part)
    yield (
        f"Cells (column, row) of {width} x {height} pixels: columns of the boxes {boxes}; columns {between} are"
        f" separators, where nothing can be; rows 0-{rows - 1} from the top. A box's cell covers x from {width} *"
        f" (column - its first column) and y from {height} * row."
    )


def box_columns(appearance: Scatter) -> list[tuple[int, int]]:
    """The first and last column of each box."""
    width = appearance.cell[0]
    return [(box * BOX_PITCH // width, (box * BOX_PITCH + BOX_SIDE) // width - 1) for box in range(BOX_COUNT)]


def answer_line(appearance: Appearance) -> str:
    """The answer format."""
    return ANSWER.format(example=_example(appearance))


def _example(appearance: Appearance) -> str:
    return SCATTER_EXAMPLE if isinstance(appearance, Scatter) else TOWER_EXAMPLE


def action_lines(dynamics: Dynamics) -> Iterator[str]:
    """What each action does."""
    appearance = dynamics.appearance
    colours = "|".join(colour.name for colour in Colour)
    if not isinstance(appearance, Scatter):
        boxes = "|".join(BOX_NAMES)
        yield f"ADD({boxes}, {colours}) puts a block on top of a box's tower, which holds {appearance.box_capacity}."
        yield f"REMOVE({boxes}) takes the top block away."
        return
    shapes = "|".join(shape.name for shape in Shape)
    sizes = "|".join(size.name for size in Size)
    pixels = ", ".join(f"{size.name} {SIZE_PIXELS[size]}" for size in Size)
    yield (
        f"ADD(column, row, {shapes}, {colours}, {sizes}) puts an item into a box, its top-left corner at that of the"
        f" cell. Sides in pixels: {pixels}. Items may neither cross the border of their box nor overlap."
    )
    if not appearance.is_native:
        if dynamics.rules.placement.searches_cell:
            yield "Where it would overlap there, a free place in the cell is looked for."
        yield "An item put within 4 pixels of another moves up to it."
    yield "REMOVE(column, row) takes away the item that fills the cell most."
