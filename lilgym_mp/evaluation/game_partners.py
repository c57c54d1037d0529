"""Partners in the two-agent game that need the solver, and the partners that trained agents are evaluated with."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lilgym_mp.envs.proposer_verifier import SCRIPTED, BatchTurn, Intent, OracleVerifier, Partner, PartnerTurn, Role
from lilgym_mp.envs.proposer_verifier.partners import BatchPartner
from lilgym_mp.envs.proposer_verifier.protocols import STOP_ACTION
from lilgym_mp.envs.rules import Dynamics, State
from lilgym_mp.evaluation import Observations, Policy
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import STOP
from lilgym_mp.scene.arrays import Int64Array
from lilgym_mp.scene.render import draw
from lilgym_mp.solver import Solver

TARGET_ONLY = "target-only"  # the baseline in every evaluation of verifiers
NOISY_ORACLE = "oracle-10"


class ExpertProposer:
    """Follows a shortest plan, and claims where a claim has the truth value that it seeks.

    `intent`: a helpful expert claims in a solution; a deceptive one claims falsely where one edit is missing, so that
    its claim is plausible, and leaves solutions by a random edit. None: the episode's intent.
    """

    def __init__(self, dynamics: Dynamics, intent: Intent | None = Intent.HELPFUL) -> None:
        """Raises ValueError for an appearance without a solver."""
        self._dynamics = dynamics
        self._intent = intent
        self._solver = Solver(dynamics)
        self._plans: dict[tuple[str, bool, Scene], tuple[int, int]] = {}  # by program, target and scene

    def __repr__(self) -> str:
        return f"ExpertProposer({'by intent' if self._intent is None else self._intent.name.lower()})"

    def __call__(self, turn: PartnerTurn) -> int:
        state = turn.state
        game = turn.game
        first, length = self._plan(state.mdp)
        claim = game.encode_action(Role.PROPOSER, STOP_ACTION)
        is_deceptive = (state.intent if self._intent is None else self._intent) is Intent.DECEPTIVE
        chosen = game.encode_action(Role.PROPOSER, first)
        if is_deceptive and length == 2:
            chosen = claim
        leaves_solution = first == STOP_ACTION and (is_deceptive or not turn.action_mask[claim])
        if leaves_solution or not turn.action_mask[chosen]:
            return turn.random_edit()
        return chosen

    def _plan(self, mdp: State) -> tuple[int, int]:
        """The first action of a shortest solution, and its number of actions; STOP, 0 if none is found."""
        appearance = self._dynamics.appearance
        task = mdp.task
        key = (task.program, task.target, mdp.scene)
        if key not in self._plans:
            actions = self._solver.solve_from(mdp._replace(steps=0)).actions or ()
            self._plans[key] = (STOP_ACTION, 0)
            state = mdp._replace(steps=0)
            for done, action in enumerate(actions):
                self._plans[task.program, task.target, state.scene] = appearance.encode(action), len(actions) - done
                if action != STOP:
                    state = self._dynamics.step(state, action).state
        return self._plans[key]


class AgentPartner(BatchPartner):
    """A single-agent trained agent in one seat.

    It acts on the half-size image, the statement and the target, whatever its seat's view: a proposer proposes the
    action it would take, a verifier accepts a claim exactly where it would itself STOP, and accepts every edit.
    """

    def __init__(self, policy: Policy) -> None:
        self._policy = policy

    def batch(self, turn: BatchTurn) -> Int64Array:
        games = turn.games
        indices = turn.indices
        states = [games.mdp(index) for index in indices.tolist()]
        observations = Observations(
            np.stack([draw(state.scene, "half") for state in states]),
            tuple(state.task.statement for state in states),
            np.array([int(state.task.target) for state in states]),
            np.array([state.steps for state in states]),
            turn.episodes,
        )
        legal = games.legal()[indices] if self._policy.needs_masks else np.zeros((len(states), 0), np.bool_)
        chosen = self._policy(observations, legal, turn.rngs[0])
        if turn.role is Role.PROPOSER:
            actions = turn.game.encode_action(Role.PROPOSER, 1) * chosen
            is_legal = turn.action_mask[np.arange(len(actions)), actions] > 0
            return actions if is_legal.all() else np.where(is_legal, actions, turn.random_actions())
        return turn.answers(turn.is_edit | (chosen == STOP_ACTION))


def scripted_proposers(dynamics: Dynamics) -> Mapping[str, Partner]:
    """Returns the scripted proposers by name."""
    return {
        "expert": ExpertProposer(dynamics),
        "expert-deceptive": ExpertProposer(dynamics, Intent.DECEPTIVE),
        **{name: SCRIPTED[name] for name in ("helpful", "deceptive", "random")},
    }


SCRIPTED_VERIFIERS: Mapping[str, Partner] = {
    "oracle": SCRIPTED["oracle"],
    NOISY_ORACLE: OracleVerifier(0.1),
    TARGET_ONLY: SCRIPTED["target_only"],
    "always-accept": SCRIPTED["always_accept"],
    "always-reject": SCRIPTED["always_reject"],
    "random": SCRIPTED["random"],
}
