"""RLlib's PPO with masks: one environment, a batch, or one policy per agent of the two-agent game.

The modules and environments are those of rllib_single_agent.py and rllib_two_policies.py.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import torch
from flat import SETTINGS, arguments
from gymnasium import spaces
from gymnasium.wrappers import vector

sys.path.append(str(Path(__file__).parents[1]))

from ray.rllib.algorithms.ppo import PPOConfig  # pyright: ignore[reportMissingImports]
from ray.rllib.core.rl_module.rl_module import RLModule, RLModuleSpec  # pyright: ignore[reportMissingImports]
from ray.tune.registry import register_env  # pyright: ignore[reportMissingImports]
from rllib_single_agent import make_env
from rllib_two_policies import MaskedActorCritic, learner, started_ray, summary

from lilgym_mp import action_masks
from lilgym_mp.evaluation import evaluate_wrapped
from lilgym_mp.wrappers import structured_observation_v0, tokenized_statement_v0

LIBRARY = "RLlib"
NORMALISED = "Gymnasium's `NormalizeReward` around the environment, or a connector of RLlib"
CELLS = {
    "single": ("used by the example's module, through a short wrapper", "`evaluate_wrapped`", NORMALISED),
    "batch": ("used by the example's module, through a short wrapper", "`evaluate_wrapped`", NORMALISED),
    "game": ("used by the example's module", "mean return of each agent", "not shown"),
}

SMALL = {"train_batch_size_per_learner": 128, "minibatch_size": 64, "num_epochs": 1}


def make(config: dict[str, Any]) -> Any:
    """One environment, or the batch that RLlib asks for with gym_env_vectorize_mode="vector_entry_point"."""
    if "num_envs" not in config:
        return gym.wrappers.NormalizeReward(make_env({"id": config["id"]}))
    envs: Any = wrap(gym.make_vec(config["id"], num_envs=config["num_envs"]))
    mask = spaces.MultiBinary(int(envs.single_action_space.n))
    space = spaces.Dict({"observation": envs.single_observation_space, "action_mask": mask})
    seen = lambda seen: {"observation": seen, "action_mask": action_masks(envs).astype("int8")}  # noqa: E731
    return vector.NormalizeReward(vector.TransformObservation(envs, seen, single_observation_space=space))


def wrap(envs: Any) -> Any:
    return tokenized_statement_v0(structured_observation_v0(envs))


def single(kind: str) -> None:
    register_env("lilgym_mp_single", make)
    module = RLModuleSpec(module_class=MaskedActorCritic, model_config={"width": 16})
    mode = "vector_entry_point" if kind == "batch" else "sync"
    config = (
        PPOConfig()
        .environment("lilgym_mp_single", env_config={"id": SETTINGS.id})
        .env_runners(num_env_runners=0, num_envs_per_env_runner=2, gym_env_vectorize_mode=mode)
        .rl_module(rl_module_spec=module)
        .training(**SMALL)
    )
    algorithm = config.build_algo()
    algorithm.train()
    place = Path("module").absolute()
    algorithm.get_module().save_to_path(place)

    def greedy(module: Any) -> Any:
        def choose(seen: Any, legal: Any) -> Any:
            parts = {name: torch.as_tensor(part) for name, part in seen.items()}
            with torch.no_grad():
                return (
                    module.forward_inference({"obs": {"observation": parts, "action_mask": torch.as_tensor(legal)}})[
                        "action_dist_inputs"
                    ]
                    .argmax(-1)
                    .numpy()
                )

        return choose

    result, again = (
        evaluate_wrapped(greedy(module), SETTINGS, wrap=wrap)
        for module in (algorithm.get_module(), RLModule.from_checkpoint(place))
    )
    algorithm.stop()
    assert result.episodes == again.episodes
    print(f"{kind}: {result.summary.accuracy:.1%} of {len(result.episodes)} dev tasks, saved and loaded")


def game() -> None:
    algorithm = learner(argparse.Namespace(width=16, runners=0, batch=128, seed=0, guide=False))
    print(f"game: {summary(algorithm.train())}")
    place = Path("algorithm").absolute()
    algorithm.save_to_path(place)
    loaded = type(algorithm).from_checkpoint(place)
    for agent in ("proposer_0", "verifier_0"):
        weights = [each.get_module(agent).state_dict() for each in (algorithm, loaded)]
        assert all(torch.equal(value, weights[1][name]) for name, value in weights[0].items())
    for each in (algorithm, loaded):
        each.stop()
    print("game: saved and loaded")


def main() -> None:
    args = arguments(CELLS)
    with started_ray(None):
        game() if args.kind == "game" else single(args.kind)


if __name__ == "__main__":
    main()
