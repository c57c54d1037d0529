"""The parts of each agent's observation, and games with observations.

Every part is an array or a NumPy scalar, because PettingZoo's API test refuses strings in observations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from lilgym_mp.corpus.tokens import words
from lilgym_mp.envs.observation import image_space, item_array
from lilgym_mp.envs.proposer_verifier.game import Game
from lilgym_mp.envs.proposer_verifier.game_arrays import GameArrays
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, NO_CHOICE, PROPOSER, STOP_ACTION, VERIFIER, Role
from lilgym_mp.envs.proposer_verifier.rewards import Intent
from lilgym_mp.envs.proposer_verifier.settings import GameSetup
from lilgym_mp.envs.sampling import checked_task, naming
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import BOX_COUNT, BOX_SIDE, IMAGE_WIDTH, Item, Scene
from lilgym_mp.scene.arrays import Int64Array, UInt8Array
from lilgym_mp.scene.render import Canvas

Value = NDArray[Any] | np.integer[Any]
Indices = int | Int64Array  # of one game, or (k,) of several: their values have the leading axis (k,)

PARTS, MASK = "observation", "action_mask"  # keys of an AgentObservation
AgentObservation = dict[str, Any]  # {"observation": {key: array}, "action_mask": int8 (actions,)}

BOX_TITLES = ("left", "middle", "right")


class Part:
    """One entry of an observation."""  # not an ABC, whose `isinstance` is slow

    space: spaces.Space[Any]

    def encode(self, games: GameArrays, indices: Indices) -> Any:
        """A new array, or a scalar: the values in games `indices`."""
        raise NotImplementedError


class ScenePart(Part):
    """An encoding of the current scene."""

    def encode_scene(self, scene: Scene) -> NDArray[Any]:
        """A new array."""
        raise NotImplementedError


class ImagePart(ScenePart):
    """uint8 (50, 190, 3), or (100, 380, 3) at native size."""

    def __init__(self, setup: GameSetup) -> None:
        self.space = image_space(setup.image_size)
        self._canvas = Canvas(setup.image_size)

    def encode_scene(self, scene: Scene) -> NDArray[Any]:
        return self._canvas.show(scene).copy()

    def encode(self, games: GameArrays, indices: Indices) -> Any:
        return games.images.take(indices, axis=0)


class ItemArrayPart(ScenePart):
    """int16 (3, capacity, 5): x, y, shape, colour and size of each item by box, -1 in empty slots."""

    def __init__(self, setup: GameSetup) -> None:
        self._capacity = setup.item_capacity
        self.space = spaces.Box(-BOX_SIDE, BOX_SIDE, (BOX_COUNT, self._capacity, len(Item._fields)), np.int16)

    def encode_scene(self, scene: Scene) -> NDArray[Any]:
        return item_array(scene, self._capacity)

    def encode(self, games: GameArrays, indices: Indices) -> Any:
        return games.items().take(indices, axis=0)


MAX_ITEM_TEXT = len("medium triangle yellow at (-100, -100), ")


class SceneTextPart(ScenePart):
    """`scene_text` as bytes."""

    def __init__(self, setup: GameSetup) -> None:
        self._length = BOX_COUNT * (setup.item_capacity * MAX_ITEM_TEXT + len("middle: empty\n"))
        self.space = byte_space(self._length)

    def encode_scene(self, scene: Scene) -> NDArray[Any]:
        return as_bytes(scene_text(scene), self._length)

    def encode(self, games: GameArrays, indices: Indices) -> Any:
        if isinstance(indices, int):
            return self.encode_scene(games.mdp(indices).scene)
        return np.stack([self.encode(games, index) for index in indices.tolist()])


class ProposedScenePart(Part):
    """The scene after the pending proposal, encoded as the current one is."""

    def __init__(self, setup: GameSetup, current: ScenePart) -> None:
        self.space = current.space
        self._current = current

    def encode(self, games: GameArrays, indices: Indices) -> Any:
        if isinstance(indices, int) and games.proposals[indices] > STOP_ACTION:
            return self._current.encode_scene(games.proposed_scene(indices))
        encoded = self._current.encode(games, indices)
        if not isinstance(indices, int):
            for row in np.flatnonzero(games.proposals[indices] > STOP_ACTION).tolist():
                encoded[row] = self.encode(games, int(indices[row]))
        return encoded


def scene_text(scene: Scene) -> str:
    """One line per box, such as "left: medium yellow square at (40, 80)"; pixels from the box's top-left corner."""
    boxes = zip(BOX_TITLES, scene.boxes, strict=True)
    return "\n".join(f"{title}: {', '.join(map(item_text, box.items)) or 'empty'}" for title, box in boxes)


