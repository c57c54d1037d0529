"""The network and the recipe of `lilgym-mp train ppo` for SB3's PPO and sb3-contrib's MaskablePPO."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from gymnasium import spaces
from sb3_contrib import MaskablePPO
from sb3_contrib.common.maskable.buffers import MaskableDictRolloutBuffer, MaskableDictRolloutBufferSamples
from sb3_contrib.common.maskable.policies import MaskableActorCriticPolicy
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import LinearSchedule
from torch import Tensor

from lilgym_mp.corpus import Vocabulary
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation.results import training_statements
from lilgym_mp.learning.common.agents import AgentError
from lilgym_mp.learning.common.box_transformer import BoxTransformer
from lilgym_mp.learning.common.factored_policy import STOP, FactoredPolicy
from lilgym_mp.learning.common.states import BoxImageTable, States
from lilgym_mp.learning.common.update import mini_batches
from lilgym_mp.learning.ppo.agent import PPOAgent, describe
from lilgym_mp.learning.ppo.learner import PPORecipe
from lilgym_mp.learning.ppo.rollout import policy_and_values
from lilgym_mp.scene.appearances import make_appearance
from lilgym_mp.scene.arrays import AnyDict, AnyMapping
from lilgym_mp.wrappers import structured_observation_v0
from lilgym_mp.wrappers.actions import FORCED_NOW

SCALED = (
    "LilGymPolicy reads {0!r} in whole numbers, as the environment gives it: leave it out of VecNormalize"
    " (norm_obs=False, or norm_obs_keys without it) and of other scaling"
)
OTHER_WORDS = (
    "LilGymPolicy was given other words than those of the environment's token ids: make the environment with"
    " vocabulary=Vocabulary(words), as recipe(...).env does, or pass words=env.get_attr('vocabulary')[0].words"
)
ELSE = "evaluate other models by lilgym_mp.evaluation.evaluate_wrapped"
IMAGE = "image"
ITEMS = "item_array"
STATEMENT = "statement"
TARGET = "target"


class LilGymPolicy(MaskableActorCriticPolicy):
    """Sees the image (of half size) or the item array, the statement as token ids, and the target.

    `predict` also takes the text observations of `gymnasium.make`. Where an observation's part "forced" is 1
    (`make_vec_env(..., stop_forcing=True)`), rollouts take STOP, with the log-probability that it has unforced.
    """

    observation_space: spaces.Dict
    action_space: spaces.Discrete

    def __init__(
        self, *args: Any, settings: AnyMapping, words: Sequence[str], use_sde: bool = False, **kwargs: Any
    ) -> None:
        """`settings`: `EnvConfig.to_json()` of the environment; `words`: of its vocabulary. `use_sde`: as
        PPO passes it, unused. Raises ValueError if the environment's actions or token ids are others."""
        self.settings = EnvConfig.from_json(settings)
        self.vocabulary = Vocabulary(tuple(words))
        self._table = BoxImageTable()
        self._texts = dict[bytes, str]()
        self._versions: list[tuple[int, int]] = []  # of the parameters that made the cached encodings
        super().__init__(*args, **{"optimizer_kwargs": {"eps": 1e-5, "fused": True}, **kwargs})

    def _build(self, lr_schedule: Any) -> None:
        appearance = make_appearance(self.settings.appearance, self.settings.grid)
        self._ids: Any = self.observation_space[STATEMENT]
        for name in (IMAGE, ITEMS):
            part = self.observation_space.spaces.get(name)
            if part is not None and np.dtype(part.dtype).kind == "f":
                raise ValueError(f"{SCALED.format(name)}, not {part}")
        needed = appearance.action_count, len(self.vocabulary)
        if needed != (found := (int(self.action_space.n), 1 + int(self._ids.high.max()))):
            raise ValueError(f"these settings and words have {needed} actions and token ids, the environment {found}")
        if getattr(self._ids, "vocabulary", self.vocabulary) != self.vocabulary:
            raise ValueError(OTHER_WORDS)
        self.network = BoxTransformer(appearance, self.vocabulary)
        self.register_buffer("masked", torch.tensor(False))  # whether it was trained with masks
        options: AnyDict = {"lr": lr_schedule(1), **self.optimizer_kwargs}
        self.optimizer = self.optimizer_class(self.network.parameters(), **options)

    def set_training_mode(self, mode: bool) -> None:
        if mode != self.training:
            self.network.clear_cache()
        super().set_training_mode(mode)

    def load_from_vector(self, vector: np.ndarray) -> None:
        self.network.clear_cache()  # the memory of the new parameters may be that of older ones
        super().load_from_vector(vector)

    def _forget_other_weights(self) -> None:
        """Clears the network's cached encodings if its parameters are not those that made them."""
        versions = [(one.data_ptr(), one._version) for one in self.network.parameters()]  # pyright: ignore[reportPrivateUsage]
        if versions != self._versions:
            self._versions = versions
            self.network.clear_cache()

    def forward(self, obs: Any, deterministic: bool = False, action_masks: Any = None) -> tuple[Tensor, Tensor, Tensor]:
        policy, values = self._decided(obs, action_masks)
        actions = self._chosen(policy, deterministic).to(values.device)
        if FORCED_NOW in obs:
            actions = torch.where(obs[FORCED_NOW].flatten() > 0, STOP, actions)
        return actions, values, policy.log_prob(actions)

    def evaluate_actions(self, obs: Any, actions: Tensor, action_masks: Any = None) -> tuple[Tensor, Tensor, Tensor]:
        if action_masks is not None and bool(action_masks.all()):  # what buffers hold without masks
            action_masks = None
        self.masked |= action_masks is not None
        policy, values = self._decided(obs, action_masks)
        log_probs, entropies = policy.evaluate_actions(actions)
        return values, log_probs, entropies

    def predict_values(self, obs: Any) -> Tensor:
        return self._decided(obs)[1]

    def _predict(self, observation: Any, deterministic: bool = False, action_masks: Any = None) -> Tensor:
        return self._chosen(self._decided(observation, action_masks)[0], deterministic)

    def _decided(self, observations: Mapping[str, Tensor], action_masks: Any = None) -> tuple[FactoredPolicy, Tensor]:
        """The policy and the values (N, 1)."""
        self._forget_other_weights()
        legal = None if action_masks is None else np.asarray(action_masks, bool).reshape(-1, self.action_space.n)
        policy, values = policy_and_values(self.network, self._states(observations), legal)
        return policy, values[:, None]

    def _chosen(self, policy: FactoredPolicy, deterministic: bool) -> Tensor:
        rng = np.random.default_rng(int(torch.randint(2**62, ())))  # SB3 seeds torch
        return torch.from_numpy(policy.greedy() if deterministic else policy.sample(rng))

    def _states(self, observations: Mapping[str, Tensor]) -> States:
        if len(self._table) > 100_000:
            self._table = BoxImageTable()
            self._texts = {}
        arrays = {name: values.cpu().numpy() for name, values in observations.items()}
        if ITEMS in arrays:
            boxes = self._table.item_indices(arrays[ITEMS].astype(np.int16))
        else:
            given = arrays[IMAGE]
            if given.dtype.kind == "f" and (given.max(initial=0) <= 1 or given.min(initial=0) < 0):
                raise ValueError(f"{SCALED.format(IMAGE)}, not {given.min()} .. {given.max()}")
            images = given.astype(np.uint8, copy=False)
            boxes = self._table.indices(images.transpose(0, 2, 3, 1) if images.shape[1] == 3 else images)
        return self._table.states_of([*map(self._text, arrays[STATEMENT])], boxes, arrays[TARGET].reshape(-1))

    def _text(self, row: Any) -> str:  # of token ids (L,)
        key = row.tobytes()
        text = self._texts.get(key)
        if text is None:
            text = self._texts[key] = self.vocabulary.statement(row)
        return text

    def obs_to_tensor(self, observation: Any) -> tuple[dict[str, Tensor], bool]:
        """The tensors of one observation or a batch, and whether it is a batch."""
        scene = ITEMS if ITEMS in observation else IMAGE
        shown = np.asarray(observation[scene])
        statements = np.atleast_1d(observation[STATEMENT])
        if statements.dtype.kind == "U":
            statements = np.stack([self.vocabulary.encode(text, self._ids.shape[0]) for text in statements.tolist()])
        is_batch = shown.ndim == 4
        parts = {scene: shown if is_batch else shown[None], STATEMENT: np.atleast_2d(statements)}
        parts[TARGET] = np.reshape(observation[TARGET], (-1, 1))
        return {name: torch.as_tensor(part, device=self.device) for name, part in parts.items()}, is_batch


