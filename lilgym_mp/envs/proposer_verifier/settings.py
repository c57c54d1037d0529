"""The settings of the game, with defaults, and the setup built from them: the game, its tasks and its views."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, fields, replace
from functools import cached_property, partial
from typing import Any, TypeAlias, TypeVar

import numpy as np

from lilgym_mp.corpus import TaskSet, Vocabulary
from lilgym_mp.corpus.statement_arrays import default_length, training_tasks
from lilgym_mp.envs.checks import checked_count, checked_flag
from lilgym_mp.envs.config import EnvConfig, setting
from lilgym_mp.envs.observation import item_capacity
from lilgym_mp.envs.proposer_verifier.game import Game
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, ENDINGS, PROTOCOLS, GameProtocol, ProtocolConfig
from lilgym_mp.envs.proposer_verifier.rewards import (
    PRESETS,
    Costs,
    Intent,
    Rewards,
    checked_number,
    make_reward_scheme,
)
from lilgym_mp.scene.choices import choose
from lilgym_mp.scene.render import shrink_of

ViewSpec: TypeAlias = "View | str | Mapping[str, Any]"
Value = TypeVar("Value")

SCENE_VIEWS = ("image", "structured", "text", "none")
STATEMENT_VIEWS = ("tokens", "text", "none")


@dataclass(frozen=True, slots=True)
class View:
    """The parts of an agent's observation. "intent" (proposer only) and "message" are added if the game has them."""

    scene: str = "image"  # a name in SCENE_VIEWS
    statement: str = "tokens"  # a name in STATEMENT_VIEWS
    target: bool = True
    proposal: bool = True  # the pending proposal
    proposed_scene: bool = False  # the scene after the pending proposal, in the same form as the scene
    refused: bool = True  # the proposal refused last, until an action is played
    history: int = 0  # number of past turns

    def __post_init__(self) -> None:
        """Raises ValueError naming the choices."""
        choose("scene view", self.scene, dict.fromkeys(SCENE_VIEWS))
        choose("statement view", self.statement, dict.fromkeys(STATEMENT_VIEWS))
        for name in ("target", "proposal", "proposed_scene", "refused"):
            checked_flag(f"{name} of a view", getattr(self, name))
        if self.proposed_scene and self.scene == "none":
            raise ValueError("proposed_scene of a view needs a scene view other than 'none'")
        checked_count("history of a view", self.history, least=0)


VIEWS: Mapping[str, View] = {
    "image": View(),
    "structured": View(scene="structured"),
    "text": View(scene="text", statement="text"),
}


def _make_view(view: ViewSpec) -> View:
    """A view from its fields or a name in VIEWS."""
    if isinstance(view, View):
        return view
    if isinstance(view, Mapping):
        for name in view:
            choose("field of a view", name, {field.name: field for field in fields(View)})
        return View(**view)
    return choose("view", view, VIEWS)


REWARDS_HELP = f"{', '.join(PRESETS)}, or JSON of weighted terms for each agent (default: common)"


def read_rewards(text: str) -> Rewards:
    """A name of rewards, or JSON of them. Raises ValueError."""
    if not text.startswith("{"):
        return text
    try:
        return json.loads(text)
    except ValueError as error:
        raise ValueError(f"not valid JSON: {error}") from None