def item_text(item: Item) -> str:
    size, colour, shape = (member.name.lower() for member in (item.size, item.colour, item.shape))
    return f"{size} {colour} {shape} at ({item.x}, {item.y})"


class LazyTable:
    """A table of values by key 0 .. count - 1, each computed when it is first needed; the default has key -1."""

    def __init__(self, count: int, space: spaces.Space[Any], value_of: Callable[[int], Any], default: int = 0) -> None:
        """`value_of`: gives the value of a key; `default`: fills the value of key -1."""
        self._values = np.full((count + 1, *(space.shape or ())), default, space.dtype)
        self._is_known = np.arange(count + 1) == count
        self._unknown = count
        self._value_of = value_of

    def take(self, keys: Any) -> Any:
        """(..., *shape) a new array: the values of keys (...)."""
        if self._unknown:
            is_known = self._is_known[keys]
            if not (is_known.all() if is_known.ndim else is_known):
                self.fill(np.unique(keys))
        return self._values.take(keys, axis=0)

    def fill(self, keys: Int64Array) -> None:
        """Computes the values of distinct keys (k,)."""
        for key in keys[~self._is_known[keys]].tolist():
            self.set(key, self._value_of(key))

    def set(self, key: int, value: Any) -> None:
        self._unknown -= not self._is_known[key]
        self._values[key], self._is_known[key] = value, True


class TaskPart(Part):
    """A value that depends only on the task."""

    def __init__(self, setup: GameSetup, space: spaces.Space[Any]) -> None:
        self.space = space
        self._setup = setup
        self.values = LazyTable(len(setup.tasks) + 1, space, self._value_at)  # by index; the last is a caller's task's
        self._is_filled = False  # for batches

    def value_of(self, task: Task) -> Any:
        """Raises ValueError if it does not fit the space."""
        raise NotImplementedError

    def _value_at(self, index: int) -> Any:
        return self.value_of(self._setup.tasks[index])

    def encode(self, games: GameArrays, indices: Indices) -> Any:
        if not self._is_filled and not isinstance(indices, int):
            self.values.fill(np.arange(len(self._setup.tasks)))
            self._is_filled = True
        return self.values.take(games.tasks[indices])


class TokensPart(TaskPart):
    """int64 (length,): the statement's token ids in `GameSetup.vocabulary`, padded with 0."""

    def __init__(self, setup: GameSetup) -> None:
        super().__init__(setup, spaces.Box(0, len(setup.vocabulary) - 1, (setup.statement_length,), np.int64))

    def value_of(self, task: Task) -> Any:
        length, count = self._setup.statement_length, len(words(task.statement))
        if count > length:
            raise ValueError(f"its statement has {count} words, and observations have room for {length}")
        return self._setup.vocabulary.encode(task.statement, length)


class StatementTextPart(TaskPart):
    """The statement as bytes."""

    def __init__(self, setup: GameSetup) -> None:
        super().__init__(setup, byte_space(setup.max_statement_bytes))

    def value_of(self, task: Task) -> Any:
        return as_bytes(task.statement, self._setup.max_statement_bytes)


class TargetPart(TaskPart):
    """0 or 1."""

    def __init__(self, setup: GameSetup) -> None:
        super().__init__(setup, spaces.Discrete(2))

    def value_of(self, task: Task) -> Any:
        return task.target


def byte_space(length: int) -> spaces.Box:
    return spaces.Box(0, 255, (length,), np.uint8)


def as_bytes(text: str, length: int) -> UInt8Array:
    """(length,) the text in UTF-8, padded with zeros; `read_text` decodes it. Raises ValueError for a longer text."""
    array = np.zeros(length, np.uint8)
    encoded = text.encode()
    if len(encoded) > length:
        raise ValueError(f"its statement has {len(encoded)} bytes, and observations have room for {length}")
    array[: len(encoded)] = np.frombuffer(encoded, np.uint8)
    return array


