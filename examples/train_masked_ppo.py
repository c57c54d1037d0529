"""Trains sb3-contrib's MaskablePPO and compares it with random play.

`lilgym-mp train ppo` has its own training loop, without masks; this example uses that of Stable-Baselines3.
Needs the extra "sb3": pip install ".[sb3]". Try: python examples/train_masked_ppo.py --steps 100000
"""

from __future__ import annotations

import argparse
from functools import partial

from actor_critic import ActorCritic
from maskable_policy import Agent, MaskedActorCritic
from sb3_contrib import MaskablePPO

from lilgym_mp.appearances import make_appearance
from lilgym_mp.corpus import Vocabulary
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.comparison import EvaluationPlan, play_all, training_statements
from lilgym_mp.evaluation.named_policies import BASELINES, NamedPolicy
from lilgym_mp.evaluation.report import table
from lilgym_mp.sb3 import make_vec_env
from lilgym_mp.wrappers import stop_forcing_v0
from lilgym_mp.wrappers.tokens import default_length


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--configuration", default="TowerScratch")
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--envs", type=int, default=32)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()

    settings = Settings(args.configuration)
    statements = training_statements(settings)
    vocabulary, length = Vocabulary.from_statements(statements), default_length(statements)
    appearance = make_appearance(settings.appearance)

    learner = MaskablePPO(
        MaskedActorCritic,
        make_vec_env(
            settings.id,
            n_envs=args.envs,
            wrap=partial(stop_forcing_v0, mode="mask"),  # the paper's PPO+SF; remove for plain PPO
            vocabulary=vocabulary,
            length=length,
            **settings.arguments("train"),
        ),
        n_steps=64,
        batch_size=min(256, 64 * args.envs),
        n_epochs=4,
        learning_rate=2e-3,
        ent_coef=0.1,
        policy_kwargs={"make_network": partial(ActorCritic, appearance, len(vocabulary))},
        seed=args.seed,
        device="cpu",
    )
    learner.learn(args.steps, progress_bar=False)

    assert isinstance(learner.policy, MaskedActorCritic)
    policy = Agent(learner.policy.network.eval(), vocabulary, length)
    agent = NamedPolicy("trained agent, masked", lambda settings: policy, "rewards alone")
    plan = EvaluationPlan(settings, "dev", args.seed)
    print(plan)
    print(table(list(play_all([agent, *BASELINES], plan, statements))))


if __name__ == "__main__":
    main()
