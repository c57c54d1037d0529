"""Independent PPO for both agents of the proposer-verifier game, in TorchRL through its PettingZooWrapper.

In the joint protocol both act in every turn and earn the MDP's reward. Three statements, so that a few CPU minutes show
that both learn: random play succeeds in about a fifth of the games. With --guide, they play critique, and the proposer
sees neither statement nor target, but the verifier's messages. Needs the extra `torchrl`.
Run: python examples/torchrl_two_agents.py --frames 60000
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from lilgym_mp.corpus import write_corpus
from lilgym_mp.envs.proposer_verifier import parallel_env

try:
    import torch
    from tensordict import TensorDict  # pyright: ignore[reportMissingImports]
    from tensordict.nn import TensorDictModule, TensorDictSequential  # pyright: ignore[reportMissingImports]
    from torch import Tensor, nn
    from torchrl.collectors import Collector  # pyright: ignore[reportMissingImports]
    from torchrl.envs import (  # pyright: ignore[reportMissingImports]
        EnvBase,
        PettingZooWrapper,
        RewardSum,
        SerialEnv,
        TransformedEnv,
    )
    from torchrl.modules import MaskedCategorical, ProbabilisticActor, ValueOperator  # pyright: ignore[reportMissingImports]
    from torchrl.objectives import ClipPPOLoss  # pyright: ignore[reportMissingImports]
    from torchrl.objectives.value import GAE  # pyright: ignore[reportMissingImports]
except ImportError as missing:
    sys.exit(f'SKIPPED: {missing.name} is not installed; pip install ".[torchrl,pettingzoo]"')

GROUPS = ("proposer", "verifier")  # TorchRL's, of one agent each
OTHERS = {"target": 1, "message": 1, "proposal": 10, "refused": 10}  # what agents may see besides, and its scale
JOINT: dict[str, Any] = {"protocol": "joint", "views": "structured"}
GUIDE: dict[str, Any] = {  # the verifier has a message for each action
    "protocol": "critique",
    "views": {"proposer_0": {"scene": "structured", "statement": "none", "target": False}, "verifier_0": "structured"},
    "message_size": {"proposer_0": 0, "verifier_0": 13},
}
STATEMENTS = {
    "Some block is blue.": "exist(filter_color(all_items, Color.BLUE))",
    "Yellow can be seen.": "exist(filter_color(all_items, Color.YELLOW))",
    "There is a tower.": "exist(filter_obj(all_boxes, lambda b: count(b) >= 2))",
}


def write_statements(path: Path) -> None:
    common = {"appearance": "tower", "split": "train", "starts": []}
    rows = enumerate(STATEMENTS.items())
    entries = [{"id": f"{n}", "statement": said, "program": program, **common} for n, (said, program) in rows]
    write_corpus(path, "three", "MIT", entries)


def make_env(corpus: str, *, guide: bool = False) -> EnvBase:
    game = parallel_env(**(GUIDE if guide else JOINT), rewards="common", corpus=corpus)
    wrapped = PettingZooWrapper(game, return_state=False, use_mask=False, done_on_any=True)
    return TransformedEnv(wrapped, RewardSum(in_keys=[("proposer", "reward")], out_keys=["game_return"]))


class Network(nn.Module):
    """From the parts of an observation with these names to `outputs` values; any number of leading batch axes."""

    def __init__(self, names: Sequence[str], words: int, outputs: int, width: int) -> None:
        super().__init__()
        self.names = names
        self.words = nn.Embedding(words, width, padding_idx=0)
        self.scene = nn.Sequential(nn.LazyLinear(width), nn.ReLU(), nn.Linear(width, width))
        self.head = nn.Sequential(nn.Linear(2 * width, width), nn.ReLU(), nn.Linear(width, outputs))

    def forward(self, *parts: Tensor) -> Tensor:
        seen = dict(zip(self.names, parts, strict=True))
        colours = nn.functional.one_hot(seen["item_array"][..., 3].long() + 1, 5).flatten(-3)  # of items in each box
        others = [seen[name] / scale for name, scale in OTHERS.items() if name in seen]
        scene = self.scene(torch.cat([colours.float(), *others], -1))
        read = self.words(seen["statement"]).sum(-2) if "statement" in seen else torch.ones_like(scene)
        return self.head(torch.cat([scene * read, scene], -1))


class Learner(NamedTuple):
    """One agent's policy and what trains it."""

    actor: ProbabilisticActor
    advantage: GAE
    loss: ClipPPOLoss  # with a critic of its own
    optimiser: torch.optim.Optimizer


