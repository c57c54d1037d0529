"""The parts of each agent's observation: their spaces and encoders.

Every part is an array or a NumPy scalar, because PettingZoo's API test refuses strings in observations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cache, cached_property
from operator import attrgetter
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from lilgym_mp.arrays import Int64Array, UInt8Array
from lilgym_mp.choices import choose
from lilgym_mp.corpus import TaskSet, Vocabulary
from lilgym_mp.corpus.statement_arrays import default_length, training_tasks
from lilgym_mp.envs.checks import checked_count, checked_flag
from lilgym_mp.envs.proposer_verifier.game import Game, GameState
from lilgym_mp.envs.proposer_verifier.protocols import NO_CHOICE, STOP_ACTION, Role
from lilgym_mp.envs.proposer_verifier.rewards import Intent
from lilgym_mp.observation import image_space, item_array, item_capacity
from lilgym_mp.render import Canvas
from lilgym_mp.scene import BOX_COUNT, BOX_SIDE, IMAGE_WIDTH, Item, Scene

if TYPE_CHECKING:
    from lilgym_mp.envs.proposer_verifier.game_arrays import GameArrays

ViewSpec: TypeAlias = "View | str | Mapping[str, Any]"
Value = NDArray[Any] | np.integer[Any]

BOX_TITLES = ("left", "middle", "right")
TARGETS = (np.int64(0), np.int64(1))


@dataclass(frozen=True, slots=True)
class View:
    """What an agent sees. "intent" (proposer only) and "message" are added if the game has them."""

    scene: str = "image"  # "image", "structured", "text" or "none"
    statement: str = "tokens"  # "tokens", "text" or "none"
    target: bool = True
    proposal: bool = True  # the pending proposal
    proposed_scene: bool = False  # the scene after the pending proposal, in the same form as the scene
    refused: bool = True  # the proposal refused last, until an action is played
    history: int = 0  # number of past turns

    def __post_init__(self) -> None:
        """Raises ValueError naming the choices."""
        choose("scene view", self.scene, SCENE_PARTS)
        choose("statement view", self.statement, STATEMENT_PARTS)
        for name in ("target", "proposal", "proposed_scene", "refused"):
            checked_flag(f"{name} of a view", getattr(self, name))
        if self.proposed_scene and self.scene == "none":
            raise ValueError("proposed_scene of a view needs a scene view other than 'none'")
        checked_count("history of a view", self.history, least=0)


def make_view(view: ViewSpec) -> View:
    """A view from its fields or a name in VIEWS. Raises ValueError naming the choices."""
    if isinstance(view, View):
        return view
    if isinstance(view, Mapping):
        names = {field.name: field for field in fields(View)}
        for name in view:
            choose("field of a view", name, names)
        return View(**view)
    return choose("view", view, VIEWS)


@dataclass(frozen=True)
class GameSetup:
    """What stays the same from episode to episode: the game, tasks, image size and views."""

    game: Game
    tasks: TaskSet
    image_size: str
    views: tuple[View, View]  # by Role
    sneaky_share: float  # probability of a sneaky episode, if intents are drawn
    reveals_truth: bool  # in infos

    @cached_property
    def fixed_intent(self) -> Intent | None:
        """The proposer's intent if it is the same in every episode; None if it is drawn."""
        rewards = self.game.rewards
        if rewards.draws_intent:
            return None
        return Intent.SNEAKY if rewards.uses("sneaky", Role.PROPOSER) else Intent.HELPFUL

    def sample_task_index(self, rng: np.random.Generator) -> int:
        """The index of the next episode's task, uniformly drawn."""
        return int(rng.integers(len(self.tasks)))

    def sample_intent(self, rng: np.random.Generator) -> Intent:
        """The next episode's intent; uses `rng` only if intents are drawn."""
        if self.fixed_intent is not None:
            return self.fixed_intent
        return Intent.SNEAKY if rng.random() < self.sneaky_share else Intent.HELPFUL

    @cached_property
    def vocabulary(self) -> Vocabulary:
        """The words of the corpus's train split, whatever the split in play."""
        return Vocabulary.from_statements(task.statement for task in self._training_tasks)

    @cached_property
    def statement_length(self) -> int:
        """Number of token ids per statement, as in `TokenizedStatement`; the longest statement of the split fits."""
        return default_length(task.statement for tasks in (self.tasks, self._training_tasks) for task in tasks)

    @cached_property
    def _training_tasks(self) -> TaskSet:
        return training_tasks(self.tasks)

    @cached_property
    def item_capacity(self) -> int:
        """The most items a box can have."""
        return item_capacity(self.tasks, self.game.config.dynamics)

    @cached_property
    def max_statement_bytes(self) -> int:
        """UTF-8 length of the longest statement."""
        return max(len(task.statement.encode()) for task in self.tasks)


