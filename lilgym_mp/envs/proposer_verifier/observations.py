"""Games with the observations of both agents.

Every part of an observation is an array or a NumPy scalar, because PettingZoo's API test refuses strings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from lilgym_mp.corpus.tokens import words
from lilgym_mp.envs.observation import image_space, item_array
from lilgym_mp.envs.proposer_verifier.game import Game
from lilgym_mp.envs.proposer_verifier.game_arrays import GameArrays, Indices
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, NO_CHOICE, PROPOSER, STOP_ACTION, VERIFIER, Role
from lilgym_mp.envs.proposer_verifier.rewards import Intent
from lilgym_mp.envs.sampling import checked_task, naming
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import BOX_COUNT, BOX_SIDE, IMAGE_WIDTH, Item, Scene
from lilgym_mp.scene.arrays import AnyDict, UInt8Array
from lilgym_mp.scene.render import draw

PARTS = "observation"
MASK = "action_mask"
IMAGE = "image"
AgentObservation = AnyDict  # {"observation": {key: array}, "action_mask": int8 (actions,)}


@dataclass(frozen=True, eq=False)
class Part:
    """One entry of an observation."""

    space: spaces.Space[Any]
    encode: Callable[[Indices], Any]  # the values in these games: a new array, or a scalar


Parts = dict[str, Part]  # by key


class ObservedGames(GameArrays):
    """Games with the observations of both agents. A part that both see is one shared object."""

    def __init__(self, game: Game, num_games: int) -> None:
        super().__init__(game, num_games)
        slots = len(self._released_array(STOP_ACTION))
        self._released_space = _box(NO_CHOICE, IMAGE_WIDTH - 1, slots)
        count = game.dynamics.appearance.action_count
        self._released_table = np.full((count + 1, slots), NO_CHOICE)  # by action; the last row is NO_CHOICE's
        self._is_new = np.arange(count + 1) < count  # by action, whether it has not occurred
        self._values: dict[str, NDArray[Any]] = {}  # by part, of tasks by index, the last of a caller's task
        made: dict[Any, Part] = {}
        proposer, verifier = (
            {key: made.setdefault((key, kind), part) for key, kind, part in self._parts_of(role)} for role in Role
        )
        if game.settings.homogeneous:
            proposer, verifier = _padded(proposer, verifier, PROPOSER), _padded(verifier, proposer, VERIFIER)
        self.parts = (proposer, verifier)  # indexed by role
        self._distinct = [*dict.fromkeys([*proposer.values(), *verifier.values()])]

    def observe(self, role: Role, indices: Indices) -> AgentObservation:
        """An agent's observation of games `indices`."""
        parts = {key: part.encode(indices) for key, part in self.parts[role].items()}
        return {PARTS: parts, MASK: self.masks(role, indices)}

    def observe_both(self, indices: Indices, *, copy: bool = True) -> dict[str, AgentObservation]:
        """Both agents' observations, which share the arrays of parts that both see.

        `copy=False`: of all games; the images are `images` itself.
        """
        encoded = {
            part: part.encode(indices) if copy or part.encode != self._images else self.images
            for part in self._distinct
        }
        proposer, verifier = ({key: encoded[part] for key, part in parts.items()} for parts in self.parts)
        return {
            AGENTS[PROPOSER]: {PARTS: proposer, MASK: self.masks(PROPOSER, indices)},
            AGENTS[VERIFIER]: {PARTS: verifier, MASK: self.masks(VERIFIER, indices)},
        }

    def index_of(self, choice: object) -> int:
        """The index of a task in play: an id's, or a `Task`'s, which it has until the next one is chosen.

        Raises ValueError for an unknown id, and for a task that cannot be played or shown.
        """
        tasks = self.game.tasks
        if not isinstance(choice, Task):
            return tasks.index_of(choice)
        if (index := tasks.find(choice)) is not None:
            return index
        checked_task(choice, self.game.dynamics, self.game.sizes.item_capacity)
        with naming(choice):
            values = {name: self._value_of(name, choice.statement, choice.target) for name in self._values}
        for name, value in values.items():
            self._values[name][-1] = value
        self._core.set_task(len(tasks), choice)
        return len(tasks)

    # The parts

    def _parts_of(self, role: Role) -> Iterator[tuple[str, Any, Part]]:
        """Key, kind and part of what an agent sees; parts of one key and kind are equal."""
        game = self.game
        sizes = self.game.sizes
        view = game.views[role]
        if view.scene != "none":
            # SB3 uses the keys in a torch ModuleDict, so a key must not be the name of one of its methods ("items").
            key, space, encode, encode_scene = {
                "image": (IMAGE, image_space(game.settings.image_size), self._images, self._image_of),
                "structured": ("item_array", item_array_space(sizes.item_capacity), self.item_arrays, self._items_of),
            }[view.scene]
            yield key, None, Part(space, encode)
            if view.proposed_scene and game.turn_based:
                yield f"proposed_{key}", None, Part(space, partial(self._proposed, encode, encode_scene))
        if view.statement == "tokens":
            highest = len(sizes.vocabulary) - 1
            yield "statement", "tokens", self._of_task("tokens", _box(0, highest, sizes.statement_length))
        elif view.statement == "text":
            yield "statement", "text", self._of_task("text", spaces.Box(0, 255, (sizes.max_statement_bytes,), np.uint8))
        if view.target:
            yield "target", None, self._of_task("target", spaces.Discrete(2))
        if view.proposal and game.turn_based:
            yield "proposal", None, Part(self._released_space, partial(self._released, "proposals"))
        if view.refused and game.has_refusals:
            yield "refused", None, Part(self._released_space, partial(self._released, "refused"))
        if view.history:
            largest = max(IMAGE_WIDTH - 1, game.choices[VERIFIER].stop - 1, *game.message_sizes)
            turns = _box(NO_CHOICE, largest, view.history, *(size + 3 for size in self._released_space.shape))
            yield "history", view.history, Part(turns, partial(self._past, view.history))
        if game.message_sizes[role.other]:
            size = max(game.message_sizes) if game.settings.homogeneous else game.message_sizes[role.other]
            yield "message", role, Part(spaces.Discrete(size + 1), partial(self._messages, role.other))
        if role is PROPOSER and game.draws_intent:
            yield "intent", None, Part(spaces.Discrete(len(Intent)), self._intents)

    # Encoders, named after what they give

    def _images(self, indices: Indices) -> Any:
        return self.images.take(indices, axis=0)

    def _image_of(self, scene: Scene) -> UInt8Array:
        return draw(scene, self.game.settings.image_size)

    def item_arrays(self, indices: Indices) -> Any:
        """(..., 3, capacity, 5)"""
        return self.items().take(indices, axis=0)

    def _items_of(self, scene: Scene) -> NDArray[Any]:
        return item_array(scene, self.game.sizes.item_capacity)

    def proposed_item_arrays(self, indices: Indices) -> Any:
        """(..., 3, capacity, 5) after the pending proposals"""
        return self._proposed(self.item_arrays, self._items_of, indices)

    def _proposed(
        self, encode: Callable[[Indices], Any], encode_scene: Callable[[Scene], NDArray[Any]], indices: Indices
    ) -> Any:
        """The scenes after the pending proposals, encoded as the current ones are."""
        if isinstance(indices, int):
            return self._proposed(encode, encode_scene, np.array([indices]))[0]
        encoded = encode(indices)
        for row in np.flatnonzero(self.proposals[indices] > STOP_ACTION).tolist():
            encoded[row] = encode_scene(self.proposed_scene(int(indices[row])))
        return encoded

    def _of_task(self, name: str, space: spaces.Space[Any]) -> Part:
        """A part that depends only on the task."""
        if name not in self._values:
            value_of = cache(partial(self._value_of, name))
            values = [value_of(task.statement, task.target) for task in self.game.tasks]
            self._values[name] = np.array([*values, values[0]], space.dtype)
        return Part(space, partial(self._by_task, name))

    def _by_task(self, name: str, indices: Indices) -> Any:
        return self._values[name].take(self.tasks[indices], axis=0)

    def _value_of(self, name: str, statement: str, target: bool) -> Any:
        """Raises ValueError for a statement that does not fit the space."""
        sizes = self.game.sizes
        if name == "target":
            return target
        if name == "text":
            return as_bytes(statement, sizes.max_statement_bytes)
        length = sizes.statement_length
        count = len(words(statement))
        if count > length:
            raise ValueError(f"its statement has {count} words, and observations have room for {length}")
        return sizes.vocabulary.encode(statement, length)

    def _released_array(self, action: int) -> list[int]:
        appearance = self.game.dynamics.appearance
        return appearance.to_array(appearance.decode(action))

    def _released_arrays(self, actions: Any) -> NDArray[Any]:
        """(..., slots) the released form of actions (...), found for each when it first occurs."""
        is_new = self._is_new[actions]
        if is_new.any() if is_new.ndim else is_new:
            for action in np.unique(actions).tolist():
                if action != NO_CHOICE:
                    self._released_table[action] = self._released_array(action)
                    self._is_new[action] = False
        return self._released_table.take(actions, axis=0)

    def _released(self, name: str, indices: Indices) -> Any:
        """The proposals of the attribute `name` in the released array form."""
        return self._released_arrays(getattr(self, name)[indices])

    def _past(self, turns: int, indices: Indices) -> Any:
        past = self.history[indices, -turns:]
        return np.concatenate([self._released_arrays(past[..., 0]), past[..., 1:]], axis=-1)

    def _messages(self, sender: Role, indices: Indices) -> Any:
        return self.messages[sender, indices]

    def _intents(self, indices: Indices) -> Any:
        return self.intents[indices]


