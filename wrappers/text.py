"""Observations and rules as text, and the parsing of replies, for language models."""

from __future__ import annotations

import base64
import io
import itertools
import string
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from gymnasium import spaces
from PIL import Image

from lilgym_mp.envs.observation import StatementSpace, statement_space
from lilgym_mp.envs.rules import Dynamics, Outcome, State
from lilgym_mp.scene import BOX_COUNT, BOX_SIDE, IMAGE_HEIGHT, IMAGE_WIDTH, Scene
from lilgym_mp.scene.actions import BOX_NAMES, AddItem, RemoveItem, describe
from lilgym_mp.scene.appearances import Appearance
from lilgym_mp.scene.appearances.places import places_of
from lilgym_mp.scene.arrays import AnyDict, AnyMapping, BoolArray, Strings
from lilgym_mp.scene.choices import choose
from lilgym_mp.scene.grouping import grouped
from lilgym_mp.scene.render import draw
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.replies import THOUGHTS, Reply, parse_reply
from lilgym_mp.wrappers.transformation import (
    STATEMENT,
    Batch,
    Batches,
    EnvDescription,
    EnvState,
    GymEnv,
    Transformation,
)

TARGET = "target"  # observation key
IMAGES = "images"  # key in infos
SCALE = (
    f"Scene: three boxes of {BOX_SIDE} x {BOX_SIDE} pixels; (x, y) is an item's top-left corner in its box,"
    " y grows downwards."
)
ANSWER = "Answer with one action: its name on a line of its own, such as {example}."
ANSWER_RULES = (
    "Actions within sentences do not count. If several lines are actions, write your choice as Action: {example}."
)

MAX_LISTED = 64  # more legal actions than this are listed by cell instead of one by one with their numbers
MAX_DESCRIBED = 50_000  # in larger action spaces legal actions are only counted

# Upper bounds on text lengths, in characters
FIXED_LENGTH = 2_500
ITEM_LENGTH = 90
LISTED_LENGTH = MAX_LISTED * 60
LEGAL_LENGTH = 12  # per action, if listed by cell

SCENE_STYLES = {  # whether the scene is shown as a picture
    "list": False,
    "image": True,
    "both": True,  # a picture and a list
}


class TextFormat(Transformation):
    """The observation as text."""

    changes_observations = True
    uses_mdp_actions = True

    def __init__(
        self,
        description: EnvDescription,
        *,
        default: int | str,
        scene: str,
        legal_actions: bool,
        thoughts: Sequence[str],
    ) -> None:
        super().__init__(description)
        for part in (STATEMENT, TARGET):
            description.part(part)
        description.require_scene()
        self._statements = statement_space(description.tasks)
        self._appearance = description.dynamics.appearance
        self.adds_infos = choose("scene", scene, SCENE_STYLES)
        self._scene = scene
        self._lists_legal = legal_actions
        self._thoughts = tuple(thoughts)
        reply = parse_reply(str(default), self._appearance, description.stop_index)
        if not reply.understood:
            raise ValueError(f"default must be the number or name of an action, not {default!r}")
        self.default = reply.action

    def observation_space(self) -> spaces.Text:
        count = self._appearance.action_count
        items = BOX_COUNT * self.env_description.item_capacity * ITEM_LENGTH
        actions = LISTED_LENGTH + (count * LEGAL_LENGTH if count <= MAX_DESCRIBED else 0)
        length = FIXED_LENGTH + self._statements.max_length + items + actions
        return StatementSpace(
            length, min_length=0, charset="".join(sorted(self._statements.character_set.union(string.printable)))
        )

    def observations(self, observations: Batch, state: EnvState) -> Batch:
        masks = state.action_masks() if self._lists_legal else itertools.repeat(None)
        dynamics = self.env_description.dynamics
        scene = self._scene
        states = zip(state.states(), masks, strict=self._lists_legal)
        return tuple(text_of(dynamics, each, legal=mask, scene=scene) for each, mask in states)

    def added_infos(self, info: AnyMapping, state: EnvState) -> Batches:
        states = state.states()
        images = np.empty(len(states), object)
        for index, each in enumerate(states):
            images[index] = [picture(each.scene)]
        return {IMAGES: images}

    def parse(self, reply: object, legal: Callable[[], BoolArray]) -> Reply:
        """The action that a reply chooses, or the default. `legal`: returns the current mask."""
        shown = partial(is_shown, self._appearance, legal)
        return parse_reply(reply, self._appearance, self.default, shown, thoughts=self._thoughts)


