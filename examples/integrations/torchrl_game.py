"""TorchRL: PPO for both agents of the two-agent game. The environment and the learners are those of
torchrl_two_agents.py."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import torch
from flat import arguments
from tensordict.nn import TensorDictSequential  # pyright: ignore[reportMissingImports]
from torchrl.envs.utils import ExplorationType, set_exploration_type  # pyright: ignore[reportMissingImports]

sys.path.append(str(Path(__file__).parents[1]))

from torchrl_two_agents import GROUPS, make_env, make_learner, update

LIBRARY = "TorchRL"
CELLS = {"game": ("used by `MaskedCategorical`", "mean return of a rollout", "TorchRL's transforms")}


def main() -> None:
    args = arguments(CELLS)
    torch.set_num_threads(1)
    env = make_env("builtin")
    env.set_seed(0)
    learners, again = ([make_learner(env, group, 16) for group in GROUPS] for _ in range(2))
    policy = TensorDictSequential(*(learner.actor for learner in learners))
    with torch.no_grad():
        batch = env.rollout(args.steps, policy, break_when_any_done=False)
    for learner in learners:
        update(learner, batch, epochs=1, size=64)
    torch.save([learner.actor.state_dict() for learner in learners], "agents.pt")
    for learner, saved in zip(again, torch.load("agents.pt", weights_only=True), strict=True):
        learner.actor.load_state_dict(saved)

    def played(learners: Any) -> Any:
        env.set_seed(1)
        with torch.no_grad(), set_exploration_type(ExplorationType.MODE):
            actors = TensorDictSequential(*(learner.actor for learner in learners))
            return env.rollout(100, actors, break_when_any_done=False)

    first, second = played(learners), played(again)
    for group in GROUPS:
        assert torch.equal(first[group, "action"], second[group, "action"])
    ended = first["next", "done"].squeeze(-1)
    mean = first["next", "game_return"][ended].mean()
    print(f"{args.kind}: mean return {mean:+.2f} of {int(ended.sum())} games, saved and loaded")


if __name__ == "__main__":
    main()
