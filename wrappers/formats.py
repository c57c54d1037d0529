"""Observations in other forms: of the scene, the statement, the steps left, and all of it."""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np
from gymnasium import spaces

from lilgym_mp.corpus import Vocabulary
from lilgym_mp.corpus.locations import fixed_path
from lilgym_mp.corpus.statement_arrays import StatementArrays, VocabularyOrPath
from lilgym_mp.envs.observation import EMPTY, TokenSpace, flat_space
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, SIZE_PIXELS, Colour, Shape, Size
from lilgym_mp.scene.appearances import RELEASED_GRID
from lilgym_mp.scene.appearances.grids import cell_size
from lilgym_mp.scene.arrays import BoolArray, Float32Array, Int64Array, UInt8Array
from lilgym_mp.wrappers.gymnasium_adapter import EnvWrapper
from lilgym_mp.wrappers.transformation import (
    IMAGE,
    ITEMS,
    PLANES,
    STATEMENT,
    AnySpace,
    Batch,
    Batches,
    EnvDescription,
    EnvState,
    Format,
    GymEnv,
    SceneFormat,
    Spaces,
    Transformation,
    WrongEnvironment,
)

PRESENT = "present"  # observation key
MARGIN = 10  # pixels; the release's snapping may move an item slightly out of its box


class Items(SceneFormat):
    """The item array and a mask of its filled slots."""

    def __init__(self, description: EnvDescription, *, keep_image: bool, slots: int | None) -> None:
        """Raises ValueError for fewer slots than a box can have items."""
        super().__init__(description, keep_image=keep_image)
        needed = description.item_capacity
        if slots is not None and slots < needed:
            raise ValueError(f"slots must be at least {needed}, the most items a box can have here, not {slots}")
        self._shape = (BOX_COUNT, slots or needed)

    def new_spaces(self) -> Spaces:
        low = [-MARGIN, -MARGIN, EMPTY, EMPTY, EMPTY]
        high = [BOX_SIDE + MARGIN, BOX_SIDE + MARGIN, max(Shape), max(Colour), max(Size)]
        lows, highs = (np.broadcast_to(np.array(each, np.int16), (*self._shape, len(each))) for each in (low, high))
        return {ITEMS: spaces.Box(lows, highs, dtype=np.int16), PRESENT: spaces.Box(0, 1, self._shape, np.int8)}

    def new_values(self, observations: Batches, state: EnvState) -> Batches:
        items = state.items
        if missing := self._shape[1] - items.shape[2]:
            items = np.pad(items, ((0, 0), (0, 0), (0, missing), (0, 0)), constant_values=EMPTY)
        return {ITEMS: items, PRESENT: (items[..., -1] != EMPTY).astype(np.int8)}


class StructuredObservation(EnvWrapper[Items]):
    """Replaces "image" by an item array.

    "item_array": int16 (3, C, 5), by box, left to right, each item's x, y (pixels from the box's top-left corner),
    shape, colour and size, in the order added, -1 in empty slots. C, the most items a box can have, depends on the
    split and the horizon. "present": int8 (3, C), 1 for filled slots.

    Args:
        env: The environment to wrap.
        keep_image: Keep "image" as well.
        slots: A larger C.
    """

    transformation_class = Items

    def __init__(self, env: GymEnv, *, keep_image: bool = False, slots: int | None = None) -> None:
        super().__init__(env, keep_image=keep_image, slots=slots)


OCCUPANCY = len(Shape) + len(Colour) + len(Size)  # index of the last plane
PLANE_COUNT = OCCUPANCY + 1

_FIRST_PLANES = np.array([0, len(Shape), len(Shape) + len(Colour)])  # first plane of shape, colour and size
_SIDES = np.array(SIZE_PIXELS)
_CORNER_SIGNS = (1, -1, -1, 1)


