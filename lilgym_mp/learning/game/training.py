"""Runs that train one or both agents of the game. The update is `common.update`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, Unpack

import numpy as np
import torch
from torch import Tensor, nn

from lilgym_mp.corpus import Vocabulary
from lilgym_mp.envs.proposer_verifier import AGENTS, GameSettings, Partner, Role
from lilgym_mp.envs.proposer_verifier.game import Game
from lilgym_mp.envs.proposer_verifier.protocols import PROPOSER, VERIFIER
from lilgym_mp.evaluation.game_partners import (
    BUILDER,
    GUIDE,
    SCRIPTED_PROPOSERS,
    SCRIPTED_VERIFIERS,
    can_guide,
    scripted_proposers,
    scripted_verifiers,
)
from lilgym_mp.learning.common.agents import SHARED, AgentError, agent_file, open_agent
from lilgym_mp.learning.common.box_transformer import BoxTransformer
from lilgym_mp.learning.common.model_file import weights_digest
from lilgym_mp.learning.common.optimisation import optimise
from lilgym_mp.learning.common.run import Budget, Counters, Session, TrainingRun, training
from lilgym_mp.learning.common.tasks import training_tasks
from lilgym_mp.learning.common.update import Experience, Losses, make_optimiser, mean_losses, schedule, update
from lilgym_mp.learning.game.agent import GameAgent, load_agent, network_names
from lilgym_mp.learning.game.claims import ClaimMemory, claim_loss
from lilgym_mp.learning.game.network import AgentPolicy, GameNetwork
from lilgym_mp.learning.game.recipe import GameRecipe
from lilgym_mp.learning.game.rollout import Rollout, RolloutPlayer, Seen, Situation, own_turn_advantages
from lilgym_mp.learning.game.situations import check_claims
from lilgym_mp.scene.arrays import AnyDict, BoolArray, Int64Array

TEXT_LAYERS = 1
HEADS = 2
MOST_UNFINISHED = 0.1  # share of games without an end in a rollout; with more, a run warns


class GameProgress(NamedTuple):
    """A line of progress.jsonl: statistics of one rollout and its updates."""

    steps: int  # turns so far
    games: int  # so far
    cpu_seconds: float  # CPU time of this process so far
    turns_per_second: float  # per second of CPU time, in this rollout
    success: float | None  # of the games that ended; None without any
    returns: list[float] | None  # mean returns of both agents
    true_accept_rate: float | None  # share of judged true claims that were accepted
    false_accept_rate: float | None  # share of judged false claims that were accepted
    j: float | None  # their difference, averaged over the targets
    unfinished: float  # share of the games played side by side of which none ended in the rollout
    losses: dict[str, dict[str, float]]  # by network: policy, value, entropy, clipped
    claim_loss: float | None
    claim_accuracy: float | None

    @property
    def note(self) -> str:
        """Speed, success, J and unfinished games, for the line in the terminal."""
        success, j = (
            "-" if share is None else f"{100 * share:.0f}{unit}" for share, unit in ((self.success, " %"), (self.j, ""))
        )
        unfinished = f", {100 * self.unfinished:.0f} % unfinished" if self.unfinished > MOST_UNFINISHED else ""
        return f"{self.turns_per_second:,.0f}/s, success {success}, J {j}{unfinished}"


@dataclass
class GameCounters(Counters):
    """The counters of a run of the game."""

    steps: int = 0  # turns of all games
    games: int = 0


class GameRun(TrainingRun):
    """Trains agents of the game until `minutes` of CPU time or `steps` turns are spent, whichever is first.

    `proposers`, `verifiers`: run directories or partners; an agent that has any does not learn, and each game is played
    with one of them. `start_from`: a run of `ppo` or of this learner, with whose weights the networks start. `out`,
    signals and errors as for PPO; with `steps` alone, a resumed run trains the same agents as an uninterrupted one.
    """

    saves_agent_early = reports_every_step = True

    def __init__(
        self,
        settings: GameSettings,
        recipe: GameRecipe,
        out: Path,
        *,
        minutes: float | None = None,
        steps: int | None = None,
        proposers: Sequence[Path | Partner] | None = None,
        verifiers: Sequence[Path | Partner] | None = None,
        start_from: Path | None = None,
        **session: Unpack[Session],
    ) -> None:
        super().__init__(out, Budget("steps", steps, minutes), session)
        self.counters: GameCounters = GameCounters()
        self.settings = settings = replace(settings, split="train", reveal_truth=True)
        self.recipe = recipe
        named = {PROPOSER: proposers, VERIFIER: verifiers}
        partners = {role: found for role, found in named.items() if found}
        self.roles = [role for role in Role if role not in partners]
        if not self.roles:
            raise ValueError("no agent is left to learn: name partners for one of them only")
        self.tasks = training_tasks(settings.single(), recipe)
        game = Game(settings).with_tasks(self.tasks.tasks)
        check_claims(game)
        opened = {
            role: [_partner(one, role, settings, str(self.device)) for one in given] for role, given in partners.items()
        }
        given = {} if start_from is None else open_agent(start_from, "cpu").box_transformers()
        torch.manual_seed(recipe.seed)
        self._actors = self._make_networks(given, game)
        self._critics = self._make_networks(given, game.showing_everything()) if recipe.critic == "central" else {}
        critics = {f"critic_{name}": network for name, network in self._critics.items()}
        self.networks = nn.ModuleDict({**self._actors, **critics}).to(self.device)
        self.trained_parameters = sum(network.trained_parameters for network in self._actors.values())
        identity = {
            "learner": GameAgent.kind,
            "game": settings.to_json(),
            "recipe": recipe.to_json(),
            "tasks_sha256": self.tasks.sha256,
            "partners": {role.name.lower(): list(map(_partner_identity, given)) for role, given in partners.items()},
            "start_from": None if start_from is None else str(start_from),
            "start_sha256": None if start_from is None else weights_digest(agent_file(start_from)),
        }
        self.begin(identity)
        self._network_of = network_names(self.roles, recipe)
        self._optimisers = {name: make_optimiser(nn.ModuleList(self._networks(name)), recipe) for name in self._actors}
        self._rng = np.random.default_rng(recipe.seed)
        self._player = RolloutPlayer(game, self.tasks, recipe, opened)
        self._memory = ClaimMemory(recipe)
        self._has_warned = False  # of games that do not end
        self.load()

    def _make_networks(self, given: Mapping[str, BoxTransformer], game: Game) -> dict[str, GameNetwork]:
        """The agents' networks by name, which start with the weights given."""
        recipe = self.recipe
        vocabulary = Vocabulary.from_statements(self.tasks.statements)
        sizes = {"width": recipe.width, "text_layers": TEXT_LAYERS, "heads": HEADS}
        for network in given.values():
            vocabulary = network.vocabulary
            sizes = network.sizes
            if recipe.width != sizes["width"]:
                raise ValueError(f"the agents to start from have width {sizes['width']}, not {recipe.width}")
        names = dict.fromkeys(network_names(self.roles, recipe).values())
        sizes = {**sizes, "messages_see_boxes": True}
        networks = {name: GameNetwork(game, vocabulary, recipe, **sizes) for name in names}
        for name, network in networks.items():
            if (start := given.get(name, given.get(SHARED))) is not None:
                network.load_state_dict(start.state_dict(), strict=False)
        return networks

    def introduction(self) -> str:
        settings = self.settings
        recipe = self.recipe
        learners = [AGENTS[role] for role in self.roles]
        learning = f"{learners[0]} learns" if len(learners) == 1 else f"{' and '.join(learners)} learn"
        return (
            f"{settings.protocol}, rewards {settings.rewards}, corpus {settings.corpus}, {len(self.tasks.tasks):,}"
            f" training tasks; {learning}, {recipe.algorithm}, verifier by"
            f" {recipe.verifier}\n"
            f"{self.trained_parameters:,} trained parameters, seed {recipe.seed}; run directory: {self.out}"
        )

    def _evaluate(
        self, role: Role, situations: Sequence[Situation], legal: BoolArray | None, rows: Sequence[Tensor] = ()
    ) -> tuple[AgentPolicy, Tensor]:
        """The policy and values of an agent in `rows` of each situation's states, by default all."""
        networks = self._networks(self._network_of[role])
        encoded = [network.encode(one.states) for network, one in zip(networks, situations, strict=True)]
        encoded = [states.rows(some) for states, some in zip(encoded, rows, strict=True)] if rows else encoded
        policy, values = networks[0].policy(role, encoded[0], situations[0].context, legal)
        if self._critics:
            values = networks[1].values(encoded[1], situations[1].context)
        return policy, values

    def _networks(self, name: str) -> list[GameNetwork]:
        """An agent's network, and its critic if that is central."""
        return [self._actors[name], self._critics[name]] if self._critics else [self._actors[name]]

    # Learning

    def step(self) -> GameProgress:
        """Plays a rollout and learns from it."""
        start = self.seconds()
        entropy_coefficient = 0.0
        for optimiser in self._optimisers.values():
            entropy_coefficient = schedule(optimiser, self.recipe, self.progress())
        self.networks.eval()
        rollout = self._player.play(self._evaluate, self._rng)
        self.networks.train()
        for network in (*self._actors.values(), *self._critics.values()):
            network.clear_cache()
        losses: dict[str, Losses] = {}
        for name, optimiser in self._optimisers.items():
            if (experience := self._experience(name, rollout)) is not None:
                found = update(experience, optimiser, self.recipe, entropy_coefficient, self._rng)
                losses[name] = mean_losses(found)
        claim_losses = self._learn_claims(rollout)
        self._warn_of_unfinished(rollout)
        self.counters.steps += self.recipe.rollout
        return self._progress(rollout, losses, claim_losses, start)

    def _experience(self, name: str, rollout: Rollout) -> Experience | None:
        """The complete own turns of a network's agents; None if its verifier learns from claims alone."""
        roles = [role for role in self.roles if self._network_of[role] == name]
        if self.recipe.judges_only and VERIFIER in roles:
            roles.remove(VERIFIER)
        if not roles:
            return None
        recipe = self.recipe
        advantages, complete = own_turn_advantages(rollout, recipe.gamma, recipe.gae_lambda)
        complete[[role for role in Role if role not in roles]] = False
        arrays: AnyDict = {
            column: getattr(rollout, column)[complete] for column in ("actions", "log_probabilities", "values")
        }
        role_of, cells = np.divmod(np.flatnonzero(complete), rollout.ended.size)

        def evaluate(rows: Int64Array) -> tuple[_MixedPolicy, Tensor]:
            return self._evaluate_rows(rollout, role_of[rows], cells[rows])

        arrays["forced"] = np.zeros(len(cells), bool)
        statement_of = rollout.statement_of.reshape(-1)[cells]
        return Experience(recipe, arrays, advantages[complete], statement_of, evaluate, self.device)

    def _evaluate_rows(self, rollout: Rollout, role_of: Int64Array, cells: Int64Array) -> tuple[_MixedPolicy, Tensor]:
        """The current policies and values of m turns, given by agent and index in (T, N); scenes that both agents judge
        are encoded once."""
        turns, games = np.divmod(cells, rollout.ended.shape[1])
        whole = [self._situation(rollout, seen, role_of, cells) for seen in rollout.seen]
        policies: list[tuple[Tensor, AgentPolicy]] = []
        values = torch.zeros(len(cells), device=self.device)
        for role in Role:
            mine = np.flatnonzero(role_of == role)
            if not len(mine):
                continue
            legal = None
            if role is PROPOSER and self.recipe.mask:
                legal = rollout.legal[turns[mine], games[mine]]
            situations = [one._replace(context=one.context[mine]) for one, _ in whole]
            encoded = [torch.from_numpy(state_of[mine]).to(self.device) for _, state_of in whole]
            policy, found = self._evaluate(role, situations, legal, encoded)
            rows = torch.from_numpy(mine).to(self.device)
            policies.append((rows, policy))
            values = values.index_copy(0, rows, found)
        return _MixedPolicy(policies), values

    def _situation(
        self, rollout: Rollout, seen: Seen, role_of: Int64Array, cells: Int64Array
    ) -> tuple[Situation, Int64Array]:
        """What was seen in m turns, with distinct states alone, and which of them each turn has (m,)."""
        turns, games = np.divmod(cells, rollout.ended.shape[1])
        boxes_of = seen.boxes_of[role_of, turns, games]
        context = seen.context[role_of, turns, games]
        state_keys = cells  # with equal views both agents see one state in a turn
        if seen.game.views[0] != seen.game.views[1]:
            state_keys = cells + role_of * rollout.ended.size
        _, firsts, state_of = np.unique(state_keys, return_index=True, return_inverse=True)
        statement_of, targets = (each.reshape(-1)[cells[firsts]] for each in (rollout.statement_of, rollout.targets))
        states = rollout.states(seen.game, role_of[firsts], statement_of, boxes_of[firsts], targets)
        return Situation(states, boxes_of, context), state_of

    def _learn_claims(self, rollout: Rollout) -> list[tuple[float, float]]:
        """Optimiser steps on remembered claims; losses and accuracies."""
        if VERIFIER not in self.roles or not self.recipe.learns_claims:
            return []
        name = self._network_of[VERIFIER]
        network = self._actors[name]
        optimiser = self._optimisers[name]
        self._memory.add(rollout.claims)
        found: list[tuple[float, float]] = []
        for claims in self._memory.batches(self._rng):
            loss, accuracy = claim_loss(network, rollout, claims)
            optimise(optimiser, loss, self.recipe.gradient_norm)
            found.append((float(loss.detach()), accuracy))
        return found

    def _progress(
        self, rollout: Rollout, losses: Mapping[str, Losses], claims: list[tuple[float, float]], start: float
    ) -> GameProgress:
        count = int(rollout.ended.sum())
        counters = self.counters
        seconds = self.seconds()
        counters.games += count
        true, false, j = (None if np.isnan(rate) else rate for rate in rollout.claim_rates())
        loss, accuracy = np.mean(claims, axis=0).round(4).tolist() if claims else (None, None)
        return GameProgress(
            steps=counters.steps,
            games=counters.games,
            cpu_seconds=round(seconds, 3),
            turns_per_second=round(self.recipe.rollout / max(1e-9, seconds - start), 1),
            success=int(rollout.successes.sum()) / count if count else None,
            returns=(rollout.returns / count).round(4).tolist() if count else None,
            true_accept_rate=true,
            false_accept_rate=false,
            j=j,
            unfinished=round(rollout.unfinished, 4),
            losses={
                name: {key: round(float(value), 5) for key, value in found._asdict().items() if key != "total"}
                for name, found in losses.items()
            },
            claim_loss=loss,
            claim_accuracy=accuracy,
        )

    def _warn_of_unfinished(self, rollout: Rollout) -> None:
        if self._has_warned or rollout.unfinished <= MOST_UNFINISHED:
            return
        self._has_warned = True
        turns, games = rollout.ended.shape
        self.say(
            f"warning: in a rollout of {turns} turns, {100 * rollout.unfinished:.0f} % of {games} games side by side do"
            " not end, so success is that of short games alone: use fewer --envs or a longer --rollout"
        )

    # Files

    def state(self) -> AnyDict:
        return {
            "networks": self.networks.state_dict(),
            "optimisers": {name: optimiser.state_dict() for name, optimiser in self._optimisers.items()},
            "claims": self._memory.to_json(),
            "random": json.dumps(self._rng.bit_generator.state),
        }

    def restore(self, state: AnyDict) -> None:
        self.networks.load_state_dict(state["networks"])
        for name, optimiser in self._optimisers.items():
            optimiser.load_state_dict(state["optimisers"][name])
        self._memory.restore(state["claims"])
        self._rng.bit_generator.state = json.loads(state["random"])

    def finish(self) -> GameAgent:
        """The agents that learned."""
        settings = self.settings
        recipe = self.recipe
        counters = self.counters
        actors = self._actors
        network = next(iter(actors.values()))
        programs = ", and programs to exchange colours" if recipe.recolour else ""
        supervision = f"rewards of the two-agent game{programs} (corpus {settings.corpus})"
        if VERIFIER in self.roles and recipe.learns_claims:
            supervision += ", truth of claims judged at the end of games"
        supervision += f"; {'illegal proposals masked in training and in play' if recipe.mask else 'no mask'}"
        details = {
            "game": settings.to_json(),
            "roles": [role.name.lower() for role in self.roles],
            "words": list(network.vocabulary.words),
            "sizes": dict(network.sizes),
            "steps": counters.steps,
            "games": counters.games,
            "cpu_minutes": self.minutes(),
            "seed": recipe.seed,
            "trained_parameters": self.trained_parameters,
            "interrupted": self.stop.requested,
        }
        description = GameAgent.describe((settings.configuration,), supervision, recipe.to_json(), details)
        self.networks.eval()
        networks = {role: actors[name] for role, name in self._network_of.items()}
        return GameAgent(description, settings, recipe, networks)