def make_learner(env: EnvBase, group: str, width: int) -> Learner:
    seen, action = env.observation_spec[group, "observation", "observation"], env.full_action_spec[group, "action"]
    names = [name for name in ("item_array", "statement", *OTHERS) if name in seen.keys()]  # noqa: SIM118
    parts = [(group, "observation", "observation", name) for name in names]
    words = int(seen["statement"].space.high.max()) + 1 if "statement" in names else 1
    network = TensorDictModule(Network(names, words, action.space.n, width), parts, [(group, "logits")])
    actor = ProbabilisticActor(
        network,
        in_keys={"logits": (group, "logits"), "mask": (group, "action_mask")},
        out_keys=[(group, "action")],
        distribution_class=MaskedCategorical,
        return_log_prob=True,
        log_prob_key=(group, "log_probability"),
    )
    critic = ValueOperator(Network(names, words, 1, width), in_keys=parts, out_keys=[(group, "value")])
    critic(actor(env.reset()))  # shapes the lazy layers
    loss = ClipPPOLoss(actor, critic, entropy_coeff=0.02, critic_coeff=0.5, normalize_advantage=True)
    keys = {name: (group, name) for name in ("reward", "done", "terminated", "advantage", "value_target", "value")}
    loss.set_keys(sample_log_prob=(group, "log_probability"), action=(group, "action"), **keys)
    advantage = GAE(gamma=0.99, lmbda=0.95, value_network=critic)
    advantage.set_keys(**keys)
    return Learner(actor, advantage, loss, torch.optim.Adam(loss.parameters(), 1e-3))


def update(learner: Learner, batch: TensorDict, epochs: int, size: int) -> None:
    """The PPO epochs of one agent over one batch."""
    with torch.no_grad():
        learner.advantage(batch)
    flat = batch.reshape(-1)
    for _ in range(epochs):
        for chosen in torch.randperm(len(flat)).split(size):
            losses = learner.loss(flat[chosen])
            learner.optimiser.zero_grad()
            (losses["loss_objective"] + losses["loss_critic"] + losses["loss_entropy"]).backward()
            nn.utils.clip_grad_norm_(learner.loss.parameters(), 0.5)
            learner.optimiser.step()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=60_000, help="turns of games")
    parser.add_argument("--envs", type=int, default=8)
    parser.add_argument("--batch", type=int, default=2048, help="turns between updates")
    parser.add_argument("--width", type=int, default=64, help="width of the networks")
    parser.add_argument("--guide", action="store_true", help="critique with the guide's views instead of joint")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(args.seed)
    with TemporaryDirectory() as directory:
        corpus = Path(directory) / "three.jsonl"
        write_statements(corpus)
        make = partial(make_env, str(corpus), guide=args.guide)
        envs = SerialEnv(args.envs, make)
        envs.set_seed(args.seed)
        learners = [make_learner(make(), group, args.width) for group in GROUPS]
        policy = TensorDictSequential(*(learner.actor for learner in learners))
        collector = Collector(envs, policy, frames_per_batch=args.batch, total_frames=args.frames)
        frames = 0
        try:
            for batch in collector:
                frames += batch.numel()
                for learner in learners:
                    update(learner, batch, epochs=4, size=min(512, args.batch))
                ended = batch["next", "done"].squeeze(-1)
                returns = batch["next", "game_return"][ended]
                print(
                    f"{frames:8} turns  {time.process_time():4.0f} CPU s  {int(ended.sum()):5} games "
                    f" success {(returns > 0).float().mean():.2f}",
                    flush=True,
                )
        finally:
            collector.shutdown()


if __name__ == "__main__":
    main()
