"""Observations: the image, the statement and the target. Source: docs/spec.md, "Drawing", "Tasks"."""

from __future__ import annotations

import string
import zlib
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NoReturn, TypedDict, cast

import numpy as np
from gymnasium import spaces
from gymnasium.spaces.utils import flatten_space  # pyright: ignore[reportUnknownVariableType]
from gymnasium.vector.utils import create_shared_memory  # pyright: ignore[reportUnknownVariableType]

from lilgym_mp.corpus import TaskSet
from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Box, Colour, Item, Scene, Shape, Size
from lilgym_mp.scene.arrays import Int16Array, UInt8Array
from lilgym_mp.scene.choices import choose
from lilgym_mp.scene.render import image_shape

if TYPE_CHECKING:
    from lilgym_mp.corpus import Vocabulary
    from lilgym_mp.corpus.statement_arrays import StatementArrays, VocabularyOrPath

MAX_STATEMENT_LENGTH = 256  # characters; the space grows for longer statements
TEXT = "text"
ARRAYS = "arrays"
FORMS = {form: form for form in (TEXT, ARRAYS)}  # forms of observations: the statement as text, or everything as arrays
EMPTY = -1  # every field of an empty slot of an item array
PLAIN_CHARACTERS = frozenset(string.ascii_letters + string.digits + string.punctuation + " ")


class Observation(TypedDict):
    """What an agent sees of a scene, its statement and the truth to reach."""

    image: UInt8Array  # (50, 190, 3), or (100, 380, 3) at native size
    statement: str
    target: int  # 1: make the statement true, 0: make it false


def flat_space(space: spaces.Dict) -> spaces.Box:
    """The space of all numeric parts as one float32 vector, in alphabetical order."""
    flat = cast("spaces.Box", flatten_space(space))
    return spaces.Box(flat.low.astype(np.float32), flat.high.astype(np.float32), dtype=np.float32)


def image_space(image_size: str) -> spaces.Box:
    """The space of images, uint8 (height, width, 3), of an image size by name."""
    return spaces.Box(0, 255, image_shape(image_size), np.uint8)


class StatementSpace(spaces.Text):
    """A space of texts which Gymnasium's AsyncVectorEnv refuses to put into shared memory."""


@create_shared_memory.register(StatementSpace)
def _refuse_shared_memory(space: StatementSpace, *_: Any, **__: Any) -> NoReturn:
    raise ValueError(
        "Gymnasium's AsyncVectorEnv reads texts in shared memory only once, so that every statement would be blank; use"
        ' vector_kwargs={"shared_memory": False}, or observation="arrays" without text, or the batch that'
        " gymnasium.make_vec(id, num_envs=N) makes"
    )


def statement_space(tasks: Iterable[Task]) -> spaces.Text:
    """A space of every statement of `tasks`; the same for all corpora of plain English."""
    statements = {task.statement for task in tasks}
    characters = PLAIN_CHARACTERS.union(*statements)
    longest = max(map(len, statements), default=0)
    return StatementSpace(max(MAX_STATEMENT_LENGTH, longest), min_length=0, charset="".join(sorted(characters)))


class TokenSpace(spaces.Box):
    """Token ids (length,) int64. Spaces of different vocabularies are unequal even if their sizes are equal, so that no
    model continues with other words unnoticed."""

    def __init__(self, arrays: StatementArrays) -> None:
        super().__init__(0, len(arrays.vocabulary) - 1, (arrays.length,), np.int64)
        self.vocabulary: Vocabulary = arrays.vocabulary

    def __eq__(self, other: object) -> bool:
        return super().__eq__(other) and getattr(other, "vocabulary", self.vocabulary) == self.vocabulary

    def __repr__(self) -> str:
        checksum = zlib.crc32(" ".join(self.vocabulary.words).encode())
        return f"{super().__repr__()[:-1]}, words {checksum:08x})"


def observation_space(image_size: str, tasks: Iterable[Task], arrays: StatementArrays | None = None) -> spaces.Dict:
    """The space of observations in the form "text", or "arrays" if `arrays` is given."""
    if arrays is None:
        statement = statement_space(tasks)
        target = spaces.Discrete(2)
    else:
        statement = TokenSpace(arrays)
        target = spaces.Box(0, 1, (1,), np.int64)
    return spaces.Dict({"image": image_space(image_size), "statement": statement, "target": target})


def statement_arrays(
    observation: str, tasks: TaskSet, vocabulary: VocabularyOrPath | None = None, length: int | None = None
) -> StatementArrays | None:
    """The encoder of statements for the form "arrays"; None for "text". Raises ValueError for other forms."""
    if choose("observation", observation, FORMS) == ARRAYS:
        from lilgym_mp.corpus.statement_arrays import StatementArrays

        return StatementArrays(tasks, vocabulary, length)
    if vocabulary is not None or length is not None:
        raise ValueError(f'vocabulary and length belong to observation="{ARRAYS}"')
    return None


def row_of(batch: Any, index: Any) -> Any:
    """One environment's part of a batch of observations, or with an array of indices a copy of several."""
    if isinstance(batch, Mapping):
        return {name: row_of(part, index) for name, part in cast("Mapping[str, Any]", batch).items()}
    return batch[index]


def item_capacity(tasks: Iterable[Task], dynamics: Dynamics) -> int:
    """The most items that a box can reach: those at the start and one per action, limited by the appearance."""
    reachable = max(len(box.items) for task in tasks for box in task.start.boxes) + dynamics.horizon
    capacity = dynamics.appearance.box_capacity
    return reachable if capacity is None else min(reachable, capacity)


def item_array(scene: Scene, capacity: int) -> Int16Array:
    """(3, capacity, 5) `item_arrays` of the scene's boxes."""
    return item_arrays(scene.boxes, capacity)


def item_arrays(boxes: Sequence[Box], capacity: int) -> Int16Array:
    """(boxes, capacity, 5): x, y, shape, colour and size of each box's items in order, then EMPTY."""
    array = np.full((len(boxes), capacity, len(Item._fields)), EMPTY, np.int16)
    for slots, box in zip(array, boxes, strict=True):
        if box.items:
            slots[: len(box.items)] = box.items
    return array


def scene_of(array: Int16Array) -> Scene:
    """The scene whose `item_array` is `array`."""
    return Scene.of(*map(items_of, array))


def items_of(slots: Int16Array) -> list[Item]:
    """The items of a box, given as its row of `item_arrays`."""
    filled = (row for row in slots.tolist() if row[-1] != EMPTY)
    return [Item(x, y, Shape(shape), Colour(colour), Size(size)) for x, y, shape, colour, size in filled]
