"""Lets a language model play: it reads the text of TextObservation and answers with the name or index of an action.

If a reply names no action, the model is asked again, up to `--retries` times; then the default action is taken.
Try: python examples/language_model_agent.py --episodes 1 --max-actions 12 --nonsense 0.3 --transcript
To use a real model, change `answer` to send it the messages and return its reply.
"""

from __future__ import annotations

import argparse

import gymnasium as gym
import numpy as np

import lilgym_mp  # noqa: F401  (registers the environments)
from lilgym_mp.wrappers import TextObservation
from lilgym_mp.wrappers.replies import Reply

NOT_UNDERSTOOD = "That does not clearly name an action. Write the name of one legal action on a line of its own."

Messages = list[dict[str, str]]  # oldest first, each {"role", "content"}


class StubModel:
    """Stands in for a language model: names a random legal action, or talks nonsense."""

    def __init__(self, seed: int, nonsense: float = 0.0) -> None:
        """`nonsense`: probability that a reply names no action."""
        self._generator = np.random.default_rng(seed)
        self._nonsense = nonsense

    def answer(self, messages: Messages) -> str:
        """The model's reply to a conversation; replace this to use a real model."""
        if self._generator.random() < self._nonsense:
            return "What a lovely picture this is going to be."
        prompts = [message["content"] for message in messages if "Legal actions" in message["content"]]
        listed = [line.split() for line in prompts[-1].splitlines() if line.startswith("  ")]
        indices = [words[0] for words in listed if words[0].isdigit()]
        return f"I have no idea what a picture is.\nAction: {self._generator.choice(indices)}"


class Conversation:
    """The messages between the environment and a model."""

    def __init__(self, *, verbose: bool) -> None:
        """`verbose`: print the messages."""
        self.messages: Messages = []
        self.misunderstood = 0  # replies that named no action
        self._verbose = verbose

    def say(self, role: str, content: str) -> None:
        self.messages.append({"role": role, "content": content})
        self.note(f"[{role}] {content}")

    def note(self, line: str) -> None:
        """Prints a line that is not sent to the model."""
        if self._verbose:
            print(line)

    def ask(self, model: StubModel, env: TextObservation, retries: int) -> int:
        """The action that the model names, or the default action if it names none."""
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
    """Plays one episode and returns its outcome."""
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
    parser = argparse.ArgumentParser(description="Let a language model play through text.")
    parser.add_argument("--id", default="lilgym_mp/TowerFlipIt-v0")
    parser.add_argument("--split", default="dev")
    parser.add_argument("--episodes", type=int, default=3)
    parser.add_argument("--max-actions", type=int, default=12, help="maximum number of actions per episode")
    parser.add_argument(
        "--retries", type=int, default=1, help="how often to ask again after a reply that names no action"
    )
    parser.add_argument("--default", default="STOP", help="the action taken if no reply names one")
    parser.add_argument(
        "--nonsense", type=float, default=0.0, help="probability that a reply of the stub names no action"
    )
    parser.add_argument("--transcript", action="store_true", help="print all messages")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()

    env = TextObservation(gym.make(args.id, split=args.split), default=args.default)
    model = StubModel(args.seed, args.nonsense)
    for episode in range(args.episodes):
        talk = Conversation(verbose=args.transcript)
        outcome = play(env, model, talk, args.seed + episode, args.max_actions, args.retries)
        print(f"episode {episode}: {outcome}, {talk.misunderstood} replies named no action")
    env.close()


if __name__ == "__main__":
    main()
