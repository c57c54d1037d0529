"""One game in play: what the AEC, parallel, batched and single-agent forms share. It knows no rule of the game."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, SupportsIndex

import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding

from lilgym_mp.choices import choose
from lilgym_mp.envs.proposer_verifier.states import (
    AGENTS,
    PROPOSER,
    VERIFIER,
    GameState,
    GameStep,
    Intent,
    Role,
)
from lilgym_mp.envs.proposer_verifier.views import World, make_parts
from lilgym_mp.envs.single import end_info
from lilgym_mp.envs.window import Window
from lilgym_mp.render import UInt8Array, frame, text
from lilgym_mp.rules import Outcome

RENDER_FPS = 4
RENDER_MODES = {mode: mode for mode in ("human", "rgb_array", "ansi")}
INTENTS: Mapping[str, Intent] = {intent.name.lower(): intent for intent in Intent}

AgentObservation = dict[str, Any]  # {"observation": {part: array}, "action_mask": int8 (actions,)}
Info = dict[str, Any]


class Session:
    """A world's current game, its random generator, and the encoders of observations."""

    def __init__(self, world: World, render_mode: str | None = None, pixels: UInt8Array | None = None) -> None:
        """`pixels`: an image buffer to draw into; observations then hold it, not copies of it."""
        self.world = world
        self.game = world.game
        self.render_mode = None if render_mode is None else choose("render_mode", render_mode, RENDER_MODES)
        self.rng, _ = seeding.np_random()
        self.parts = make_parts(world, pixels)
        self._encoders = tuple([(key, part.encode) for key, part in parts.items()] for parts in self.parts)
        self.last: GameStep | None = None
        self._state: GameState | None = None
        self._heard: str = ""
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
        options = options or {}
        tasks = self.world.tasks
        task = tasks.by_id(options["task"]) if "task" in options else tasks[int(self.rng.integers(len(tasks)))]
        self._state = self.game.start(task, self._intent(options))
        self.last = None
        self._heard = ""
        self._show()
        info = {"task": task.id, **self._truth(self._state)}
        return info, dict(info)

    def _intent(self, options: Mapping[str, Any]) -> Intent:
        if "intent" in options:
            return choose("intent", options["intent"], INTENTS)
        rewards = self.game.rewards
        if rewards.draws_intent:
            return Intent(int(self.rng.random() < self.world.sneaky_share))
        return Intent.SNEAKY if rewards.uses("sneaky", PROPOSER) else Intent.HELPFUL

    def play(self, proposer: SupportsIndex | None, verifier: SupportsIndex | None) -> GameStep:
        """One turn. Raises ResetNeeded before reset and after the end; otherwise as `Game.play`."""
        state = self.state
        if not state.movers:
            raise ResetNeeded("the game is over; call reset before acting again")
        step = self.game.play(state, proposer, verifier)
        self._state, self.last = step.state, step
        if self.render_mode is not None:
            self._remember(proposer, verifier)
            self._show()
        return step

    def play_together(self, proposer: SupportsIndex, verifier: SupportsIndex) -> tuple[GameStep, tuple[Info, Info]]:
        """One turn to which both bring an action, and their infos. Where they take turns, what the agent whose turn
        it is not brings is ignored, and is an illegal choice unless it waits."""
        state = self.state
        if len(state.movers) != 1:
            step = self.play(proposer, verifier)
            return step, self.infos(step)
        game, idle = self.game, state.movers[0].other
        if idle is VERIFIER:
            waits = game.checked(idle, verifier) == game.wait_action(idle)
            step = self.play(proposer, None)
        else:
            waits = game.checked(idle, proposer) == game.wait_action(idle)
            step = self.play(None, verifier)
        infos = self.infos(step)
        if not waits:
            infos[idle]["illegal_choice"] = True
        return step, infos

    def infos(self, step: GameStep) -> tuple[Info, Info]:
        """Both agents' infos after a turn: what the end was, whose choice was illegal, the truth when asked for."""
        if step.state.movers and not self.world.reveals_truth and step.illegal == (False, False):
            return {}, {}
        shared = self._truth(step.state)
        if self.world.reveals_truth and step.judgement is not None:
            judgement = step.judgement
            shared["judgement"] = {"probability": judgement.probability, "holds": judgement.holds}
        if step.played is not None and step.played.outcome is not Outcome.CONTINUES:
            shared |= end_info(step.played)
        proposer, verifier = (
            {**shared, "illegal_choice": True} if illegal else dict(shared) for illegal in step.illegal
        )
        return proposer, verifier

    def _truth(self, state: GameState) -> Info:
        if not self.world.reveals_truth:
            return {}
        task, scene = state.mdp.task, state.mdp.scene
        return {
            "truth": task.truth(scene),
            "goal_reached": self.game.conditions.dynamics.goal_reached(state.mdp),
            "intent": state.intent.name.lower(),
        }

    def observe(self, role: Role) -> AgentObservation:
        state = self.state
        return {
            "observation": {key: encode(state) for key, encode in self._encoders[role]},
            "action_mask": self.game.legal_mask(state, role),
        }

    def see(self, role: Role) -> dict[str, Any]:
        """The parts of an observation."""
        state = self.state
        return {key: encode(state) for key, encode in self._encoders[role]}

    def spaces(self, role: Role) -> tuple[spaces.Dict, spaces.Discrete]:
        """New spaces of the observations and the actions of `role`."""
        count = self.game.action_counts[role]
        parts = spaces.Dict({key: part.space for key, part in self.parts[role].items()})
        mask = spaces.Box(0, 1, (count,), np.int8)
        return spaces.Dict({"observation": parts, "action_mask": mask}), spaces.Discrete(count)

    def _remember(self, *actions: SupportsIndex | None) -> None:
        said = [
            f"{AGENTS[role]}: {self.game.describe(role, action)}"
            for role, action in zip(Role, actions, strict=True)
            if action is not None
        ]
        self._heard = ";  ".join(said)

    def render(self) -> UInt8Array | str | None:
        """By render mode: an (288, 760, 3) picture with a caption, a text, or None after showing a window."""
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
        lines = [mdp.task.statement, f"Make it {mdp.task.target}.  Round {mdp.steps} of {horizon}.  {self._heard}"]
        if last is not None and last.played is not None:
            outcome, rewards = last.played.outcome, " and ".join(f"{reward:+.1f}" for reward in last.rewards)
            lines.append(f"{outcome}, rewards {rewards}")
        return lines

    def close(self) -> None:
        if self._window is not None:
            self._window.close()
            self._window = None
