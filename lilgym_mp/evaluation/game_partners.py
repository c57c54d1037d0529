"""Partners in the two-agent game that need the solver, and the partners that trained agents are evaluated with."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lilgym_mp.envs.proposer_verifier import (
    SCRIPTED,
    BatchTurn,
    GameSettings,
    Intent,
    OracleVerifier,
    Partner,
    PartnerError,
    PartnerTurn,
    Role,
)
from lilgym_mp.envs.proposer_verifier.observations import ObservedGames
from lilgym_mp.envs.proposer_verifier.partners import BatchPartner, batch_actions
from lilgym_mp.envs.proposer_verifier.protocols import ACCEPT, NO_CHOICE, PROPOSER, REJECT, STOP_ACTION, VERIFIER
from lilgym_mp.envs.rules import Dynamics, State
from lilgym_mp.evaluation import Observations, Policy
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import STOP
from lilgym_mp.scene.arrays import Int64Array
from lilgym_mp.scene.choices import choose
from lilgym_mp.scene.render import draw
from lilgym_mp.solver import Solver

TARGET_ONLY = "target-only"  # the baseline in every evaluation of verifiers
NOISY_ORACLE = "oracle-10"
GUIDE = "guide"
BUILDER = "builder"
SILENCED, RANDOM = MESSAGE_CHANGES = ("silenced", "random")
SCRIPTED_PROPOSERS = ("expert", "expert-deceptive", "helpful", "deceptive", "random", BUILDER)


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
        first, length = self.plan(state.mdp)
        claim = game.encode_action(PROPOSER, STOP_ACTION)
        is_deceptive = (state.intent if self._intent is None else self._intent) is Intent.DECEPTIVE
        chosen = game.encode_action(PROPOSER, first)
        if is_deceptive and length == 2:
            chosen = claim
        leaves_solution = first == STOP_ACTION and (is_deceptive or not turn.action_mask[claim])
        if leaves_solution or not turn.action_mask[chosen]:
            return turn.random_edit()
        return chosen

    def plan(self, mdp: State) -> tuple[int, int]:
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


class Guide(BatchPartner):
    """A verifier that says the number of the expert's next action: an edit's own, or for STOP the number of actions.

    It accepts exactly what the expert would do, and speaks about the scene that its answer leaves. In a simultaneous
    protocol that is the scene after the edit that a `Builder` makes in the same turn.
    """

    def __init__(self, dynamics: Dynamics) -> None:
        """Raises ValueError for an appearance without a solver."""
        self._dynamics = dynamics
        self._plan = ExpertProposer(dynamics).plan

    def __repr__(self) -> str:
        return "Guide()"

    def batch(self, turn: BatchTurn) -> Int64Array:
        """(k,) answers with messages. Raises PartnerError for a game with too few messages."""
        needed = self._dynamics.appearance.action_count
        size = turn.game.message_sizes[VERIFIER]
        if size < needed:
            raise PartnerError(
                f"{self!r} needs message_size {needed} for verifier_0, one for each edit and one for STOP; this game"
                f" has {size}"
            )
        return np.array([self._answer(turn, index) for index in turn.indices.tolist()], np.int64)

    def _answer(self, turn: BatchTurn, index: int) -> int:
        mdp = turn.games.mdp(index)
        proposal = int(turn.games.proposals[index])
        wanted, _ = self._plan(mdp)
        if turn.game.turn_based:
            accepts = proposal == wanted
            played = proposal if accepts else STOP_ACTION
        else:
            accepts = wanted == STOP_ACTION and mdp.task.solved_by(mdp.scene)
            played = told_action(turn.games, index)
        if played != STOP_ACTION:
            action = self._dynamics.appearance.decode(played)
            wanted, _ = self._plan(self._dynamics.step(mdp._replace(steps=0), action).state)
        message = wanted if wanted != STOP_ACTION else self._dynamics.appearance.action_count
        return turn.game.encode_action(VERIFIER, ACCEPT if accepts else REJECT, message)


class Builder(BatchPartner):
    """A proposer that does what a `Guide` tells it: without a word, or if that is illegal, the first legal action."""

    def __repr__(self) -> str:
        return "Builder()"

    def batch(self, turn: BatchTurn) -> Int64Array:
        """(k,) proposals without a message."""
        told = np.array([told_action(turn.games, index) for index in turn.indices.tolist()], np.int64)
        return turn.game.encode_action(PROPOSER, 1) * told


def told_action(games: ObservedGames, index: int) -> int:
    """The MDP's action that the verifier's last message names; without one that is legal, the first legal action."""
    count = games.game.dynamics.appearance.action_count
    message = int(games.messages[VERIFIER, index])
    legal = games.legal()[index].copy()
    if not games.game.protocol.proposer_may_stop:
        legal[STOP_ACTION] = False
    told = message % count if 0 < message <= count else NO_CHOICE
    return told if told != NO_CHOICE and legal[told] else int(legal.argmax())


class ChangedMessages(BatchPartner):
    """A partner whose messages are replaced: by silence, or at random."""

    def __init__(self, partner: Partner, change: str) -> None:
        """`change`: a name in MESSAGE_CHANGES."""
        self._partner = partner
        self._change = choose("change of messages", change, {name: name for name in MESSAGE_CHANGES})

    def __repr__(self) -> str:
        return f"ChangedMessages({self._partner!r}, {self._change!r})"

    def batch(self, turn: BatchTurn) -> Int64Array:
        """(k,) actions with the partner's choices."""
        actions = batch_actions(self._partner, turn)
        size = turn.game.message_sizes[turn.role] + 1
        speaks = actions < turn.game.choices[turn.role].stop * size  # not "wait", which has no message
        messages = (turn.uniform() * size).astype(np.int64) if self._change == RANDOM else np.zeros_like(actions)
        return np.where(speaks, actions // size * size + messages, actions)


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
        legal = games.legal()[indices] if self._policy.needs_masks else np.zeros((len(states), 0), bool)
        chosen = self._policy(observations, legal, turn.rngs[0])
        if turn.role is PROPOSER:
            actions = turn.game.encode_action(PROPOSER, 1) * chosen
            is_legal = turn.are_legal(actions)
            return actions if is_legal.all() else np.where(is_legal, actions, turn.random_actions())
        return turn.answers(turn.is_edit | (chosen == STOP_ACTION))


def scripted_proposers(dynamics: Dynamics) -> Mapping[str, Partner]:
    """Returns the scripted proposers by name."""
    return {
        "expert": ExpertProposer(dynamics),
        "expert-deceptive": ExpertProposer(dynamics, Intent.DECEPTIVE),
        **{name: SCRIPTED[name] for name in ("helpful", "deceptive", "random")},
        BUILDER: Builder(),
    }


def scripted_verifiers(dynamics: Dynamics) -> Mapping[str, Partner]:
    """Returns the scripted verifiers by name."""
    return {**SCRIPTED_VERIFIERS, GUIDE: Guide(dynamics)}


def scripted_partners(game: GameSettings) -> dict[Role, dict[str, Partner]]:
    """The scripted partners by role and name, without those that need more messages than the game has."""
    dynamics = game.dynamics()
    known = {PROPOSER: dict(scripted_proposers(dynamics)), VERIFIER: dict(scripted_verifiers(dynamics))}
    if not can_guide(game):
        del known[PROPOSER][BUILDER], known[VERIFIER][GUIDE]
    return known


def can_guide(game: GameSettings) -> bool:
    """Whether a game has the messages that a `Guide` needs."""
    return game.message_sizes()[VERIFIER] >= game.dynamics().appearance.action_count


SCRIPTED_VERIFIERS: Mapping[str, Partner] = {
    "oracle": SCRIPTED["oracle"],
    NOISY_ORACLE: OracleVerifier(0.1),
    TARGET_ONLY: SCRIPTED["target_only"],
    "always-accept": SCRIPTED["always_accept"],
    "always-reject": SCRIPTED["always_reject"],
    "random": SCRIPTED["random"],
}
