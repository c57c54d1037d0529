"""The settings of the game, with defaults, and the views of its agents."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, asdict, dataclass, fields
from functools import partial
from typing import Any, TypeAlias, TypeVar

from lilgym_mp.envs.checks import checked_flag
from lilgym_mp.envs.config import EnvConfig, setting
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, PROTOCOLS
from lilgym_mp.envs.proposer_verifier.rewards import PRESETS, Rewards, checked_number
from lilgym_mp.scene.arrays import AnyDict
from lilgym_mp.scene.choices import checked_count, choose
from lilgym_mp.scene.render import shrink_of

ViewSpec: TypeAlias = "View | str | Mapping[str, Any]"
Value = TypeVar("Value")

SCENE_VIEWS = ("image", "structured", "none")
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


VIEWS = {"image": View(), "structured": View(scene="structured")}
GUIDE = "guide"  # preset of both views: the verifier must tell the proposer what to do
VIEWS_HELP = (
    f"{', '.join(VIEWS)}, {GUIDE} (the proposer sees no statement), or JSON of a view's fields, for both agents or by"
    " agent (default: image)"
)


def _make_view(view: ViewSpec) -> View:
    """A view from its fields or a name in VIEWS."""
    if isinstance(view, View):
        return view
    if isinstance(view, Mapping):
        for name in view:
            choose("field of a view", name, {field.name: field for field in fields(View)})
        return View(**view)
    choose("view", view, {**VIEWS, GUIDE: None})
    if view == GUIDE:
        raise ValueError(f"views {GUIDE!r} are of both agents, not of one")
    return VIEWS[view]


REWARDS_HELP = f"{', '.join(PRESETS)}, or JSON of weighted terms for each agent (default: common)"


def name_or_json(text: str) -> Any:
    """JSON of an object, or the text itself: a name. Raises ValueError."""
    if not text.startswith("{"):
        return text
    try:
        return json.loads(text)
    except ValueError as error:
        raise ValueError(f"not valid JSON: {error}") from None


def read_sizes(text: str) -> int | Mapping[str, int]:
    """A number, or JSON of one for each agent. Raises ValueError."""
    found = name_or_json(text)
    return int(found) if found is text else found


@dataclass(frozen=True)
class GameSettings(EnvConfig):
    """The configuration of a game; docs/proposer_verifier.md describes protocols, rewards and views.

    Args:
        configuration: As for `Settings`, like all fields that are not named here.
        protocol: Who moves when, and what the verifier decides.
        rewards: A name in PRESETS, {agent: term or {term: weight}}, or a function.
        deceptive_share: Share of deceptive games, 0 .. 1, if intents are hidden.
        views: What agents see: one view for both, {agent: view}, or "guide".
        message_size: Messages besides silence, for both agents or by agent; None: the protocol's.
        message_cost: Cost of a message to its sender.
        exchanges: In "critique", rejections in a round before a proposal needs no answer.
        reveal_truth: Whether infos include the truth of the statement.
        homogeneous: Whether both agents have equal spaces.
    """

    configuration: str = "TowerScratch"
    _: KW_ONLY
    protocol: str = setting("veto", "(default: veto)", choices=PROTOCOLS)
    # a name in PRESETS, {agent: term or {term: weight}}, or a RewardFunction
    rewards: Rewards = setting("common", REWARDS_HELP, kind=name_or_json)
    deceptive_share: float = setting(0.5, "share of deceptive games, if intents are hidden")
    # for both, {agent: view}, or GUIDE
    views: ViewSpec | Mapping[str, ViewSpec] = setting("image", VIEWS_HELP, kind=name_or_json)
    message_size: int | Mapping[str, int] | None = setting(  # or {agent: number}
        None, "messages besides silence, for both agents or JSON by agent (default: the protocol's)", kind=read_sizes
    )
    message_cost: float = setting(0.0, "cost of a message to its sender")
    exchanges: int = setting(3, "critique: rejections in a round before a proposal needs no answer")
    reveal_truth: bool = False  # whether infos include the truth of the statement
    homogeneous: bool = False  # equal spaces for both agents

    def to_json(self) -> AnyDict:
        """The game's identity: no split, image size or infos, and no views in which both agents see everything.

        Raises:
            ValueError: For a reward function.
        """
        if callable(self.rewards):
            raise ValueError("a run cannot save rewards given as a function: give a preset, or terms with weights")
        values = {**super().to_json(), "homogeneous": self.homogeneous}
        if self.views == GUIDE:
            return values
        views = self.views_by_role()
        values["views"] = {agent: asdict(view) for agent, view in zip(AGENTS, views, strict=True)}
        if all(view in VIEWS.values() for view in views):
            del values["views"]
        return values

    def check(self) -> None:
        """Checks the settings that no other method checks.

        Raises:
            ValueError: Naming the value and the choices.
        """
        choose("protocol", self.protocol, PROTOCOLS)
        shrink_of(self.image_size)
        checked_count("exchanges", self.exchanges, least=0)
        for name in ("message_cost", "deceptive_share"):
            checked_number(name, getattr(self, name))
        if not 0 <= self.deceptive_share <= 1:
            raise ValueError(f"deceptive_share must be between 0 and 1, not {self.deceptive_share!r}")
        for name in ("reveal_truth", "homogeneous"):
            checked_flag(name, getattr(self, name))

    def views_by_role(self) -> tuple[View, View]:
        """The views of the proposer and of the verifier."""
        if self.views == GUIDE:
            return View(statement="none", target=False), View()
        return _by_role(self.views, _make_view)

    def message_sizes(self) -> tuple[int, int]:
        """Numbers of messages besides silence, indexed by role.

        By default those of the protocol; for a guide, where the verifier has any, one for each edit and one for STOP.
        """
        if self.message_size is None:
            proposer, verifier = PROTOCOLS[self.protocol].message_sizes
            return proposer, self.dynamics().appearance.action_count if verifier and self.views == GUIDE else verifier
        return _by_role(self.message_size, partial(checked_count, "message_size", least=0))


def _by_role(given: Any, checked: Callable[[Any], Value]) -> tuple[Value, Value]:
    """Both agents' values, from {agent: value} or one value for both."""
    if not (isinstance(given, Mapping) and set(given) & set(AGENTS)):
        value = checked(given)
        return value, value
    if set(given) != set(AGENTS):
        raise ValueError(f"name both {' and '.join(AGENTS)}, not only {', '.join(map(str, given))}")
    proposer, verifier = (checked(given[agent]) for agent in AGENTS)
    return proposer, verifier