def _padded(own: Parts, others: Parts, role: Role) -> Parts:
    """An agent's own parts, placeholders for the other agent's, and "agent", its own index."""
    padded: Parts = {"agent": _constant(spaces.Discrete(len(Role)), role)}
    for key in sorted(own.keys() | others.keys()):
        if key in own and key in others and own[key].space != others[key].space:
            raise ValueError(
                f"homogeneous agents need equal spaces for {key!r}, not {own[key].space} and {others[key].space}:"
                " give both the same view, or leave it out of one"
            )
        padded[key] = own[key] if key in own else _constant(others[key].space, 0)
    return padded


def _constant(space: spaces.Space[Any], value: int) -> Part:
    """An agent's index, or a placeholder for a part that only the other agent has."""
    return Part(space, partial(_constants, space, value))


def _constants(space: spaces.Space[Any], value: int, indices: Indices) -> Any:
    return np.full((*np.shape(indices), *(space.shape or ())), value, space.dtype)[()]


def _box(low: int, high: int, *shape: int) -> spaces.Box:
    return spaces.Box(low, high, shape, np.int64)


def item_array_space(capacity: int) -> spaces.Box:
    """x, y, shape, colour and size of each item by box, -1 in empty slots."""
    return spaces.Box(-BOX_SIDE, BOX_SIDE, (BOX_COUNT, capacity, len(Item._fields)), np.int16)


def as_bytes(text: str, length: int) -> UInt8Array:
    """(length,) the text in UTF-8, padded with zeros; `read_text` decodes it. Raises ValueError for a longer text."""
    array = np.zeros(length, np.uint8)
    encoded = text.encode()
    if len(encoded) > length:
        raise ValueError(f"its statement has {len(encoded)} bytes, and observations have room for {length}")
    array[: len(encoded)] = np.frombuffer(encoded, np.uint8)
    return array


def read_text(array: UInt8Array) -> str:
    """Decodes a text part of an observation.

    Args:
        array: uint8 (length,), UTF-8 padded with zeros.

    Returns:
        The text.
    """
    return array.tobytes().rstrip(b"\0").decode()
