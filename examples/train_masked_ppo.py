"""Trains sb3-contrib's MaskablePPO over Stable-Baselines3's own SubprocVecEnv, and evaluates the agent on dev.

The policy is SB3's "MultiInputPolicy" with the features extractor below, which embeds the statement's words and lets
each box attend to them. Prints a line every 20,000 steps; docs/stable_baselines3.md has the curve. Takes seven minutes.
Needs the extra "sb3": pip install ".[sb3]". Run: python examples/train_masked_ppo.py
"""

from __future__ import annotations

import argparse
import time
from collections import deque
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from gymnasium import spaces
from sb3_contrib import MaskablePPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn
from torch import Tensor, nn

from lilgym_mp.corpus import Vocabulary
from lilgym_mp.corpus.statement_arrays import default_length
from lilgym_mp.corpus.tokens import PAD
from lilgym_mp.evaluation import Observations, Settings
from lilgym_mp.evaluation.comparison import EvaluationPlan, play_all, training_statements
from lilgym_mp.evaluation.policies import BASELINES, NamedPolicy
from lilgym_mp.evaluation.report import table
from lilgym_mp.sb3 import make_vec_env

EVERY, FIRST = 5, 2  # the pixels kept of each row and column: enough for blocks of 10 x 10
BOXES, SIDE, PITCH = 3, 10, 14  # kept pixels: a box's side, from box to box


class FewPixels(VecEnvWrapper):
    """Keeps every fifth pixel: SB3 stores images as floats, and most of its time would go into copying them."""

    def __init__(self, envs: VecEnv) -> None:
        space = cast("spaces.Dict", envs.observation_space)
        image = space["image"].sample()[FIRST::EVERY, FIRST::EVERY]
        few = spaces.Box(0, 255, image.shape, np.uint8)
        super().__init__(envs, spaces.Dict({**space.spaces, "image": few}))

    def reset(self) -> VecEnvObs:
        return self._fewer(self.venv.reset())

    def step_wait(self) -> VecEnvStepReturn:
        observations, rewards, dones, infos = self.venv.step_wait()
        return self._fewer(observations), rewards, dones, infos

    def _fewer(self, observations: Any) -> Any:
        return {**observations, "image": observations["image"][:, FIRST::EVERY, FIRST::EVERY]}


class StatementAndBoxes(BaseFeaturesExtractor):
    """Embeds the words in windows of three, lets each box attend to them, and compares the scene with the target."""

    def __init__(self, observation_space: spaces.Dict, words: int, width: int = 64) -> None:
        """`words`: size of the vocabulary."""
        super().__init__(observation_space, features_dim=2 * width)
        self.words = nn.Embedding(words, width, padding_idx=PAD)
        self.window = nn.Conv1d(width, width, kernel_size=3, padding=1)
        self.box = nn.Linear(3 * SIDE**2, width)
        self.read = nn.MultiheadAttention(width, 4, batch_first=True)
        self.place = nn.Parameter(0.1 * torch.randn(BOXES, 2 * width))
        self.judge = nn.Sequential(nn.Linear(2 * width, 2 * width), nn.ReLU(), nn.Linear(2 * width, 2 * width))
        self.whole = nn.Linear(2 * width, 2 * width)
        self.target = nn.Embedding(2, 2 * width)

    def forward(self, observations: dict[str, Tensor]) -> Tensor:
        """(B, 2 width); SB3 gives images as (B, 3, 10, 38) in 0 .. 1."""
        tokens = observations["statement"].long()
        tokens = tokens[:, : int((tokens != PAD).sum(1).max())]
        embedded = self.words(tokens)
        words = embedded + torch.relu(self.window(embedded.transpose(1, 2))).transpose(1, 2)
        boxes = observations["image"].unfold(3, SIDE, PITCH).permute(0, 3, 1, 2, 4).flatten(2)
        boxes = torch.relu(self.box(boxes))  # (B, 3, width)
        meaning, _ = self.read(boxes, words, words, key_padding_mask=tokens == PAD, need_weights=False)
        judged = self.judge(torch.cat([boxes + meaning, boxes * meaning], 2))  # what the statement says of each box
        scene = torch.relu(self.whole(judged.sum(1))) + (judged * self.place).sum(1)
        return torch.relu(scene) * self.target(observations["target"].long().flatten())


