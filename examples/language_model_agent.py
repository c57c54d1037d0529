"""A language model acts on text: it reads what TextObservation tells and answers with the name or number of an action.

A reply that names no action is asked for again, `--retries` times, and then counts as the default action.
Try: python examples/language_model_agent.py --episodes 1 --steps 12 --nonsense 0.3 --transcript
To use a real model, let `answer` send the messages to it and return what it writes.
"""

from __future__ import annotations

import argparse

import gymnasium as gym
import numpy as np

import lilgym_mp  # noqa: F401  (registers the environments)
from lilgym_mp.wrappers import TextObservation
from lilgym_mp.wrappers.replies import Reply

NOT_UNDERSTOOD = "That names no action plainly. Write the name of one legal action on the last line."

Messages = list[dict[str, str]]  # oldest first, each {"role", "content"}


class StubModel:
    """Stands for a language model: names a random action that it was told is legal, or talks nonsense."""

    def __init__(self, seed: int, nonsense: float = 0.0) -> None:
        """`nonsense`: the share of replies that name no action."""
        self._generator = np.random.default_rng(seed)
        self._nonsense = nonsense

    def answer(self, messages: Messages) -> str:
        """The model's reply to a conversation. Put a real model here."""
        if self._generator.random() < self._nonsense:
            return "What a lovely picture this is going to be."
        told = [message["content"] for message in messages if "Legal actions" in message["content"]]
        listed = [line.split() for line in told[-1].splitlines() if line.startswith("  ")]
        numbers = [words[0] for words in listed if words[0].isdigit()]
        return f"I have no idea what a picture is, so I take action {self._generator.choice(numbers)}."


class Conversation:
    """What a model was told and said."""

    def __init__(self, *, aloud: bool) -> None:
        """`aloud`: print what is said."""
        self.messages: Messages = []
        self.misunderstood = 0  # replies that named no action
        self._aloud = aloud

    def say(self, role: str, content: str) -> None:
        self.messages.append({"role": role, "content": content})
        self.note(f"[{role}] {content}")

    def note(self, line: str) -> None:
        """For the reader; the model is not told."""
        if self._aloud:
            print(line)

    def ask(self, model: StubModel, env: TextObservation, retries: int) -> int:
        """The action of the model's reply, or the default one when no reply names any."""
        reply = self._reply(model, env)
        for _ in range(retries):
            if reply.understood:
                break
            self.say("user", NOT_UNDERSTOOD)
            reply = self._reply(model, env)
        return reply.action

    def _reply(self, model: StubModel, env: TextObservation) -> Reply:
        answer = model.answer(self.messages)
        self.say("assistant", answer)
        reply = env.parse_action(answer)
        self.misunderstood += not reply.understood
        return reply


def play(env: TextObservation, model: StubModel, talk: Conversation, seed: int, steps: int, retries: int) -> str:
    """One episode: what came of it."""
    text, _ = env.reset(seed=seed)
    talk.say("system", env.instructions())
    for _ in range(steps):
        talk.say("user", text)
        action = talk.ask(model, env, retries)
        text, reward, terminated, truncated, info = env.step(action)
        talk.note(f"(action {action}, reward {reward:+.1f})")
        if terminated or truncated:
            return str(info["outcome"])
    return "out of steps"


def main() -> None:
    parser = argparse.ArgumentParser(description="A language model plays through text.")
    parser.add_argument("--id", default="lilgym_mp/TowerFlipIt-v0")
    parser.add_argument("--split", default="dev")
    parser.add_argument("--episodes", type=int, default=3)
    parser.add_argument("--steps", type=int, default=12, help="at most so many actions an episode")
    parser.add_argument("--retries", type=int, default=1, help="questions more when a reply names no action")
    parser.add_argument("--default", default="STOP", help="the action of replies that name none")
    parser.add_argument("--nonsense", type=float, default=0.0, help="share of the stub's replies that name no action")
    parser.add_argument("--transcript", action="store_true", help="print all that is said")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()

    env = TextObservation(gym.make(args.id, split=args.split), default=args.default)
    model = StubModel(args.seed, args.nonsense)
    for episode in range(args.episodes):
        talk = Conversation(aloud=args.transcript)
        outcome = play(env, model, talk, args.seed + episode, args.steps, args.retries)
        print(f"episode {episode}: {outcome}, {talk.misunderstood} replies named no action")
    env.close()


if __name__ == "__main__":
    main()
