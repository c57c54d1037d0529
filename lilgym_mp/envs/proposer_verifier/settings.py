"""The settings of the game, with defaults, and the setup built from them: the game, its tasks and its views."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, fields, replace
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np

from lilgym_mp.corpus import TaskSet, Vocabulary
from lilgym_mp.corpus.statement_arrays import default_length, training_tasks
from lilgym_mp.envs.checks import checked_count, checked_flag
from lilgym_mp.envs.config import EnvConfig, setting
from lilgym_mp.envs.observation import item_capacity
from lilgym_mp.envs.proposer_verifier.game import Game
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, ENDINGS, PROTOCOLS, GameProtocol, ProtocolConfig, Role
from lilgym_mp.envs.proposer_verifier.rewards import (
    PRESETS,
    Costs,
    Intent,
    Rewards,
    RewardScheme,
    checked_number,
    make_reward_scheme,
)
from lilgym_mp.envs.proposer_verifier.views import View, ViewSpec, make_view
from lilgym_mp.scene.choices import choose
from lilgym_mp.scene.render import shrink_of

Value = TypeVar("Value")


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
    rewards: Rewards = setting("common", REWARDS_HELP, parse=read_rewards)
    false_accept_cost: float = setting(1.0, "cost of a false accept in the reward `correctness` (default: 1)", float)
    false_reject_cost: float = setting(1.0, "cost of a false reject in the reward `correctness` (default: 1)", float)
    sneaky_share: float = setting(0.5, "share of sneaky games, if intents are hidden (default: 0.5)", float)
    views: ViewSpec | Mapping[str, ViewSpec] = "image"  # for both, or {agent: view}
    message_size: int | Mapping[str, int] | None = setting(  # or {agent: number}
        None, "messages besides silence, for both agents (default: the protocol's)", parse=int
    )
    message_cost: float = setting(0.0, "cost of a message to its sender (default: 0)", float)
    verdict_bins: int | None = setting(None, "audit: probabilities to choose from (default: true or false)", int)
    exchanges: int = setting(3, "critique: rejections in a round before a proposal needs no answer (default: 3)", int)
    reveal_truth: bool = False  # whether infos include the truth of the statement
    homogeneous: bool = False  # equal spaces for both agents

    def to_json(self) -> dict[str, Any]:
        """All fields but the views. Raises ValueError for rewards given as a function."""
        if callable(self.rewards):
            raise ValueError("a run cannot save rewards given as a function: give a preset, or terms with weights")
        values = {each.name: getattr(self, each.name) for each in fields(self)[1:] if each.name != "views"}
        return {"appearance": self.appearance, "start": self.start, **values}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> GameSettings:
        """Inverse of `to_json`, with the default views. Raises ValueError or TypeError."""
        return cls.of(data)

    def setup(self) -> GameSetup:
        """Builds the game. Raises ValueError naming the value and the choices."""
        views = _by_role(self.views, make_view)
        protocol = choose("protocol", self.protocol, PROTOCOLS)
        shrink_of(self.image_size)
        sizes = protocol.message_sizes
        if self.message_size is not None:
            sizes = _by_role(self.message_size, partial(checked_count, "message_size", least=0))
        game = Game(
            protocol,
            self._config(protocol),
            self._reward_scheme(),
            message_sizes=sizes,
            message_cost=checked_number("message_cost", self.message_cost),
            history_length=max(view.history for view in views),
            homogeneous=checked_flag("homogeneous", self.homogeneous),
        )
        tasks = self.tasks()
        return GameSetup(
            game,
            tasks,
            tasks,
            self.image_size,
            views,
            _share("sneaky_share", self.sneaky_share),
            checked_flag("reveal_truth", self.reveal_truth),
        )

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

    def _reward_scheme(self) -> RewardScheme:
        costs = Costs(
            checked_number("false_accept_cost", self.false_accept_cost),
            checked_number("false_reject_cost", self.false_reject_cost),
        )
        return make_reward_scheme(self.rewards, costs, has_probabilities=self.verdict_bins is not None)


def _by_role(given: Any, checked: Callable[[Any], Value]) -> tuple[Value, Value]:
    """Both agents' values, from {agent: value} or one value for both."""
    if isinstance(given, Mapping) and set(given) & set(AGENTS):
        if set(given) != set(AGENTS):
            raise ValueError(f"name both {' and '.join(AGENTS)}, not only {', '.join(map(str, given))}")
        proposer, verifier = (checked(given[agent]) for agent in AGENTS)
        return proposer, verifier
    value = checked(given)
    return value, value


def _share(name: str, value: Any) -> float:
    if not 0 <= checked_number(name, value) <= 1:
        raise ValueError(f"{name} must be between 0 and 1, not {value!r}")
    return float(value)


@dataclass(frozen=True)
class GameSetup:
    """What stays the same from episode to episode: the game, tasks, image size and views."""

    game: Game
    tasks: TaskSet
    space_tasks: TaskSet  # determine the sizes of observation spaces
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
