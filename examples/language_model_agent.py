"""A language model plays: it reads the observation as text, answers in text, and the answer becomes an action.

A model is any function from a conversation to a reply. `StubModel` stands in for one; `ChatEndpoint` asks a server
that speaks the usual chat protocol (vLLM, llama.cpp, Ollama and others); put yours beside them, in `chosen_model`.
A reply that names no action is asked for again, `--retries` times, and then counts as the default action.
Needs no extra. Run: python examples/language_model_agent.py --steps 24
Or: python examples/language_model_agent.py --endpoint http://localhost:8000/v1/chat/completions --model NAME
"""

from __future__ import annotations

import argparse
import json
import random
import re
import urllib.request
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium as gym

import lilgym_mp  # noqa: F401  (registers the environments)
from lilgym_mp.wrappers import TextObservation

Conversation = list[dict[str, str]]  # messages, oldest first, each with "role" and "content"
Model = Callable[[Conversation], str]

INSTRUCTIONS = (
    "You change a scene of three boxes, one action at a time, until the statement has the wanted truth value, and then"
    " answer STOP. An action that is not legal loses at once, and so does running out of actions. You may reason"
    " first; the action that you name last counts, so end with one of those listed, such as ADD(LEFT, BLUE)."
)
NOT_UNDERSTOOD = "That names no action. Answer with one of the legal actions, by name or number."


class StubModel:
    """Replies with a listed action at random, and every fourth time with nonsense, as real models do now and then."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._replies = 0

    def __call__(self, conversation: Conversation) -> str:
        self._replies += 1
        if self._replies % 4 == 0:
            return "Well, let me think about that."
        asked = [message["content"] for message in conversation if "Legal actions" in message["content"]]
        return f"I would go for {self._random.choice(listed_actions(asked[-1]))}."


def listed_actions(text: str) -> list[str]:
    """Names of legal actions in an observation; of those told by cells, the first of each line."""
    numbered = re.findall(r"^  \d+ (\S.*)$", text, re.MULTILINE)
    by_cells = re.findall(r"^  (ADD|REMOVE)\(column, row(.*)\): row (\d+).*?: column (\d+)", text, re.MULTILINE)
    first_looks = ((verb, re.sub(r"\|\w+", "", looks), row, column) for verb, looks, row, column in by_cells)
    return numbered + [f"{verb}({column}, {row}{looks})" for verb, looks, row, column in first_looks]


@dataclass(frozen=True)
class ChatEndpoint:
    """A model behind a server's /chat/completions. Raises OSError when the server does not answer."""

    url: str
    model: str
    key: str | None = None
    timeout_seconds: float = 120.0

    def __call__(self, conversation: Conversation) -> str:
        body = json.dumps({"model": self.model, "messages": conversation, "temperature": 0}).encode()
        headers = {"Content-Type": "application/json"} | ({"Authorization": f"Bearer {self.key}"} if self.key else {})
        request = urllib.request.Request(self.url, body, headers)
        with urllib.request.urlopen(request, timeout=self.timeout_seconds) as answer:
            return json.load(answer)["choices"][0]["message"]["content"]


def chosen_model(given: argparse.Namespace) -> Model:
    """The model that plays. A real one of yours goes here: any function from a conversation to a reply."""
    if given.endpoint is not None:
        return ChatEndpoint(given.endpoint, given.model, given.key)
    return StubModel(given.seed)


def ask(model: Model, env: TextObservation, conversation: Conversation, retries: int) -> int:
    """The action of the model's reply, or the default one when no reply names any; adds what is said."""
    for attempt in range(1 + retries):
        reply = model(conversation)
        conversation.append({"role": "assistant", "content": reply})
        parsed = env.parse_action(reply)
        print(f"  the model: {reply!r}")
        if parsed.understood or attempt == retries:
            return parsed.action
        conversation.append({"role": "user", "content": NOT_UNDERSTOOD})
    raise AssertionError("the last attempt returns")


def play(model: Model, env: TextObservation, seed: int, retries: int, steps: int) -> tuple[int, dict[str, Any]]:
    """One episode, of at most `steps` actions: how many there were, and the last info."""
    text, info = env.reset(seed=seed)
    print(f"\n{text}")
    conversation = [{"role": "system", "content": INSTRUCTIONS}, {"role": "user", "content": text}]
    for taken in range(1, steps + 1):
        action = ask(model, env, conversation, retries)
        text, reward, terminated, truncated, info = env.step(action)
        print(f"  action {action}, reward {reward:+.1f}  {info.get('outcome', '')}", flush=True)
        if terminated or truncated:
            return taken, info
        conversation.append({"role": "user", "content": text})
    return steps, info


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--id", default="lilgym_mp/TowerScratch-v0")
    parser.add_argument("--split", default="dev", choices=["train", "dev", "test"])
    parser.add_argument("--steps", type=int, default=24, help="actions, over all episodes")
    parser.add_argument("--retries", type=int, default=1, help="questions more when a reply names no action")
    parser.add_argument("--default", default="STOP", help="the action of a reply that names none")
    parser.add_argument("--endpoint", help="URL of a chat server; without it the stub plays")
    parser.add_argument("--model", default="default", help="the model's name on that server")
    parser.add_argument("--key", help="the server's key, where it wants one")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()

    env = TextObservation(gym.make(given.id, split=given.split), default=given.default)
    model = chosen_model(given)
    left, outcomes = given.steps, []
    while left > 0:
        taken, info = play(model, env, given.seed + len(outcomes), given.retries, left)
        left -= taken
        outcomes.append(info.get("outcome", "cut off"))
    env.close()
    print(f"\n{outcomes.count('success')} of {len(outcomes)} episodes succeeded: {', '.join(outcomes)}")


if __name__ == "__main__":
    main()