def text_of(
    dynamics: Dynamics, state: State, *, legal: BoolArray | None = None, scene: str = "list", rules: bool = True
) -> str:
    """A state as text. `legal`: the mask of the legal actions to list, if any; `scene`: of SCENE_STYLES; `rules`: with
    what `instructions` also states, the rewards, cells and the form of the answer."""
    appearance = dynamics.appearance
    task = state.task
    return "\n".join(
        (
            f"Statement: {task.statement}",
            f"Make the statement {str(task.target).lower()}, then STOP."
            f" Actions left: {dynamics.horizon - state.steps}.",
            *([reward_line(dynamics)] if rules else ()),
            *shown_lines(state.scene, appearance, scene, rules=rules),
            *(legal_lines(appearance, legal) if legal is not None else ()),
            *([answer_line(appearance)] if rules else ()),
        )
    )


def shown_lines(scene: Scene, appearance: Appearance, style: str, *, rules: bool = True) -> Iterator[str]:
    """The scene in one of SCENE_STYLES; `rules`: with the coordinates and cells. Raises ValueError."""
    if choose("scene", style, SCENE_STYLES):
        yield f"Scene: the picture, of {IMAGE_WIDTH} x {IMAGE_HEIGHT} pixels, with the boxes LEFT, MIDDLE and RIGHT."
    if style == "image":
        yield from places_of(appearance.grid).explain() if rules else ()
    else:
        yield from (SCALE, *places_of(appearance.grid).explain()) if rules else ()
        yield from item_lines(scene, appearance)


def picture(scene: Scene) -> Image.Image:
    """The scene as an RGB image of 380 x 100 pixels."""
    return Image.fromarray(draw(scene))


def image_part(image: Image.Image) -> AnyDict:
    """The image as a content part of a message, in the form of OpenAI's chat API: PNG in a data URL."""
    file = io.BytesIO()
    image.save(file, "PNG")
    return {
        "type": "image_url",
        "image_url": {"url": f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}"},
    }


def content_of(text: str, images: Sequence[Image.Image], *, inline: bool = True) -> Any:
    """The content of a message: the text, or the images and the text as parts.

    Unless `inline`, {"type": "image"} stands for each image, as in TRL and transformers.
    """
    shown = [image_part(image) if inline else {"type": "image"} for image in images]
    return [*shown, {"type": "text", "text": text}] if images else text


def is_shown(appearance: Appearance, legal: Callable[[], BoolArray], index: int) -> bool:
    """Whether the agent knows an action by its number: if there are few actions, or it is listed.

    `legal`: returns the current mask.
    """
    if appearance.action_count <= MAX_LISTED or index == 0:
        return True
    mask = legal()
    return bool(mask[index] and np.count_nonzero(mask) <= MAX_LISTED)


def item_lines(scene: Scene, appearance: Appearance) -> Iterator[str]:
    """The scene item by item, with the cell of each item's centre."""
    places = places_of(appearance.grid)
    for index, (name, box) in enumerate(zip(BOX_NAMES, scene.boxes, strict=True)):
        yield f"{name} box: {'' if box.items else 'empty'}".rstrip()
        for item in box.items:
            words = f"{item.size.name} {item.colour.name} {item.shape.name}".lower()
            place = f"of {item.side} x {item.side} pixels at ({item.x}, {item.y})"
            yield f"  {words} {place}{places.of_centre(index, item)}"


def legal_lines(appearance: Appearance, legal: BoolArray) -> Iterator[str]:
    """The legal actions with their numbers; if more than MAX_LISTED, by the cells in which they are legal."""
    indices: list[int] = np.flatnonzero(legal).tolist()
    if len(indices) <= MAX_LISTED:
        yield "Legal actions, each with its number:"
        yield from (f"  {index} {describe(appearance.decode(index))}" for index in indices)
    elif len(legal) > MAX_DESCRIBED:
        last = describe(appearance.decode(len(legal) - 1))
        yield f"{len(indices)} of {len(legal)} actions are legal, from STOP to {last}."
    else:
        yield "Legal actions, STOP and in cells (column, row):"
        yield "  0 STOP"
        yield from _lines_by_cells(appearance, indices)