class Planes(SceneFormat):
    """Item counts by shape, colour and size, and an occupancy plane."""

    def __init__(self, description: EnvDescription, *, keep_image: bool) -> None:
        super().__init__(description, keep_image=keep_image)
        self.columns, self.rows = grid = description.dynamics.appearance.grid or RELEASED_GRID
        self._cell = np.array(cell_size(grid))

    def new_spaces(self) -> Spaces:
        high = np.full((PLANE_COUNT, self.rows, self.columns), self.env_description.item_capacity, np.uint8)
        high[OCCUPANCY] = 1
        return {PLANES: spaces.Box(np.zeros_like(high), high, dtype=np.uint8)}

    def new_values(self, observations: Batches, state: EnvState) -> Batches:
        items = state.items
        batch, box, slot = np.nonzero(items[..., -1] != EMPTY)
        here = items[batch, box, slot].astype(np.int64)  # (items, 5)
        sides = _SIDES[here[:, 4]]
        corners = here[:, :2] + np.stack([box * BOX_PITCH, np.zeros_like(box)], axis=1)  # (items, 2) on the image
        planes = self._count_planes(len(items), batch, here[:, 2:], self._cells(corners + sides[:, None] // 2))
        first = self._cells(corners)
        last = self._cells(corners + sides[:, None] - 1)
        planes[:, OCCUPANCY] = self._occupancy(len(items), batch, first, last)
        return {PLANES: planes}

    def _cells(self, pixels: Int64Array) -> Int64Array:
        """(items, 2) column and row of each pixel, clipped to the grid."""
        return np.clip(pixels // self._cell, 0, [self.columns - 1, self.rows - 1])

    def _count_planes(self, size: int, batch: Int64Array, item_types: Int64Array, cells: Int64Array) -> UInt8Array:
        """(size, planes, rows, columns) numbers of items of each shape, colour and size centred in each cell."""
        shape = (size, PLANE_COUNT, self.rows, self.columns)
        column = cells[:, :1]
        row = cells[:, 1:]
        indices = (
            (batch[:, None] * PLANE_COUNT + _FIRST_PLANES + item_types) * self.rows + row
        ) * self.columns + column
        return np.bincount(indices.ravel(), minlength=math.prod(shape)).astype(np.uint8).reshape(shape)

    def _occupancy(self, size: int, batch: Int64Array, first: Int64Array, last: Int64Array) -> BoolArray:
        """(size, rows, columns) the cells that overlap an item's bounding square."""
        # Summed-area trick: +1 and -1 at each rectangle's corners; cumulative sums along both axes fill it.
        shape = (size, self.rows + 1, self.columns + 1)
        rows = np.stack([first[:, 1], first[:, 1], last[:, 1] + 1, last[:, 1] + 1])
        columns = np.stack([first[:, 0], last[:, 0] + 1, first[:, 0], last[:, 0] + 1])
        indices = (batch * shape[1] + rows) * shape[2] + columns
        signs = np.repeat(_CORNER_SIGNS, len(batch))
        corners = np.bincount(indices.ravel(), signs, math.prod(shape)).reshape(shape)
        return corners.cumsum(1).cumsum(2)[:, :-1, :-1] > 0.5


class GridPlanes(EnvWrapper[Planes]):
    """Replaces "image" by "planes": uint8 (10, rows, columns) over Scatter's grid, 5 x 19 for Tower.

    Planes 0 .. 2 count the circles, squares and triangles centred in each cell, 3 .. 5 the yellow, black and blue
    items, 6 .. 8 the small, medium and large ones. Plane 9 is 1 where an item's bounding square overlaps the cell.

    Args:
        env: The environment to wrap.
        keep_image: Keep "image" as well.
    """

    transformation_class = Planes

    def __init__(self, env: GymEnv, *, keep_image: bool = False) -> None:
        super().__init__(env, keep_image=keep_image)


class Channels(Format):
    """Moves the image's last axis to the front."""

    def new_spaces(self) -> Spaces:
        shape = cast("spaces.Box", self.env_description.part(IMAGE)).shape
        return {IMAGE: spaces.Box(0, 255, (shape[-1], *shape[:-1]), np.uint8)}

    def new_values(self, observations: Batches, state: EnvState) -> Batches:
        return {IMAGE: np.moveaxis(observations[IMAGE], -1, 1)}


class ChannelsFirst(EnvWrapper[Channels]):
    """Turns "image" from (height, width, 3) into (3, height, width), a view of the same pixels.

    Args:
        env: The environment to wrap.
    """

    transformation_class = Channels


class Image(Transformation):
    """Drops everything but the image."""

    changes_observations = True

    def observation_space(self) -> AnySpace:
        return self.env_description.part(IMAGE)

    def observations(self, observations: Batches, state: EnvState) -> Batch:
        return observations[IMAGE]


class ImageObservation(EnvWrapper[Image]):
    """Replaces the observation by "image" alone, for policies that take one image, such as SB3's "CnnPolicy".

    The statement and the target are left out, so that the agent does not see its task: a baseline at best.
    """

    transformation_class = Image


class Tokens(Format):
    """Replaces the statement by token ids, looked up by task."""

    def __init__(
        self, description: EnvDescription, *, vocabulary: VocabularyOrPath | None, length: int | None, truncate: bool
    ) -> None:
        super().__init__(description)
        description.part(STATEMENT)
        self.arrays = StatementArrays(description.tasks, vocabulary, length, truncate=truncate)

    def new_spaces(self) -> Spaces:
        return {STATEMENT: TokenSpace(self.arrays)}

    def new_values(self, observations: Batches, state: EnvState) -> Batches:
        return {STATEMENT: state.by_task(self.arrays.rows, lambda task: self.arrays.row(task.statement))}


class TokenizedStatement(EnvWrapper[Tokens]):
    """Replaces "statement" by token ids, int64 (length,): 0 is padding, 1 any unknown word.

    Args:
        env: The environment to wrap.
        vocabulary: A Vocabulary or the path of a saved one; None: the words of the corpus's train split.
        length: Number of ids; None: the longest statement of the train split and a quarter more.
        truncate: Cut longer statements.

    Raises:
        ValueError: If a statement of the environment's tasks is longer, unless `truncate`.
    """

    transformation_class = Tokens

    def __init__(
        self,
        env: GymEnv,
        vocabulary: VocabularyOrPath | None = None,
        length: int | None = None,
        *,
        truncate: bool = False,
    ) -> None:
        super().__init__(env, vocabulary=fixed_path(vocabulary), length=length, truncate=truncate)

    @property
    def vocabulary(self) -> Vocabulary:
        """The words that token ids stand for."""
        return self.transformation.arrays.vocabulary


Encoder = Any  # a function of a statement that returns D numbers, or an object with sentence-transformers' `encode`


class Embedding(Format):
    """Replaces the statement by its embedding, cached by statement."""

    def __init__(self, description: EnvDescription, *, encoder: Encoder, limit: float) -> None:
        super().__init__(description)
        self._limit = limit
        description.part(STATEMENT)
        if isinstance(encoder, str) or not (hasattr(encoder, "encode") or callable(encoder)):
            raise ValueError(f"encoder must be a function of a statement or have an encode method, not {encoder!r}")
        self._encoder = encoder
        self._by_statement: dict[str, Float32Array] = {}
        self._statements = np.array([task.statement for task in description.tasks], object)
        first = self._encode(description.tasks[0].statement)
        if first.ndim != 1 or not first.size:
            raise ValueError(f"encoder must return a vector, not an array of shape {first.shape}")
        self.dimension = first.size

    def new_spaces(self) -> Spaces:
        return {STATEMENT: spaces.Box(-self._limit, self._limit, (self.dimension,), np.float32)}

    def new_values(self, observations: Batches, state: EnvState) -> Batches:
        statements = state.by_task(self._statements, lambda task: task.statement)
        return {STATEMENT: np.stack([self._embedding(statement) for statement in statements])}

    def _embedding(self, statement: str) -> Float32Array:
        if statement not in self._by_statement:
            vector = self._encode(statement)
            if vector.shape != (self.dimension,):
                raise ValueError(
                    f"encoder returned an array of shape {vector.shape} for {statement!r}, not ({self.dimension},)"
                )
            if not (np.abs(vector) <= self._limit).all():
                raise ValueError(f"encoder returned values beyond limit={self._limit} for {statement!r}: {vector}")
            self._by_statement[statement] = vector
        return self._by_statement[statement]

    def _encode(self, statement: str) -> Float32Array:
        encoder = self._encoder
        vector = encoder.encode([statement])[0] if hasattr(encoder, "encode") else encoder(statement)
        return np.asarray(vector, np.float32)


class StatementEmbedding(EnvWrapper[Embedding]):
    """Replaces "statement" by the encoder's embedding, float32 (D,), computed once per statement.

    The wrapped environment's spec holds the encoder object, so it cannot be converted to JSON.

    Args:
        env: The environment to wrap.
        encoder: A function from a statement to D numbers, or an object with sentence-transformers' `encode`.
        limit: The largest absolute value allowed, the bound of the space.
    """

    transformation_class = Embedding

    def __init__(self, env: GymEnv, encoder: Encoder, *, limit: float = 1000.0) -> None:
        super().__init__(env, encoder=encoder, limit=limit)


STEPS_LEFT = "steps_left"  # observation key


class Countdown(Format):
    """The horizon minus the steps taken."""

    def new_spaces(self) -> Spaces:
        return {STEPS_LEFT: spaces.Discrete(self.env_description.dynamics.horizon + 1)}

    def new_values(self, observations: Batches, state: EnvState) -> Batches:
        return {STEPS_LEFT: self.env_description.dynamics.horizon - state.steps}


class StepsLeft(EnvWrapper[Countdown]):
    """Adds "steps_left", 0 .. horizon: a part of the Markov state that observations lack.

    Args:
        env: The environment to wrap.
    """

    transformation_class = Countdown


class Flattening(Transformation):
    """Concatenates all parts to one vector."""

    changes_observations = True

    def observation_space(self) -> spaces.Box:
        """Raises WrongEnvironment for parts that are not numeric."""
        for name, space in self.env_description.parts().items():
            if not isinstance(space, spaces.Box | spaces.Discrete):
                raise WrongEnvironment(
                    f"{self.env_description.wrapper} needs numeric parts, but {name!r} is {space};"
                    f" for a statement apply TokenizedStatement or StatementEmbedding first"
                )
        return flat_space(cast("spaces.Dict", self.env_description.observation_space))

    def observations(self, observations: Batches, state: EnvState) -> Batch:
        parts = self.env_description.parts().items()
        return np.concatenate([_rows(space, observations[name]) for name, space in parts], axis=1)


def _rows(space: AnySpace, values: Batch) -> Float32Array:
    """(B, size) the flattened values of one part."""
    if isinstance(space, spaces.Discrete):
        return (values[:, None] == np.arange(space.n)).astype(np.float32)
    return values.reshape(len(values), -1).astype(np.float32)


class FlatObservation(EnvWrapper[Flattening]):
    """Flattens the observation to one float32 vector: the parts in alphabetical order, Discrete ones one-hot. Image
    values and token ids keep their scale.

    Args:
        env: The environment to wrap.

    Raises:
        WrongEnvironment: For a text statement.
    """

    transformation_class = Flattening