def read_text(array: UInt8Array) -> str:
    """Decodes a text part of an observation."""
    return array.tobytes().rstrip(b"\0").decode()


class ReleasedArrays(LazyTable):
    """The released array form of the MDP's actions, by action index; all -1 for NO_CHOICE."""

    def __init__(self, game: Game) -> None:
        self._appearance = game.config.dynamics.appearance
        self.slots = len(self.to_array(0))
        self.space = spaces.Box(NO_CHOICE, IMAGE_WIDTH - 1, (self.slots,), np.int64)
        super().__init__(self._appearance.action_count, self.space, self.to_array, NO_CHOICE)

    def to_array(self, action: int) -> list[int]:
        return self._appearance.to_array(self._appearance.decode(action))


class ProposalPart(Part):
    """int64 (slots,): a proposal in the released array form; all -1 if there is none."""

    def __init__(self, setup: GameSetup, name: str) -> None:
        """`name`: of its attribute in `GameArrays`."""
        self._arrays = ReleasedArrays(setup.game)
        self.space = self._arrays.space
        self._name = name

    def encode(self, games: GameArrays, indices: Indices) -> Any:
        return self._arrays.take(getattr(games, self._name)[indices])


class HistoryPart(Part):
    """int64 (turns, slots + 3): proposal in the released array form, answer, both messages; newest last, -1 padding."""

    def __init__(self, setup: GameSetup, turns: int) -> None:
        self._arrays = ReleasedArrays(setup.game)
        self._turns = turns
        largest = max(IMAGE_WIDTH - 1, setup.game.choices[Role.VERIFIER].stop - 1, *setup.game.message_sizes)
        self.space = spaces.Box(NO_CHOICE, largest, (turns, self._arrays.slots + 3), np.int64)

    def encode(self, games: GameArrays, indices: Indices) -> Any:
        past = games.history[indices, -self._turns :]
        return np.concatenate([self._arrays.take(past[..., 0]), past[..., 1:]], axis=-1)


class NumberPart(Part):
    """A number of the state: the other agent's last message, 0 if it was silent, or the proposer's intent."""

    def __init__(self, setup: GameSetup, size: int, name: str, role: Role | None = None) -> None:
        """`name`: of its attribute in `GameArrays`; `role`: whose number it is, if both have one."""
        self.space = spaces.Discrete(size)
        self._name, self._role = name, role

    def encode(self, games: GameArrays, indices: Indices) -> Any:
        numbers = getattr(games, self._name)
        return numbers[indices] if self._role is None else numbers[self._role, indices]


class ConstantPart(Part):
    """A constant: the agent's own index, or a placeholder for a part that only the other agent has."""

    def __init__(self, space: spaces.Space[Any], value: int) -> None:
        self.space = space
        self._value = value

    def encode(self, games: GameArrays, indices: Indices) -> Any:
        return np.full((*np.shape(indices), *(self.space.shape or ())), self._value, self.space.dtype)[()]


# By view: observation key and part. SB3 uses the keys in a torch ModuleDict, so a key must not be the name of one of
# its methods, such as "items".
SCENE_PARTS: Mapping[str, tuple[str, Callable[[GameSetup], ScenePart]]] = {
    "image": ("image", ImagePart),
    "structured": ("item_array", ItemArrayPart),
    "text": ("text", SceneTextPart),
}
STATEMENT_PARTS: Mapping[str, Callable[[GameSetup], Part]] = {"tokens": TokensPart, "text": StatementTextPart}

Parts = dict[str, Part]  # by key


def make_parts(setup: GameSetup) -> tuple[Parts, Parts]:
    """Both agents' parts, by Role. A part that both see is one shared object."""

    @cache
    def make(build: Callable[..., Part], *arguments: Any) -> Part:
        return build(setup, *arguments)

    proposer, verifier = (_parts_of(setup, role, make) for role in Role)
    if setup.game.homogeneous:
        return _padded(proposer, verifier, Role.PROPOSER), _padded(verifier, proposer, Role.VERIFIER)
    return proposer, verifier