@dataclass(frozen=True)
class GameSettings(EnvConfig):
    """The configuration of a game; docs/proposer_verifier.md describes the fields."""

    configuration: str = "TowerScratch"
    _: KW_ONLY
    protocol: str = setting("veto", "(default: veto)", choices=list(PROTOCOLS))
    ending: str | None = setting(None, "who may end the game (default: the protocol's)", choices=list(ENDINGS))
    # a name in PRESETS, {agent: term or {term: weight}}, or a RewardFunction
    rewards: Rewards = setting("common", REWARDS_HELP, kind=read_rewards)
    false_accept_cost: float = setting(1.0, "cost of a false accept in the reward `correctness`")
    false_reject_cost: float = setting(1.0, "cost of a false reject in the reward `correctness`")
    deceptive_share: float = setting(0.5, "share of deceptive games, if intents are hidden")
    views: ViewSpec | Mapping[str, ViewSpec] = "image"  # for both, or {agent: view}
    message_size: int | Mapping[str, int] | None = setting(  # or {agent: number}
        None, "messages besides silence, for both agents (default: the protocol's)", kind=int
    )
    message_cost: float = setting(0.0, "cost of a message to its sender")
    verdict_bins: int | None = setting(None, "audit: probabilities to choose from (default: true or false)", kind=int)
    exchanges: int = setting(3, "critique: rejections in a round before a proposal needs no answer")
    reveal_truth: bool = False  # whether infos include the truth of the statement
    homogeneous: bool = False  # equal spaces for both agents

    def to_json(self) -> dict[str, Any]:
        """The game's identity: no split, image size, views or infos. Raises ValueError for a reward function."""
        if callable(self.rewards):
            raise ValueError("a run cannot save rewards given as a function: give a preset, or terms with weights")
        return {**super().to_json(), "homogeneous": self.homogeneous}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> GameSettings:
        """Inverse of `to_json`, with the default views. Raises ValueError or TypeError."""
        return cls.of(data)

    def setup(self) -> GameSetup:
        """Builds the game. Raises ValueError naming the value and the choices."""
        views = _for_both(self.views, _make_view)
        protocol = choose("protocol", self.protocol, PROTOCOLS)
        shrink_of(self.image_size)
        sizes = protocol.message_sizes
        if self.message_size is not None:
            sizes = _for_both(self.message_size, partial(checked_count, "message_size", least=0))
        costs = [checked_number(name, getattr(self, name)) for name in ("false_accept_cost", "false_reject_cost")]
        game = Game(
            protocol,
            self._config(protocol),
            make_reward_scheme(self.rewards, Costs(*costs), has_probabilities=self.verdict_bins is not None),
            message_sizes=sizes,
            message_cost=checked_number("message_cost", self.message_cost),
            history_length=max(view.history for view in views),
            homogeneous=checked_flag("homogeneous", self.homogeneous),
        )
        if not 0 <= checked_number("deceptive_share", self.deceptive_share) <= 1:
            raise ValueError(f"deceptive_share must be between 0 and 1, not {self.deceptive_share!r}")
        reveals_truth = checked_flag("reveal_truth", self.reveal_truth)
        tasks = self.tasks()
        return GameSetup(game, tasks, tasks, self.image_size, views, self.deceptive_share, reveals_truth)

    def _config(self, protocol: GameProtocol) -> ProtocolConfig:
        ending = protocol.endings[0] if self.ending is None else self.ending
        choose(f"ending of protocol {protocol.name!r}", ending, dict.fromkeys(protocol.endings))
        if self.verdict_bins is not None and not protocol.takes_bins:
            raise ValueError(f'verdict_bins is for protocol="audit"; {protocol.name!r} has no verdict')
        return ProtocolConfig(
            self.dynamics(),
            ENDINGS[ending],
            None if self.verdict_bins is None else checked_count("verdict_bins", self.verdict_bins, least=2),
            checked_count("exchanges", self.exchanges, least=0),
        )


def _for_both(given: Any, checked: Callable[[Any], Value]) -> tuple[Value, Value]:
    """Both agents' values, from {agent: value} or one value for both."""
    if not (isinstance(given, Mapping) and set(given) & set(AGENTS)):
        value = checked(given)
        return value, value
    if set(given) != set(AGENTS):
        raise ValueError(f"name both {' and '.join(AGENTS)}, not only {', '.join(map(str, given))}")
    proposer, verifier = (checked(given[agent]) for agent in AGENTS)
    return proposer, verifier


@dataclass(frozen=True)
class GameSetup:
    """The parts that all episodes share: the game, tasks, image size and views."""

    game: Game
    tasks: TaskSet
    space_tasks: TaskSet  # determine the sizes of observation spaces
    image_size: str
    views: tuple[View, View]  # indexed by role
    deceptive_share: float  # probability of a deceptive episode, if intents are drawn
    reveals_truth: bool  # in infos

    def sample_task_index(self, rng: np.random.Generator) -> int:
        """The index of the next episode's task, uniformly drawn."""
        return int(rng.integers(len(self.tasks)))

    def sample_intent(self, rng: np.random.Generator) -> Intent:
        """The next episode's intent; uses `rng` only if intents are drawn."""
        if self.game.rewards.draws_intent and rng.random() < self.deceptive_share:
            return Intent.DECEPTIVE
        return Intent.HELPFUL

    @cached_property
    def vocabulary(self) -> Vocabulary:
        """The words of the corpus's train split, whatever the split in play."""
        return Vocabulary.from_statements(task.statement for task in self._training_tasks)

    @cached_property
    def statement_length(self) -> int:
        """Number of token ids per statement, as in `TokenizedStatement`; the longest statement of the split fits."""
        return default_length(task.statement for tasks in (self.space_tasks, self._training_tasks) for task in tasks)

    @cached_property
    def _training_tasks(self) -> TaskSet:
        return training_tasks(self.space_tasks)

    @cached_property
    def item_capacity(self) -> int:
        """The most items a box can have."""
        return item_capacity(self.space_tasks, self.game.config.dynamics)

    @cached_property
    def max_statement_bytes(self) -> int:
        """UTF-8 length of the longest statement."""
        return max(len(task.statement.encode()) for task in self.space_tasks)


def with_tasks(setup: GameSetup, tasks: TaskSet, *, keep_spaces: bool = False) -> GameSetup:
    """The game with other tasks; `keep_spaces`: whether observation spaces stay the same, which must fit these tasks.

    Raises ValueError for tasks of another appearance.
    """
    own, given = setup.tasks.provenance.appearance, tasks.provenance.appearance
    if own != given:
        raise ValueError(f"the game is played on {own}; tasks of {given} do not fit it")
    return replace(setup, tasks=tasks, space_tasks=setup.space_tasks if keep_spaces else tasks)
