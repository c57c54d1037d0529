"""Trains both agents with BenchMARL's MAPPO or IPPO, on three statements: the game as a BenchMARL task.

The agents form one group, for which the game has homogeneous=True: they share a policy, and MAPPO's critic sees both.

Needs BenchMARL, whose version 1.5 needs TorchRL below 0.12 and so an environment of its own:
pip install "benchmarl<1.6" ".[pettingzoo]". Run: python examples/benchmarl_game.py --frames 40960 --algorithm mappo
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

try:
    import torch
    from benchmarl.algorithms import IppoConfig, MappoConfig  # pyright: ignore[reportMissingImports]
    from benchmarl.environments.common import Task  # pyright: ignore[reportMissingImports]
    from benchmarl.environments.pettingzoo.common import PettingZooClass  # pyright: ignore[reportMissingImports]
    from benchmarl.experiment import Callback, Experiment, ExperimentConfig  # pyright: ignore[reportMissingImports]
    from benchmarl.models import MlpConfig  # pyright: ignore[reportMissingImports]
    from torchrl.envs import ObservationNorm, TransformedEnv  # pyright: ignore[reportMissingImports]
    from torchrl.envs.libs.pettingzoo import PettingZooWrapper  # pyright: ignore[reportMissingImports]

    from lilgym_mp.corpus import write_corpus
    from lilgym_mp.envs.proposer_verifier import AGENTS, parallel_env
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install "benchmarl<1.6" ".[pettingzoo]"')

STATEMENTS = {  # so few that some thousand games show that both agents learn
    "Some block is blue.": "exist(filter_color(all_items, Color.BLUE))",
    "Yellow can be seen.": "exist(filter_color(all_items, Color.YELLOW))",
    "There is a tower.": "exist(filter_obj(all_boxes, lambda b: count(b) >= 2))",
}
GROUP = "agents"
BATCH = 2048  # turns between updates
JOINT = {"protocol": "joint", "views": "structured"}
GUIDE = {  # the proposer sees no statement, and the verifier has a message for each action
    "protocol": "critique",
    "views": {"proposer_0": {"scene": "structured", "statement": "none", "target": False}, "verifier_0": "structured"},
    "message_size": {"proposer_0": 0, "verifier_0": 13},
}


def make_game(settings: Any) -> Any:
    common = {"appearance": "tower", "split": "train", "starts": []}
    rows = enumerate(STATEMENTS.items())
    entries = [{"id": f"{n}", "statement": said, "program": program, **common} for n, (said, program) in rows]
    with TemporaryDirectory() as directory:
        corpus = Path(directory) / "three.jsonl"
        write_corpus(corpus, "three", "MIT", entries)
        return parallel_env(**settings, observations="vector", homogeneous=True, corpus=str(corpus))


class GameClass(PettingZooClass):
    """BenchMARL's PettingZoo tasks, with this game in place of those that it knows by name."""

    def get_env_fun(self, num_envs: int, continuous_actions: bool, seed: int | None, device: Any) -> Callable[[], Any]:
        def make() -> Any:
            groups = {GROUP: list(AGENTS)}
            env = PettingZooWrapper(
                make_game(self.config["game"]), group_map=groups, done_on_any=True, device=device, seed=seed
            )
            return TransformedEnv(env, ObservationNorm(loc=0.0, scale=0.05, in_keys=[(GROUP, "observation")]))

        return make

    def supports_continuous_actions(self) -> bool:
        return False

    def supports_discrete_actions(self) -> bool:
        return True

    def has_state(self) -> bool:
        return False

    def max_steps(self, env: Any) -> int:
        return 12


class GameTask(Task):
    JOINT = None

    @staticmethod
    def associated_class() -> type[GameClass]:
        return GameClass


class Report(Callback):
    def on_batch_collected(self, batch: Any) -> None:
        ended = batch["next", "done"].reshape(-1)
        returns = batch["next", GROUP, "episode_reward"].flatten(0, -3)[ended]
        frames, seconds = self.experiment.total_frames, time.process_time()
        print(f"{frames:8} turns  {seconds:5.0f} CPU s  mean return {returns.mean():+.2f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=40_960, help="number of turns")
    parser.add_argument("--algorithm", choices=["ippo", "mappo"], default="mappo")
    parser.add_argument("--guide", action="store_true", help="critique with the guide's views instead of joint")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    config = ExperimentConfig.get_from_yaml()
    config.max_n_frames, config.max_n_iters, config.lr = args.frames, None, 1e-3
    config.on_policy_collected_frames_per_batch, config.on_policy_n_envs_per_worker = BATCH, 8
    config.on_policy_n_minibatch_iters, config.on_policy_minibatch_size = 4, 256
    config.loggers, config.evaluation, config.create_json = [], False, False
    algorithm = {"ippo": IppoConfig, "mappo": MappoConfig}[args.algorithm].get_from_yaml()
    algorithm.entropy_coef = 0.02
    model = MlpConfig(num_cells=[64, 64], layer_class=torch.nn.Linear, activation_class=torch.nn.Tanh)
    with TemporaryDirectory() as config.save_folder:
        task: Any = GameTask.JOINT
        Experiment(
            task.get_task(config={"game": GUIDE if args.guide else JOINT}),
            algorithm,
            model,
            args.seed,
            config,
            model,
            [Report()],
        ).run()


if __name__ == "__main__":
    main()