class StatementRolloutBuffer(MaskableDictRolloutBuffer):
    """Mini-batches have few statements each, which the network reads once. Advantages are divided by their standard
    deviation over the rollout, but not centred (use `normalize_advantage=False`); a forced STOP's is its return."""

    def compute_returns_and_advantage(self, last_values: Tensor, dones: np.ndarray) -> None:
        super().compute_returns_and_advantage(last_values, dones)
        if FORCED_NOW in self.observations:
            forced = self.observations[FORCED_NOW][..., 0] > 0
            self.advantages[forced] = self.returns[forced]
        self.advantages /= self.advantages.std() + 1e-8

    def get(self, batch_size: int | None = None) -> Generator[MaskableDictRolloutBufferSamples, None, None]:
        """Mini-batches that keep the states of a statement together."""
        next(super().get(1))  # flattens the arrays
        indices: dict[bytes, int] = {}
        statements = np.array([indices.setdefault(row.tobytes(), len(indices)) for row in self.observations[STATEMENT]])
        rng = np.random.default_rng(int(torch.randint(2**62, ())))
        for rows in mini_batches(statements, batch_size or len(statements), rng, by_statement=True):
            yield self._get_samples(rows)


class EntropySchedule(BaseCallback):
    """Changes the entropy coefficient linearly from `start` to `end` in the course of training."""

    def __init__(self, start: float, end: float) -> None:
        super().__init__()
        self._start = start
        self._end = end

    def _on_rollout_start(self) -> None:
        done = min(1.0, self.num_timesteps / self.model._total_timesteps)  # pyright: ignore[reportPrivateUsage]
        self.model.ent_coef = self._start + (self._end - self._start) * done  # pyright: ignore[reportAttributeAccessIssue]

    def _on_step(self) -> bool:
        return True


