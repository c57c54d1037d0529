"""What each agent sees: the parts of an observation, each with its space and its encoding of a state.

Every part is an array or a NumPy number, because PettingZoo's own test refuses strings in observations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeAlias

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from lilgym_mp.arrays import Int64Array, UInt8Array
from lilgym_mp.choices import choose
from lilgym_mp.corpus import TaskSet, Vocabulary, load_tasks
from lilgym_mp.corpus.statement_arrays import default_length
from lilgym_mp.envs.proposer_verifier.game import Game
from lilgym_mp.envs.proposer_verifier.states import NO_CHOICE, GameState, Intent, Role
from lilgym_mp.observation import image_space, item_array, item_capacity
from lilgym_mp.render import Canvas
from lilgym_mp.scene import BOX_COUNT, BOX_SIDE, IMAGE_WIDTH, Item, Scene

if TYPE_CHECKING:
    from lilgym_mp.envs.proposer_verifier.game_arrays import GameArrays

AnyView: TypeAlias = "View | str | Mapping[str, Any]"
Value = NDArray[Any] | np.integer[Any]

BOX_TITLES = ("left", "middle", "right")
VOCABULARY_SPLIT = "train"


@dataclass(frozen=True, slots=True)
class View:
    """What an agent sees. The proposer's intent and the other's word are added where there are such things."""

    scene: str = "image"  # "image", "structured", "text" or "none"
    statement: str = "tokens"  # "tokens", "text" or "none"
    target: bool = True
    proposal: bool = True  # the one that awaits an answer
    history: int = 0  # this many past turns

    def __post_init__(self) -> None:
        """Raises ValueError naming the choices."""
        choose("scene view", self.scene, SCENE_PARTS)
        choose("statement view", self.statement, STATEMENT_PARTS)
        for name in ("target", "proposal"):
            if not isinstance(getattr(self, name), bool):
                raise ValueError(f"{name} of a view must be True or False, not {getattr(self, name)!r}")
        if isinstance(self.history, bool) or not isinstance(self.history, int) or self.history < 0:
            raise ValueError(f"history of a view must be a number of turns, 0 or more, not {self.history!r}")


def make_view(view: AnyView) -> View:
    """A view from its fields, or from one of the names in VIEWS. Raises ValueError naming the choices."""
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
    """Everything about a game that stays the same from episode to episode: rules, tasks, image size, views."""

    game: Game
    tasks: TaskSet
    image_size: str
    views: tuple[View, View]  # by Role
    sneaky_share: float  # of the episodes, where the proposer's intent is hidden
    reveals_truth: bool  # in infos

    @cached_property
    def usual_intent(self) -> Intent | None:
        """The proposer's intent where it is the same in every episode; None where it is drawn."""
        rewards = self.game.rewards
        if rewards.draws_intent:
            return None
        return Intent.SNEAKY if rewards.uses("sneaky", Role.PROPOSER) else Intent.HELPFUL

    def drawn_task(self, rng: np.random.Generator) -> int:
        """The number of the next episode's task, all equally likely."""
        return int(rng.integers(len(self.tasks)))

    def drawn_intent(self, rng: np.random.Generator) -> Intent:
        """The next episode's intent; `rng` is used only where intents are drawn."""
        if self.usual_intent is not None:
            return self.usual_intent
        return Intent.SNEAKY if rng.random() < self.sneaky_share else Intent.HELPFUL

    @cached_property
    def vocabulary(self) -> Vocabulary:
        """The words of the corpus's train split: the same for every split."""
        return Vocabulary.from_statements(task.statement for task in self._training_tasks)

    @cached_property
    def statement_length(self) -> int:
        """Words in the array of a statement, as `TokenizedStatement` has them; the split's longest fits."""
        return default_length(task.statement for tasks in (self.tasks, self._training_tasks) for task in tasks)

    @cached_property
    def _training_tasks(self) -> TaskSet:
        origin = self.tasks.provenance
        if origin.split == VOCABULARY_SPLIT:
            return self.tasks
        return load_tasks(origin.corpus, origin.appearance, origin.start, VOCABULARY_SPLIT)

    @cached_property
    def item_capacity(self) -> int:
        """How many items a box can come to have."""
        return item_capacity(self.tasks, self.game.conditions.dynamics)

    @cached_property
    def longest_text(self) -> int:
        """Bytes of the longest statement."""
        return max(len(task.statement.encode()) for task in self.tasks)


