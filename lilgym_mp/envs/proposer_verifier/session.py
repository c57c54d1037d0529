"""One game in play: what the AEC, parallel, batched and single-agent forms share. It knows no rule of the game."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, SupportsIndex

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding

from lilgym_mp.arrays import UInt8Array
from lilgym_mp.choices import choose
from lilgym_mp.envs.proposer_verifier.states import (
    AGENTS,
    PROPOSER,
    VERIFIER,
    GameState,
    GameStep,
    Intent,
    Judgement,
    Role,
)
from lilgym_mp.envs.proposer_verifier.views import GameSetup, Part, Value, make_parts
from lilgym_mp.envs.single import end_info
from lilgym_mp.envs.window import RENDER_FPS, Window
from lilgym_mp.render import text
from lilgym_mp.render.frames import frame
from lilgym_mp.rules import State

RENDER_MODES = {mode: mode for mode in ("human", "rgb_array", "ansi")}
NO_ILLEGAL_CHOICES = (False, False)
INTENTS: Mapping[str, Intent] = {intent.name.lower(): intent for intent in Intent}

AgentObservation = dict[str, Any]  # {"observation": {part: array}, "action_mask": int8 (actions,)}
Info = dict[str, Any]


def agent_spaces(parts: Mapping[str, Part], action_count: int) -> tuple[spaces.Dict, spaces.Discrete]:
    """New spaces of an agent's observations and actions."""
    seen = spaces.Dict({key: part.space for key, part in parts.items()})
    mask = spaces.Box(0, 1, (action_count,), np.int8)
    return spaces.Dict({"observation": seen, "action_mask": mask}), spaces.Discrete(action_count)


def chosen_intent(options: Mapping[str, Any]) -> Intent | None:
    """The intent that the options of a reset name. Raises ValueError naming the choices."""
    return choose("intent", options["intent"], INTENTS) if "intent" in options else None


def truth_info(setup: GameSetup, mdp: State, intent: Intent, judgement: Judgement | None = None) -> Info:
    """What infos tell of the truth, after a turn in which the verifier judged a claim or did not."""
    info: Info = {
        "truth": mdp.task.truth(mdp.scene),
        "goal_reached": setup.game.conditions.dynamics.goal_reached(mdp),
        "intent": intent.name.lower(),
    }
    if judgement is not None:
        info["judgement"] = {"probability": judgement.probability, "holds": judgement.holds}
    return info


def both_infos(shared: Info, illegal: tuple[bool, bool]) -> tuple[Info, Info]:
    """Each agent's own, with what both are told; `illegal`: whose choice was."""
    proposer, verifier = shared, shared.copy()
    if illegal[0]:
        proposer["illegal_choice"] = True
    if illegal[1]:
        verifier["illegal_choice"] = True
    return proposer, verifier


