"""The recipe of `lilgym-mp train ppo` for SB3, and its models as agents of this package."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from sb3_contrib import MaskablePPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import LinearSchedule

from lilgym_mp.corpus import Vocabulary
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.comparison import training_statements
from lilgym_mp.learning.common.agents import AgentError
from lilgym_mp.learning.ppo.agent import PPOAgent, describe
from lilgym_mp.learning.ppo.recipe import PPORecipe, make_recipe
from lilgym_mp.sb3.policy import LilGymPolicy, StatementRolloutBuffer
from lilgym_mp.wrappers import structured_observation_v0


class EntropySchedule(BaseCallback):
    """Changes the entropy coefficient linearly from `start` to `end` in the course of training."""

    def __init__(self, start: float, end: float) -> None:
        super().__init__()
        self._start, self._end = start, end

    def _on_rollout_start(self) -> None:
        done = min(1.0, self.num_timesteps / self.model._total_timesteps)  # pyright: ignore[reportPrivateUsage]
        self.model.ent_coef = self._start + (self._end - self._start) * done  # pyright: ignore[reportAttributeAccessIssue]

    def _on_step(self) -> bool:
        return True


class Recipe(NamedTuple):
    """Arguments that train as `lilgym-mp train ppo --stop-forcing` does."""

    env: dict[str, Any]  # of `make_vec_env`
    model: dict[str, Any]  # of `PPO` and `MaskablePPO`
    callback: EntropySchedule  # of `learn`


def recipe(configuration: str, corpus: str = "builtin", **environment: Any) -> Recipe:
    """The recipe for a configuration; `environment`: other fields of `evaluation.Settings`.

    Raises ValueError naming the value and the choices, CorpusError for unusable data.
    """
    settings = Settings(configuration, corpus, **environment)
    ours, words = make_recipe("ours", configuration), Vocabulary.from_statements(training_statements(settings)).words
    env = {
        "id": settings.id,
        "n_envs": ours.envs,
        "wrap": structured_observation_v0,
        "vocabulary": Vocabulary(words),
        "same_statement": ours.same_statement,
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
        "device": "cpu",
    }
    return Recipe(env, model, EntropySchedule(ours.entropy, ours.final_entropy))


def agent_of(model: BaseAlgorithm) -> PPOAgent:
    """The agent of a model with a `LilGymPolicy`, to evaluate, or to save as a model file. Raises AgentError."""
    policy = model.policy
    if not isinstance(policy, LilGymPolicy):
        raise AgentError(f"only models with a LilGymPolicy are agents, not those with a {type(policy).__name__}")
    recipe = PPORecipe(mask=bool(policy.masked), seed=model.seed or 0)
    names, facts = (policy.settings.configuration,), {"steps": model.num_timesteps}
    description = describe(policy.settings, recipe, "stable-baselines3", names, policy.network, facts)
    description = replace(description, supervision=f"{description.supervision}; trained by Stable-Baselines3")
    return PPOAgent(description, policy.settings, policy.network.eval(), recipe.mask)


def load_agent(path: Path) -> PPOAgent:
    """The agent in a file that `model.save` wrote. It contains pickles: load only files that you trust.

    Raises AgentError if it is not such a file.
    """
    try:
        return agent_of(MaskablePPO.load(path, device="cpu"))
    except AgentError as error:
        raise AgentError(f"{path}: {error}") from None
    except Exception as error:
        raise AgentError(f"{path}: cannot be loaded as a model of Stable-Baselines3: {error}") from error