class Part(Protocol):
    """One entry of an observation."""

    @property
    def space(self) -> spaces.Space[Any]: ...

    def encode(self, state: GameState) -> Value:
        """The entry's value: a new array, or a number."""
        ...

    def rows(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        """(k, ...) the values of the games `indices`, (k,): a new array."""
        ...


class ImagePart:
    """uint8 (50, 190, 3), or (100, 380, 3) at native size."""

    def __init__(self, setup: GameSetup) -> None:
        self.space = image_space(setup.image_size)
        self._canvas = Canvas(setup.image_size)

    def encode(self, state: GameState) -> Value:
        return self._canvas.show(state.mdp.scene).copy()

    def rows(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        return games.images.take(indices, axis=0)


class ItemsPart:
    """int16 (3, capacity, 5): x, y, shape, colour and size of each item by box, -1 in empty slots."""

    def __init__(self, setup: GameSetup) -> None:
        self._capacity = setup.item_capacity
        self.space = spaces.Box(-BOX_SIDE, BOX_SIDE, (BOX_COUNT, self._capacity, len(Item._fields)), np.int16)

    def encode(self, state: GameState) -> Value:
        return item_array(state.mdp.scene, self._capacity)

    def rows(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        return games.items().take(indices, axis=0)


LONGEST_ITEM_TEXT = len("medium triangle yellow at (-100, -100), ")


class SceneTextPart:
    """The scene in words, as `as_bytes` writes them."""

    def __init__(self, setup: GameSetup) -> None:
        self._length = BOX_COUNT * (setup.item_capacity * LONGEST_ITEM_TEXT + len("middle: empty\n"))
        self.space = byte_space(self._length)

    def encode(self, state: GameState) -> Value:
        return as_bytes(scene_in_words(state.mdp.scene), self._length)

    def rows(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        return np.stack([as_bytes(scene_in_words(games.mdp(n).scene), self._length) for n in indices.tolist()])


def scene_in_words(scene: Scene) -> str:
    """One line a box, such as "left: medium yellow square at (40, 80)"; pixels from the box's top-left corner."""
    boxes = zip(BOX_TITLES, scene.boxes, strict=True)
    return "\n".join(f"{title}: {', '.join(map(item_in_words, box.items)) or 'empty'}" for title, box in boxes)


def item_in_words(item: Item) -> str:
    size, colour, shape = (member.name.lower() for member in (item.size, item.colour, item.shape))
    return f"{size} {colour} {shape} at ({item.x}, {item.y})"


class TokensPart:
    """int64 (length,): the statement's words as `GameSetup.vocabulary` numbers them, padded with 0."""

    def __init__(self, setup: GameSetup) -> None:
        self._setup = setup
        self.space = spaces.Box(0, len(setup.vocabulary) - 1, (setup.statement_length,), np.int64)
        self._tokens = StatementTokens(setup)

    def encode(self, state: GameState) -> Value:
        return self._tokens[state.mdp.task.statement].copy()

    def rows(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        return self._by_task.take(games.tasks[indices], axis=0)

    @cached_property
    def _by_task(self) -> NDArray[np.int64]:
        return np.stack([self._tokens[task.statement] for task in self._setup.tasks])


class StatementTokens(dict[str, NDArray[np.int64]]):
    """(length,) the numbers of each statement's words, made when first asked for; not to be written."""

    def __init__(self, setup: GameSetup) -> None:
        super().__init__()
        self._encode = setup.vocabulary.encode
        self._length = setup.statement_length

    def __missing__(self, statement: str) -> NDArray[np.int64]:
        tokens = self[statement] = self._encode(statement, self._length)
        return tokens


class StatementTextPart:
    """The statement, as `as_bytes` writes it."""

    def __init__(self, setup: GameSetup) -> None:
        self._setup = setup
        self._length = setup.longest_text
        self.space = byte_space(self._length)

    def encode(self, state: GameState) -> Value:
        return as_bytes(state.mdp.task.statement, self._length)

    def rows(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        return self._by_task.take(games.tasks[indices], axis=0)

    @cached_property
    def _by_task(self) -> UInt8Array:
        return np.stack([as_bytes(task.statement, self._length) for task in self._setup.tasks])


def byte_space(length: int) -> spaces.Box:
    return spaces.Box(0, 255, (length,), np.uint8)


def as_bytes(text: str, length: int) -> UInt8Array:
    """(length,) the text's UTF-8 bytes, padded with zeros; `read_text` gives the text back."""
    array = np.zeros(length, np.uint8)
    encoded = text.encode()
    array[: len(encoded)] = np.frombuffer(encoded, np.uint8)
    return array


def read_text(array: UInt8Array) -> str:
    """The text in a part of an observation that holds UTF-8 bytes."""
    return array.tobytes().rstrip(b"\0").decode()


class TargetPart:
    """0 or 1."""

    def __init__(self, setup: GameSetup) -> None:
        self.space = spaces.Discrete(2)
        self._setup = setup
        self._values = (np.int64(0), np.int64(1))

    def encode(self, state: GameState) -> Value:
        return self._values[state.mdp.task.target]

    def rows(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        return self._by_task[games.tasks[indices]]

    @cached_property
    def _by_task(self) -> NDArray[np.int64]:
        return np.array([task.target for task in self._setup.tasks], np.int64)


class ProposalPart:
    """int64 (slots,): the proposal that awaits an answer, in the released array form; all -1 where there is none."""

    def __init__(self, setup: GameSetup) -> None:
        self._arrays = ActionArrays(setup.game)
        self.space = spaces.Box(NO_CHOICE, IMAGE_WIDTH - 1, (self._arrays.slots,), np.int64)

    def encode(self, state: GameState) -> Value:
        return self._arrays[NO_CHOICE if state.proposal is None else state.proposal].copy()

    def rows(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        return self._arrays.many(games.proposals[indices])


class HistoryPart:
    """int64 (turns, slots + 3): proposal in the released array form, answer, both words; newest last, -1 before."""

    def __init__(self, setup: GameSetup, turns: int) -> None:
        self._arrays = ActionArrays(setup.game)
        self._shape = (turns, self._arrays.slots + 3)
        answers, sizes = setup.game.choices[Role.VERIFIER], setup.game.message_sizes
        largest = max(IMAGE_WIDTH - 1, answers.stop - 1, *sizes)
        self.space = spaces.Box(NO_CHOICE, largest, self._shape, np.int64)

    def encode(self, state: GameState) -> Value:
        array = np.full(self._shape, NO_CHOICE, np.int64)
        past = state.history[-len(array) :]
        for row, turn in zip(array[len(array) - len(past) :], past, strict=True):
            row[:-3] = self._arrays[turn.proposal]
            row[-3:] = turn.answer, *turn.words
        return array

    def rows(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        past = games.history[indices, -self._shape[0] :]
        return np.concatenate([self._arrays.many(past[..., 0]), past[..., 1:]], axis=-1)


class ActionArrays(dict[int, NDArray[np.int64]]):
    """The released array form of each action of the MDP, made when first asked for; not to be written."""

    def __init__(self, game: Game) -> None:
        super().__init__()
        self._appearance = game.conditions.dynamics.appearance
        self.slots = len(self._appearance.to_array(self._appearance.decode(0)))
        self[NO_CHOICE] = np.full(self.slots, NO_CHOICE)

    def __missing__(self, number: int) -> NDArray[np.int64]:
        array = self[number] = np.array(self._appearance.to_array(self._appearance.decode(number)), np.int64)
        return array

    def many(self, numbers: Int64Array) -> NDArray[np.int64]:
        """(..., slots) a new array, of many actions."""
        table, known = self._table
        for number in numbers[~known[numbers]].tolist():
            table[number], known[number] = self[number], True
        return table[numbers]

    @cached_property
    def _table(self) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """By number, NO_CHOICE last: the arrays, and which of them stand there yet."""
        count = self._appearance.action_count + 1
        return np.zeros((count, self.slots), np.int64), np.zeros(count, np.bool_)


class WordPart:
    """The other agent's last word; 0 is silence."""

    def __init__(self, setup: GameSetup, speaker: Role, size: int) -> None:
        self.space = spaces.Discrete(size + 1)
        self._speaker = speaker

    def encode(self, state: GameState) -> Value:
        return np.int64(state.words[self._speaker])

    def rows(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        return games.words[self._speaker, indices]


class IntentPart:
    """0 helpful, 1 sneaky: seen by the proposer alone."""

    def __init__(self, setup: GameSetup) -> None:
        self.space = spaces.Discrete(len(Intent))

    def encode(self, state: GameState) -> Value:
        return np.int64(state.intent)

    def rows(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        return games.intents[indices]


class ConstantPart:
    """A value that never changes: who one is, or what one does not see."""

    def __init__(self, space: spaces.Space[Any], value: Value) -> None:
        self.space = space
        self._value = value

    def encode(self, state: GameState) -> Value:
        return self._value.copy()

    def rows(self, games: GameArrays, indices: Int64Array) -> NDArray[Any]:
        return np.repeat(np.asarray(self._value)[None], len(indices), axis=0)


# By view: key in observations, part. A key must not be a method of torch's ModuleDict, such as "items": SB3 names
# modules by the keys.
SCENE_PARTS: Mapping[str, tuple[str, Callable[[GameSetup], Part]] | None] = {
    "image": ("image", ImagePart),
    "structured": ("item_array", ItemsPart),
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


class Recipe(NamedTuple):
    """How to make a part."""

    build: Callable[..., Part]  # of a GameSetup and the arguments
    arguments: tuple[Any, ...] = ()


def make_parts(setup: GameSetup) -> tuple[dict[str, Part], dict[str, Part]]:
    """Each agent's parts by key. What both see alike is one and the same part."""
    recipes = [_recipes(setup, role) for role in Role]
    distinct = {recipe for own in recipes for recipe in own.values()}
    made = {recipe: recipe.build(setup, *recipe.arguments) for recipe in distinct}
    proposer, verifier = ({key: made[recipe] for key, recipe in own.items()} for own in recipes)
    if setup.game.homogeneous:
        return _filled(proposer, verifier, Role.PROPOSER), _filled(verifier, proposer, Role.VERIFIER)
    return proposer, verifier


def _recipes(setup: GameSetup, role: Role) -> dict[str, Recipe]:
    """Of what an agent sees, by key."""
    view, game = setup.views[role], setup.game
    recipes: dict[str, Recipe] = {}
    scene, statement = SCENE_PARTS[view.scene], STATEMENT_PARTS[view.statement]
    if scene is not None:
        recipes[scene[0]] = Recipe(scene[1])
    if statement is not None:
        recipes["statement"] = Recipe(statement)
    if view.target:
        recipes["target"] = Recipe(TargetPart)
    if view.proposal and not game.protocol.simultaneous:
        recipes["proposal"] = Recipe(ProposalPart)
    if view.history:
        recipes["history"] = Recipe(HistoryPart, (view.history,))
    if game.message_sizes[role.other]:
        size = max(game.message_sizes) if game.homogeneous else game.message_sizes[role.other]
        recipes["message"] = Recipe(WordPart, (role.other, size))
    if role is Role.PROPOSER and game.rewards.draws_intent:
        recipes["intent"] = Recipe(IntentPart)
    return recipes


def _filled(own: dict[str, Part], others: dict[str, Part], role: Role) -> dict[str, Part]:
    """One's own parts, blanks for the other's, and "agent", who one is."""
    for key in own.keys() & others.keys():
        if own[key].space != others[key].space:
            raise ValueError(
                f"homogeneous agents must see {key!r} alike, not as {own[key].space} and {others[key].space}:"
                " give both the same view, or one that lacks it"
            )
    filled: dict[str, Part] = {"agent": ConstantPart(spaces.Discrete(len(Role)), np.int64(role))}
    for key in sorted(own.keys() | others.keys()):
        filled[key] = own[key] if key in own else ConstantPart(others[key].space, _blank(others[key].space))
    return filled


def _blank(space: spaces.Space[Any]) -> Value:
    return np.int64(0) if isinstance(space, spaces.Discrete) else np.zeros(space.shape or (), space.dtype)
