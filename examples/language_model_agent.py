"""A language model acts on text: it reads what TextObservation tells and answers with the name or number of an action.

Try: python examples/language_model_agent.py --episodes 3 --steps 12
To use a real model, let `answer` send the messages to it and return what it writes.
"""

from __future__ import annotations

import argparse

import gymnasium as gym
import numpy as np

import lilgym_mp  # noqa: F401  (registers the environments)
from lilgym_mp.wrappers import TextObservation

INSTRUCTIONS = """\
You edit a picture of three boxes, one action at a time. You are told a statement about the picture and whether to
make it true or false. When it is as wanted, answer STOP; a wrong STOP or an illegal action loses. Think, then end
your answer with one action, by its name or number."""


class StubModel:
    """Stands for a language model: names a random action that it was told is legal."""

    def __init__(self, seed: int) -> None:
        self._generator = np.random.default_rng(seed)

    def answer(self, messages: list[dict[str, str]]) -> str:
        """The model's reply to a conversation of {"role", "content"} messages. Put a real model here."""
        listed = [line.split() for line in messages[-1]["content"].splitlines() if line.startswith("  ")]
        numbers = [words[0] for words in listed if words[0].isdigit()]
        return f"I have no idea what a picture is, so I take action {self._generator.choice(numbers)}."


def play(env: TextObservation, model: StubModel, seed: int, steps: int) -> tuple[str, int]:
    """One episode: what came of it, and how many replies named no action."""
    text, _ = env.reset(seed=seed)
    messages = [{"role": "system", "content": INSTRUCTIONS}]
    misunderstood = 0
    for _ in range(steps):
        messages.append({"role": "user", "content": text})
        reply = model.answer(messages)
        messages.append({"role": "assistant", "content": reply})
        action, understood = env.parse_action(reply)
        misunderstood += not understood
        text, _, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            return str(info["outcome"]), misunderstood
    return "out of steps", misunderstood


def main() -> None:
    parser = argparse.ArgumentParser(description="A language model plays through text.")
    parser.add_argument("--id", default="lilgym_mp/TowerFlipIt-v0")
    parser.add_argument("--split", default="dev")
    parser.add_argument("--episodes", type=int, default=3)
    parser.add_argument("--steps", type=int, default=12, help="at most so many actions an episode")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()

    env = TextObservation(gym.make(args.id, split=args.split))
    model = StubModel(args.seed)
    for episode in range(args.episodes):
        outcome, misunderstood = play(env, model, args.seed + episode, args.steps)
        print(f"episode {episode}: {outcome}, {misunderstood} replies named no action")
    env.close()


if __name__ == "__main__":
    main()