class _MixedPolicy(NamedTuple):
    """Policies of both agents in rows of one mini-batch."""

    policies: list[tuple[Tensor, AgentPolicy]]  # rows and their policy

    def evaluate_actions(self, actions: Tensor) -> tuple[Tensor, Tensor]:
        """(m,) log-probabilities and entropies, in the order of the rows."""
        log_probs = entropies = torch.zeros(len(actions), device=actions.device)
        for rows, policy in self.policies:
            found, entropy = policy.evaluate_actions(actions[rows])
            log_probs = log_probs.index_copy(0, rows, found)
            entropies = entropies.index_copy(0, rows, entropy)
        return log_probs, entropies


train_game = training(GameRun)


def _partner(given: Path | Partner, role: Role, settings: GameSettings, device: str) -> Partner:
    """A scripted partner by name, or that of a run: a proposer samples, a verifier takes the most probable actions."""
    if not isinstance(given, Path):
        return given
    scripted = scripted_verifiers if role is VERIFIER else scripted_proposers
    if (partner := scripted(settings.dynamics()).get(str(given))) is not None:
        if str(given) in (GUIDE, BUILDER) and not can_guide(settings):
            raise AgentError(
                f"{given} needs one message of verifier_0 for each action, as views {GUIDE!r} give it in critique;"
                f" this game has message_size {settings.message_sizes()[VERIFIER]}"
            )
        return partner
    agent = load_agent(agent_file(given), device)
    for name in ("appearance", "protocol", "grid"):
        own = getattr(agent.settings, name)
        wanted = getattr(settings, name)
        if own != wanted:
            raise AgentError(f"{given}: trained on {name} {own!r}; this game has {wanted!r}")
    if agent.settings.message_sizes() != settings.message_sizes():
        own, wanted = (dict(zip(AGENTS, each.message_sizes(), strict=True)) for each in (agent.settings, settings))
        raise AgentError(f"{given}: trained with message_size {own}; this game has {wanted}")
    partner = agent.partner(role, sampled=role is PROPOSER)
    if partner is None:
        raise AgentError(f"{given}: it has no trained {AGENTS[role]}")
    return partner


def _partner_identity(partner: Path | Partner) -> str:
    if not isinstance(partner, Path):
        return repr(partner)
    if str(partner) in (*SCRIPTED_PROPOSERS, *SCRIPTED_VERIFIERS, GUIDE):
        return str(partner)
    return f"{partner}: {weights_digest(agent_file(partner))}"