def with_tasks(setup: GameSetup, tasks: TaskSet) -> GameSetup:
    """The game with other tasks. Raises ValueError for tasks of another appearance."""
    own, given = setup.tasks.provenance.appearance, tasks.provenance.appearance
    if own != given:
        raise ValueError(f"the game is played on {own}; tasks of {given} do not fit it")
    return replace(setup, tasks=tasks)


class Part:
    """One entry of an observation, for one game and for many."""  # not an ABC, whose `isinstance` is slow

    space: spaces.Space[Any]

    def encode(self, state: GameState) -> Value:
        """The value in `state`: a new array or a scalar."""
        raise NotImplementedError

    def encode_batch(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        """(k, ...) a new array: the values in the games `indices` (k,)."""
        raise NotImplementedError


class ScenePart(Part):
    """An encoding of the current scene."""

    def encode(self, state: GameState) -> Value:
        return self.encode_scene(state.mdp.scene)

    def encode_scene(self, scene: Scene) -> Value:
        raise NotImplementedError


class ImagePart(ScenePart):
    """uint8 (50, 190, 3), or (100, 380, 3) at native size."""

    def __init__(self, setup: GameSetup) -> None:
        self.space = image_space(setup.image_size)
        self._canvas = Canvas(setup.image_size)

    def encode_scene(self, scene: Scene) -> Value:
        return self._canvas.show(scene).copy()

    def encode_batch(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        return games.images.take(indices, axis=0)


class ItemArrayPart(ScenePart):
    """int16 (3, capacity, 5): x, y, shape, colour and size of each item by box, -1 in empty slots."""

    def __init__(self, setup: GameSetup) -> None:
        self._capacity = setup.item_capacity
        self.space = spaces.Box(-BOX_SIDE, BOX_SIDE, (BOX_COUNT, self._capacity, len(Item._fields)), np.int16)

    def encode_scene(self, scene: Scene) -> Value:
        return item_array(scene, self._capacity)

    def encode_batch(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        return games.items().take(indices, axis=0)


MAX_ITEM_TEXT = len("medium triangle yellow at (-100, -100), ")


class SceneTextPart(ScenePart):
    """`scene_text` as bytes."""

    def __init__(self, setup: GameSetup) -> None:
        self._length = BOX_COUNT * (setup.item_capacity * MAX_ITEM_TEXT + len("middle: empty\n"))
        self.space = byte_space(self._length)

    def encode_scene(self, scene: Scene) -> Value:
        return as_bytes(scene_text(scene), self._length)

    def encode_batch(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        return np.stack([self.encode_scene(games.mdp(index).scene) for index in indices.tolist()])


class ProposedScenePart(Part):
    """The scene after the pending proposal, encoded as the current one is."""

    def __init__(self, setup: GameSetup, current: ScenePart) -> None:
        self.space = current.space
        self._current = current
        self._game = setup.game

    def encode(self, state: GameState) -> Value:
        return self._current.encode_scene(self._game.proposed_scene(state))

    def encode_batch(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        rows = self._current.encode_batch(games, indices)
        for row in np.flatnonzero(games.proposals[indices] > STOP_ACTION).tolist():
            rows[row] = self.encode(games.state(int(indices[row])))
        return rows


def scene_text(scene: Scene) -> str:
    """One line per box, such as "left: medium yellow square at (40, 80)"; pixels from the box's top-left corner."""
    boxes = zip(BOX_TITLES, scene.boxes, strict=True)
    return "\n".join(f"{title}: {', '.join(map(item_text, box.items)) or 'empty'}" for title, box in boxes)


def item_text(item: Item) -> str:
    size, colour, shape = (member.name.lower() for member in (item.size, item.colour, item.shape))
    return f"{size} {colour} {shape} at ({item.x}, {item.y})"


class TaskPart(Part):
    """A value that depends only on the task."""

    def __init__(self, setup: GameSetup, space: spaces.Space[Any]) -> None:
        self.space = space
        self._setup = setup

    def encode_batch(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        return self._by_task.take(games.tasks[indices], axis=0)

    @cached_property
    def _by_task(self) -> NDArray[Any]:
        """(tasks, ...) by task index."""
        return np.stack([self.encode(self._setup.game.start(task)) for task in self._setup.tasks])


class TokensPart(TaskPart):
    """int64 (length,): the statement's token ids in `GameSetup.vocabulary`, padded with 0."""

    def __init__(self, setup: GameSetup) -> None:
        super().__init__(setup, spaces.Box(0, len(setup.vocabulary) - 1, (setup.statement_length,), np.int64))
        self._cache: dict[str, NDArray[np.int64]] = {}  # by statement

    def encode(self, state: GameState) -> Value:
        statement = state.mdp.task.statement
        try:
            return self._cache[statement].copy()
        except KeyError:
            setup = self._setup
            self._cache[statement] = setup.vocabulary.encode(statement, setup.statement_length)
            return self.encode(state)


class StatementTextPart(TaskPart):
    """The statement as bytes."""

    def __init__(self, setup: GameSetup) -> None:
        super().__init__(setup, byte_space(setup.max_statement_bytes))

    def encode(self, state: GameState) -> Value:
        return as_bytes(state.mdp.task.statement, self._setup.max_statement_bytes)


class TargetPart(TaskPart):
    """0 or 1."""

    def __init__(self, setup: GameSetup) -> None:
        super().__init__(setup, spaces.Discrete(2))

    def encode(self, state: GameState) -> Value:
        return TARGETS[state.mdp.task.target]


def byte_space(length: int) -> spaces.Box:
    return spaces.Box(0, 255, (length,), np.uint8)


def as_bytes(text: str, length: int) -> UInt8Array:
    """(length,) the text in UTF-8, padded with zeros; `read_text` decodes it."""
    array = np.zeros(length, np.uint8)
    encoded = text.encode()
    array[: len(encoded)] = np.frombuffer(encoded, np.uint8)
    return array


def read_text(array: UInt8Array) -> str:
    """Decodes a text part of an observation."""
    return array.tobytes().rstrip(b"\0").decode()


class ProposalPart(Part):
    """int64 (slots,): a proposal in the released array form; all -1 if there is none."""

    def __init__(self, setup: GameSetup, of_state: str, of_games: str) -> None:
        """The names of its field in `GameState` and `GameArrays`."""
        self._arrays = ActionArrayCache(setup.game)
        self.space = spaces.Box(NO_CHOICE, IMAGE_WIDTH - 1, (self._arrays.slots,), np.int64)
        self._of_state, self._of_games = attrgetter(of_state), attrgetter(of_games)

    def encode(self, state: GameState) -> Value:
        action: int | None = self._of_state(state)
        return self._arrays[NO_CHOICE if action is None else action].copy()

    def encode_batch(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        return self._arrays.batch(self._of_games(games)[indices])


class HistoryPart(Part):
    """int64 (turns, slots + 3): proposal in the released array form, answer, both messages; newest last, -1 padding."""

    def __init__(self, setup: GameSetup, turns: int) -> None:
        self._arrays = ActionArrayCache(setup.game)
        self._shape = (turns, self._arrays.slots + 3)
        largest = max(IMAGE_WIDTH - 1, setup.game.choices[Role.VERIFIER].stop - 1, *setup.game.message_sizes)
        self.space = spaces.Box(NO_CHOICE, largest, self._shape, np.int64)

    def encode(self, state: GameState) -> Value:
        array = np.full(self._shape, NO_CHOICE, np.int64)
        past = state.history[-len(array) :]
        for row, turn in zip(array[len(array) - len(past) :], past, strict=True):
            row[:-3] = self._arrays[turn.proposal]
            row[-3:] = turn.answer, *turn.messages
        return array

    def encode_batch(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        past = games.history[indices, -self._shape[0] :]
        return np.concatenate([self._arrays.batch(past[..., 0]), past[..., 1:]], axis=-1)


class ActionArrayCache(dict[int, NDArray[np.int64]]):
    """Lazy cache of the released array form by action index of the MDP; read-only."""

    def __init__(self, game: Game) -> None:
        super().__init__()
        self._appearance = game.config.dynamics.appearance
        self.slots = len(self._appearance.to_array(self._appearance.decode(0)))
        self[NO_CHOICE] = np.full(self.slots, NO_CHOICE)

    def __missing__(self, index: int) -> NDArray[np.int64]:
        array = self[index] = np.array(self._appearance.to_array(self._appearance.decode(index)), np.int64)
        return array

    def batch(self, indices: Int64Array) -> NDArray[np.int64]:
        """(..., slots) a new array for actions (...)."""
        table, is_filled = self._table
        for index in indices[~is_filled[indices]].tolist():
            table[index], is_filled[index] = self[index], True
        return table[indices]

    @cached_property
    def _table(self) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """By action index, NO_CHOICE last: the arrays, and a flag for those filled in."""
        count = self._appearance.action_count + 1
        return np.zeros((count, self.slots), np.int64), np.zeros(count, np.bool_)


class NumberPart(Part):
    """A number of the state: the other agent's last message, 0 if it was silent, or the proposer's intent."""

    def __init__(self, setup: GameSetup, size: int, name: tuple[str, str], *role: Role) -> None:
        """`name`: of the field in `GameState` and in `GameArrays`; `role`: whose number it is, if both have one."""
        self.space = spaces.Discrete(size)
        self._of_state, self._of_games = map(attrgetter, name)
        self._role = role

    def encode(self, state: GameState) -> Value:
        value = self._of_state(state)
        return np.int64(value[self._role[0]] if self._role else value)

    def encode_batch(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        return self._of_games(games)[*self._role, indices]


class ConstantPart(Part):
    """A constant: the agent's own index, or a placeholder for a part that only the other agent has."""

    def __init__(self, space: spaces.Space[Any], value: Value) -> None:
        self.space = space
        self._value = value

    def encode(self, state: GameState) -> Value:
        return self._value.copy()

    def encode_batch(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        return np.repeat(np.asarray(self._value)[None], len(indices), axis=0)


# By view: observation key and part. SB3 uses the keys in a torch ModuleDict, so a key must not be the name of one of
# its methods, such as "items".
SCENE_PARTS: Mapping[str, tuple[str, Callable[[GameSetup], ScenePart]] | None] = {
    "image": ("image", ImagePart),
    "structured": ("item_array", ItemArrayPart),
    "text": ("text", SceneTextPart),
    "none": None,
}
STATEMENT_PARTS: Mapping[str, Callable[[GameSetup], Part] | None] = {
    "tokens": TokensPart,
    "text": StatementTextPart,
    "none": None,
}
VIEWS: Mapping[str, View] = {
    "image": View(),
    "structured": View(scene="structured"),
    "text": View(scene="text", statement="text"),
}


def make_parts(setup: GameSetup) -> tuple[dict[str, Part], dict[str, Part]]:
    """Both agents' parts by key, by Role. A part that both see is one shared object."""

    @cache
    def make(build: Callable[..., Part], *arguments: Any) -> Part:
        return build(setup, *arguments)

    proposer, verifier = (_parts_of(setup, role, make) for role in Role)
    if setup.game.homogeneous:
        return _padded(proposer, verifier, Role.PROPOSER), _padded(verifier, proposer, Role.VERIFIER)
    return proposer, verifier


def _parts_of(setup: GameSetup, role: Role, make: Callable[..., Part]) -> dict[str, Part]:
    """An agent's parts by key; `make`: called with a class of parts and its arguments."""
    view, game = setup.views[role], setup.game
    parts: dict[str, Part] = {}
    scene, statement = SCENE_PARTS[view.scene], STATEMENT_PARTS[view.statement]
    if scene is not None:
        current = parts[scene[0]] = make(scene[1])
        if view.proposed_scene and game.turn_based:
            parts[f"proposed_{scene[0]}"] = make(ProposedScenePart, current)
    if statement is not None:
        parts["statement"] = make(statement)
    if view.target:
        parts["target"] = make(TargetPart)
    if view.proposal and game.turn_based:
        parts["proposal"] = make(ProposalPart, "proposal", "proposals")
    if view.refused and game.has_refusals:
        parts["refused"] = make(ProposalPart, "refused", "refused")
    if view.history:
        parts["history"] = make(HistoryPart, view.history)
    if game.message_sizes[role.other]:
        size = max(game.message_sizes) if game.homogeneous else game.message_sizes[role.other]
        parts["message"] = make(NumberPart, size + 1, ("messages", "messages"), role.other)
    if role is Role.PROPOSER and game.rewards.draws_intent:
        parts["intent"] = make(NumberPart, len(Intent), ("intent", "intents"))
    return parts


def _padded(own: dict[str, Part], others: dict[str, Part], role: Role) -> dict[str, Part]:
    """An agent's own parts, placeholders for the other agent's, and "agent", its own index."""
    for key in own.keys() & others.keys():
        if own[key].space != others[key].space:
            raise ValueError(
                f"homogeneous agents need equal spaces for {key!r}, not {own[key].space} and {others[key].space}:"
                " give both the same view, or leave it out of one"
            )
    padded: dict[str, Part] = {"agent": ConstantPart(spaces.Discrete(len(Role)), np.int64(role))}
    for key in sorted(own.keys() | others.keys()):
        space = others[key].space if key in others else own[key].space
        zero = np.int64(0) if isinstance(space, spaces.Discrete) else np.zeros(space.shape or (), space.dtype)
        padded[key] = own[key] if key in own else ConstantPart(space, zero)
    return padded