def _lines_by_cells(appearance: Appearance, indices: Iterable[int]) -> Iterator[str]:
    """A line for each group of item types that can be added in the same cells, and a line for removals."""
    edits = [appearance.decode(index) for index in indices]
    adds = [edit for edit in edits if isinstance(edit, AddItem)]
    cells_of = grouped(((add.shape.name, add.colour.name, add.size.name), (add.row, add.column)) for add in adds)
    removed = [(edit.row, edit.column) for edit in edits if isinstance(edit, RemoveItem)]
    for cells, item_types in grouped((tuple(sorted(cells)), names) for names, cells in cells_of.items()).items():
        for names in _products(item_types):
            yield f"  ADD(column, row, {', '.join(names)}): {_cell_words(cells)}"
    if removed:
        yield f"  REMOVE(column, row): {_cell_words(sorted(removed))}"


def _products(item_types: Iterable[Strings]) -> list[Strings]:
    """The item types as products of alternatives, such as ("CIRCLE|SQUARE", "BLUE", "SMALL|LARGE")."""
    merged = list(item_types)
    for slot in (1, 2, 0):
        groups = grouped((names[:slot] + names[slot + 1 :], names[slot]) for names in merged)
        merged = [(*others[:slot], "|".join(names), *others[slot:]) for others, names in groups.items()]
    return merged


def _cell_words(cells: Sequence[tuple[int, int]]) -> str:
    """Formats ascending (row, column) pairs, such as "row 0-3: column 0-4, 7-11; row 4: column 2"."""
    rows_of = grouped((_ranges(columns), row) for row, columns in grouped(cells).items())
    return "; ".join(f"row {_ranges(rows)}: column {columns}" for columns, rows in rows_of.items())


def _ranges(numbers: Sequence[int]) -> str:
    """Formats ascending numbers, such as "0-4, 7"."""
    breaks = [0, *(i for i in range(1, len(numbers)) if numbers[i] != numbers[i - 1] + 1), len(numbers)]
    runs = [(numbers[first], numbers[end - 1]) for first, end in itertools.pairwise(breaks)]
    return ", ".join(str(first) if first == last else f"{first}-{last}" for first, last in runs)


def instructions(dynamics: Dynamics, rewards: str | None = None) -> str:
    """The task, rewards, cell grid, actions and answer format; `rewards`: a sentence instead of `reward_line`."""
    return "\n".join(
        [
            "You edit a picture of three boxes, one action at a time. You are told a statement about the picture, and"
            " whether to make it true or false. When it is as wanted, STOP.",
            rewards or reward_line(dynamics),
            SCALE,
            *places_of(dynamics.appearance.grid).explain(),
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


def answer_line(appearance: Appearance) -> str:
    """The answer format."""
    return ANSWER.format(example=describe(appearance.example))


class TextObservation(EnvWrapper[TextFormat]):
    """Turns the observation into text: the statement, target, actions left, rewards, every item, and the legal actions
    with names and numbers (by cell, if there are more than 64).

    `parse_action(reply)` parses an agent's reply to an action index.

    Args:
        env: The environment to wrap.
        default: The name or number of the action for replies without a clear choice.
        scene: "list", "image" for a picture instead, or "both" for a picture and a list; pictures are in
            info["images"], a list of one PIL image of 380 x 100 pixels.
        legal_actions: False omits the list of legal actions.
        thoughts: Tags of thoughts, which are not read (`replies.THOUGHTS`).

    Raises:
        ValueError: For another `scene` or a `default` that is not an action.
    """

    transformation_class = TextFormat

    def __init__(
        self,
        env: GymEnv,
        *,
        default: int | str = "STOP",
        scene: str = "list",
        legal_actions: bool = True,
        thoughts: Sequence[str] = THOUGHTS,
    ) -> None:
        super().__init__(env, default=default, scene=scene, legal_actions=legal_actions, thoughts=thoughts)

    def parse_action(self, reply: object) -> Reply:
        """The action that a reply chooses, and whether it was understood. `wrappers.replies` has the rules.

        Args:
            reply: A text or content parts.
        """
        return self.transformation.parse(reply, self.action_masks)

    def instructions(self) -> str:
        """The rules in words: the task, rewards, cell grid, actions and answer format."""
        return instructions(self.transformation.env_description.dynamics)