STATEMENT_EPISODES = {"tower": 4}  # of the results in the documents; 2 for other appearances


class Recipe(NamedTuple):
    """Arguments that train as `lilgym-mp train ppo --stop-forcing` does."""

    env: AnyDict  # of `make_vec_env`
    model: AnyDict  # of `PPO` and `MaskablePPO`
    callback: EntropySchedule  # of `learn`


def recipe(configuration: str, corpus: str = "builtin", **environment: Any) -> Recipe:
    """The recipe for a configuration; `environment`: other fields of `EnvConfig`. Raises ValueError, CorpusError."""
    settings = EnvConfig(configuration, corpus, **environment)
    ours = PPORecipe.of(configuration)
    words = Vocabulary.from_statements(training_statements(settings)).words
    env = {
        "id": settings.id,
        "n_envs": ours.envs,
        "wrap": structured_observation_v0,
        "vocabulary": Vocabulary(words),
        "same_statement": ours.same_statement,
        "statement_episodes": STATEMENT_EPISODES.get(settings.appearance, 2),
        "recolour": ours.recolour,
        "empty_starts": ours.empty_starts,
        "stop_forcing": True,
        **settings.arguments("train"),
    }
    model = {
        "policy": LilGymPolicy,
        "policy_kwargs": {"settings": settings.to_json(), "words": words},
        "rollout_buffer_class": StatementRolloutBuffer,
        "normalize_advantage": False,
        "n_steps": ours.rollout // ours.envs,
        "batch_size": ours.batch_size,
        "n_epochs": ours.epochs,
        "learning_rate": LinearSchedule(ours.learning_rate, 0.0, 1.0),
        "gamma": ours.gamma,
        "gae_lambda": ours.gae_lambda,
        "clip_range": ours.clip,
        "vf_coef": ours.value / 2,  # SB3's loss is the squared error, not half of it
        "max_grad_norm": ours.gradient_norm,
    }
    return Recipe(env, model, EntropySchedule(ours.entropy, ours.final_entropy))


def agent_of(model: BaseAlgorithm) -> PPOAgent:
    """The agent of a model with a `LilGymPolicy`, to evaluate, or to save as a model file. Raises AgentError."""
    policy = model.policy
    if not isinstance(policy, LilGymPolicy):
        raise AgentError(
            f"only models with a LilGymPolicy are agents, not those with a {type(policy).__name__}; {ELSE}"
        )
    recipe = PPORecipe(mask=bool(policy.masked), seed=model.seed or 0)
    names = (policy.settings.configuration,)
    facts = {"steps": model.num_timesteps}
    description = describe(policy.settings, recipe, "stable-baselines3", names, policy.network, facts)
    description = replace(description, supervision=f"{description.supervision}; trained by Stable-Baselines3")
    return PPOAgent(description, policy.settings, policy.network.eval())


def load_agent(path: Path) -> PPOAgent:
    """The agent in a file of `model.save`, which contains pickles: load only what you trust. Raises AgentError."""
    try:
        return agent_of(MaskablePPO.load(path, device="cpu"))
    except AgentError as error:
        raise AgentError(f"{path}: {error}") from None
    except Exception as error:
        raise AgentError(f"{path}: cannot be loaded as a model with a LilGymPolicy: {error}; {ELSE}") from error