class Report(BaseCallback):
    """Prints steps, seconds and the success rate of the last 2,000 training episodes, and appends them to a file."""

    def __init__(self, every: int, file: Path | None, minutes: float) -> None:
        """`minutes`: training ends after this time, even if steps are left."""
        super().__init__()
        self._every, self._file, self._next, self._seconds = every, file, every, 60 * minutes
        self._successes: deque[bool] = deque(maxlen=2_000)
        self._began = time.perf_counter()

    def _on_step(self) -> bool:
        self._successes.extend(reward > 0 for reward in self.locals["rewards"][self.locals["dones"]])
        return time.perf_counter() - self._began < self._seconds

    def _on_rollout_end(self) -> None:
        if self.num_timesteps < self._next:
            return
        self._next += self._every
        seconds, rate = time.perf_counter() - self._began, 100 * sum(self._successes) / max(1, len(self._successes))
        print(f"{self.num_timesteps:9,} steps {seconds:6.0f} s  success {rate:5.1f} %", flush=True)
        if self._file is not None:
            with self._file.open("a") as out:
                out.write(f"{self.num_timesteps},{seconds:.1f},{rate:.2f}\n")


class Agent:
    """The trained policy for evaluations: the most probable legal action, or a sampled one."""

    def __init__(self, model: MaskablePPO, vocabulary: Vocabulary, length: int) -> None:
        self._model, self._vocabulary, self._length = model, vocabulary, length

    def __call__(self, observations: Observations, legal: Any, rng: np.random.Generator) -> Any:
        words = np.stack([self._vocabulary.encode(text, self._length) for text in observations.statements])
        images = observations.images[:, FIRST::EVERY, FIRST::EVERY].transpose(0, 3, 1, 2)
        inputs = {"image": images, "statement": words, "target": observations.targets}
        return self._model.predict(inputs, action_masks=legal, deterministic=True)[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--configuration", default="TowerScratch")
    parser.add_argument("--backend", default="subproc", help="of the VecEnv: subproc, batched, workers or dummy")
    parser.add_argument("--steps", type=int, default=800_000)
    parser.add_argument("--minutes", type=float, default=7.0, help="end training after this time")
    parser.add_argument("--envs", type=int, default=16)
    parser.add_argument("--rollout", type=int, default=2048, help="steps of all environments between updates")
    parser.add_argument("--batch-size", type=int, default=256)
    parser.add_argument("--epochs", type=int, default=2)
    parser.add_argument("--learning-rate", type=float, default=1e-3)
    parser.add_argument("--entropy", type=float, default=0.03)
    parser.add_argument("--corpus", default="builtin")
    parser.add_argument("--every", type=int, default=20_000)
    parser.add_argument("--curve", type=Path, metavar="FILE.csv", help="append steps, seconds and success rate")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)

    settings = Settings(args.configuration, args.corpus)
    statements = training_statements(settings)
    vocabulary, length = Vocabulary.from_statements(statements), default_length(statements)
    envs = make_vec_env(
        settings.id,
        args.envs,
        args.backend,
        seed=args.seed,
        vocabulary=vocabulary,
        length=length,
        **settings.arguments("train"),
    )
    model = MaskablePPO(
        "MultiInputPolicy",
        FewPixels(envs),
        n_steps=max(1, args.rollout // args.envs),
        batch_size=min(args.batch_size, args.rollout),
        n_epochs=args.epochs,
        learning_rate=lambda left: args.learning_rate * left,
        ent_coef=args.entropy,
        policy_kwargs={
            "features_extractor_class": StatementAndBoxes,
            "features_extractor_kwargs": {"words": len(vocabulary)},
            "net_arch": [128],
        },
        seed=args.seed,
        device="cpu",
    )
    model.learn(args.steps, Report(args.every, args.curve, args.minutes))
    envs.close()
    agent = NamedPolicy("trained agent, masked", lambda _: Agent(model, vocabulary, length), "rewards alone")
    plan = EvaluationPlan(settings, "dev", args.seed)
    print(plan)
    print(table(list(play_all([agent, *BASELINES], plan, statements))))


if __name__ == "__main__":
    main()