def _parts_of(setup: GameSetup, role: Role, make: Callable[..., Part]) -> Parts:
    """An agent's parts; `make`: called with a class of parts and its arguments."""
    view, game = setup.views[role], setup.game
    parts: Parts = {}
    if view.scene in SCENE_PARTS:
        key, build = SCENE_PARTS[view.scene]
        parts[key] = make(build)
        if view.proposed_scene and game.turn_based:
            parts[f"proposed_{key}"] = make(ProposedScenePart, parts[key])
    if view.statement in STATEMENT_PARTS:
        parts["statement"] = make(STATEMENT_PARTS[view.statement])
    if view.target:
        parts["target"] = make(TargetPart)
    if view.proposal and game.turn_based:
        parts["proposal"] = make(ProposalPart, "proposals")
    if view.refused and game.has_refusals:
        parts["refused"] = make(ProposalPart, "refused")
    if view.history:
        parts["history"] = make(HistoryPart, view.history)
    if game.message_sizes[role.other]:
        size = max(game.message_sizes) if game.homogeneous else game.message_sizes[role.other]
        parts["message"] = make(NumberPart, size + 1, "messages", role.other)
    if role is Role.PROPOSER and game.rewards.draws_intent:
        parts["intent"] = make(NumberPart, len(Intent), "intents")
    return parts


def _padded(own: Parts, others: Parts, role: Role) -> Parts:
    """An agent's own parts, placeholders for the other agent's, and "agent", its own index."""
    for key in own.keys() & others.keys():
        if own[key].space != others[key].space:
            raise ValueError(
                f"homogeneous agents need equal spaces for {key!r}, not {own[key].space} and {others[key].space}:"
                " give both the same view, or leave it out of one"
            )
    padded: Parts = {"agent": ConstantPart(spaces.Discrete(len(Role)), role)}
    for key in sorted(own.keys() | others.keys()):
        padded[key] = own[key] if key in own else ConstantPart(others[key].space, 0)
    return padded


class ObservedGames(GameArrays):
    """Games with the observations of both agents."""

    def __init__(self, setup: GameSetup, num_games: int) -> None:
        super().__init__(setup, num_games)
        self.parts = make_parts(setup)  # by Role
        proposer, verifier = self.parts
        self._shared = [key for key, part in verifier.items() if proposer.get(key) is part]
        self._verifiers = {key: part for key, part in verifier.items() if key not in self._shared}

    def index_of(self, choice: object) -> int:
        """The index of a task in play: an id's, or a `Task`'s, which it has until the next one is chosen.

        Raises ValueError for an unknown id, and for a task that cannot be played or shown.
        """
        tasks = self.setup.tasks
        if not isinstance(choice, Task):
            return tasks.index_of(choice)
        if (index := tasks.find(choice)) is not None:
            return index
        parts = {part for own in self.parts for part in own.values() if isinstance(part, TaskPart)}
        checked_task(choice, self.game.config.dynamics, self.setup.item_capacity)
        with naming(choice):
            values = [(part.values, part.value_of(choice)) for part in parts]
        for table, value in values:
            table.set(len(tasks), value)
        self._core.set_task(len(tasks), choice)
        return len(tasks)

    def observe(self, role: Role, indices: Indices) -> AgentObservation:
        """An agent's observation of games `indices`."""
        return {PARTS: self._encode(self.parts[role], indices, None), MASK: self.masks(role, indices)}

    def observe_both(self, indices: Indices, images: UInt8Array | None = None) -> dict[str, AgentObservation]:
        """Both agents' observations, which share the arrays of parts that both see.

        `images`: instead of copies of the games' images.
        """
        proposer = self._encode(self.parts[PROPOSER], indices, images)
        verifier = {key: proposer[key] for key in self._shared} | self._encode(self._verifiers, indices, images)
        return {
            AGENTS[PROPOSER]: {PARTS: proposer, MASK: self.masks(PROPOSER, indices)},
            AGENTS[VERIFIER]: {PARTS: verifier, MASK: self.masks(VERIFIER, indices)},
        }

    def _encode(self, parts: Parts, indices: Indices, images: UInt8Array | None) -> dict[str, Any]:
        return {
            key: part.encode(self, indices) if images is None or not isinstance(part, ImagePart) else images
            for key, part in parts.items()
        }