class Session:
    """A world's current game, its random generator, and the encoders of observations."""

    def __init__(self, setup: GameSetup, render_mode: str | None = None) -> None:
        self.setup = setup
        self.game = setup.game
        self.render_mode = None if render_mode is None else choose("render_mode", render_mode, RENDER_MODES)
        self.rng, _ = seeding.np_random()
        self.parts = make_parts(setup)
        alike = {key for key, part in self.parts[PROPOSER].items() if self.parts[VERIFIER].get(key) is part}
        encoders = [[(key, part.encode, key in alike) for key, part in parts.items()] for parts in self.parts]
        self._alike = [(key, encode) for key, encode, both in encoders[PROPOSER] if both]
        self._own = tuple([(key, encode) for key, encode, both in own if not both] for own in encoders)
        self._seen_alike: dict[str, Value] = {}
        self._seen_state: GameState | None = None  # the state of what is there
        self.last: GameStep | None = None
        self._state: GameState | None = None
        self._last_actions: str = ""
        self._window: Window | None = None

    @property
    def state(self) -> GameState:
        """Raises ResetNeeded before the first reset."""
        if self._state is None:
            raise ResetNeeded("there is no game before the first reset; call reset first")
        return self._state

    def reset(self, seed: int | None, options: Mapping[str, Any] | None) -> tuple[Info, Info]:
        """Starts a game and gives both agents' infos.

        Options: "task", an id, and "intent", "helpful" or "sneaky"; others are ignored, as PettingZoo's test demands.
        """
        if seed is not None:
            self.rng, _ = seeding.np_random(seed)
        setup, options = self.setup, options or {}
        task = setup.tasks.by_id(options["task"]) if "task" in options else setup.tasks[setup.drawn_task(self.rng)]
        intent = chosen_intent(options)
        state = self._state = self.game.start(task, setup.drawn_intent(self.rng) if intent is None else intent)
        self.last = None
        self._last_actions = ""
        if self.render_mode is not None:
            self._show()
        info = {"task": task.id}
        if setup.reveals_truth:
            info |= truth_info(setup, state.mdp, state.intent)
        return info, info.copy()

    def play(self, proposer: SupportsIndex | None, verifier: SupportsIndex | None) -> GameStep:
        """One turn. Raises ResetNeeded before reset and after the end; otherwise as `Game.play`."""
        state = self._state
        if state is None or not state.movers:
            when = "there is no game before the first reset" if state is None else "the game is over"
            raise ResetNeeded(f"{when}; call reset before acting")
        step = self.last = self.game.play(state, proposer, verifier)
        self._state = step.state
        if self.render_mode is not None:
            self._remember(proposer, verifier)
            self._show()
        return step

    def play_together(self, proposer: SupportsIndex, verifier: SupportsIndex) -> tuple[GameStep, tuple[Info, Info]]:
        """One turn to which both bring an action, and their infos. Where they take turns, what the agent whose turn
        it is not brings is ignored, and is an illegal choice unless it waits."""
        game = self.game
        if not game.takes_turns:
            step = self.play(proposer, verifier)
            return step, self.infos(step)
        if VERIFIER in self.state.movers:
            idle, waits = PROPOSER, game.waits(PROPOSER, proposer)
            step = self.play(None, verifier)
        else:
            idle, waits = VERIFIER, game.waits(VERIFIER, verifier)
            step = self.play(proposer, None)
        infos = self.infos(step)
        if not waits:
            infos[idle]["illegal_choice"] = True
        return step, infos

    def infos(self, step: GameStep) -> tuple[Info, Info]:
        """Both agents' infos after a turn: what the end was, whose choice was illegal, the truth when asked for."""
        state, played, reveals_truth = step.state, step.played, self.setup.reveals_truth
        if state.movers and not reveals_truth and step.illegal == NO_ILLEGAL_CHOICES:
            return {}, {}
        shared: Info = {}
        if reveals_truth:
            shared = truth_info(self.setup, state.mdp, state.intent, step.judgement)
        if played is not None and not state.movers:
            shared |= end_info(played)
        return both_infos(shared, step.illegal)

    def observe_both(self) -> tuple[AgentObservation, AgentObservation]:
        """By Role. Arrays of what both see alike are the same ones."""
        state, game = self.state, self.game
        seen: dict[str, Value] = {}
        for key, encode in self._alike:
            seen[key] = encode(state)
        also_seen = seen.copy()
        proposers, verifiers = self._own
        for key, encode in proposers:
            seen[key] = encode(state)
        for key, encode in verifiers:
            also_seen[key] = encode(state)
        return (
            {"observation": seen, "action_mask": game.legal_mask(state, PROPOSER)},
            {"observation": also_seen, "action_mask": game.legal_mask(state, VERIFIER)},
        )

    def observe(self, role: Role) -> AgentObservation:
        """Arrays of what both see alike are the same ones for both, as long as the state stays."""
        return {"observation": self.see(role), "action_mask": self.game.legal_mask(self.state, role)}

    def see(self, role: Role) -> dict[str, Any]:
        """The parts of an observation."""
        state = self.state
        if state is not self._seen_state:
            self._seen_alike = {key: encode(state) for key, encode in self._alike}
            self._seen_state = state
        seen = self._seen_alike.copy()
        for key, encode in self._own[role]:
            seen[key] = encode(state)
        return seen

    def spaces(self, role: Role) -> tuple[spaces.Dict, spaces.Discrete]:
        """New spaces of the observations and the actions of `role`."""
        return agent_spaces(self.parts[role], self.game.action_counts[role])

    def _remember(self, *actions: SupportsIndex | None) -> None:
        said = [
            f"{AGENTS[role]}: {self.game.describe(role, action)}"
            for role, action in zip(Role, actions, strict=True)
            if action is not None
        ]
        self._last_actions = ";  ".join(said)

    def render(self) -> UInt8Array | str | None:
        """By render mode: an (304, 784, 3) picture with a caption, a text, or None after showing a window."""
        if self.render_mode == "ansi":
            return text(self.state.mdp.scene, self._caption())
        if self.render_mode == "rgb_array":
            return frame(self.state.mdp.scene, self._caption())
        self._show()
        return None

    def _show(self) -> None:
        if self.render_mode == "human":
            if self._window is None:
                self._window = Window(RENDER_FPS)
            self._window.show(frame(self.state.mdp.scene, self._caption()))

    def _caption(self) -> list[str]:
        mdp, last = self.state.mdp, self.last
        horizon = self.game.conditions.dynamics.horizon
        lines = [
            mdp.task.statement,
            f"Make it {mdp.task.target}.  Round {mdp.steps} of {horizon}.  {self._last_actions}",
        ]
        if last is not None and last.played is not None:
            outcome, rewards = last.played.outcome, " and ".join(f"{reward:+.1f}" for reward in last.rewards)
            lines.append(f"{outcome}, rewards {rewards}")
        return lines

    def close(self) -> None:
        if self._window is not None:
            self._window.close()
            self._window = None
