"""OpenEnv: messages, client and server, with one conversation for each session.

`uvicorn --factory lilgym_mp.contrib.adapters.openenv:make_app --port 8000` serves it.
"""

import random
from typing import Any
from uuid import uuid4

from fastapi import FastAPI, HTTPException
from openenv.core import GenericEnvClient
from openenv.core.client_types import StepResult
from openenv.core.env_server.http_server import create_app
from openenv.core.env_server.interfaces import Environment
from openenv.core.env_server.types import Action, Observation, State
from pydantic import Field

from lilgym_mp.contrib.rlvr import Conversation, rows
from lilgym_mp.wrappers.text import image_part

SEARCH_SECONDS = 20.0  # of a reset, for a task with the wanted settings


class LilgymAction(Action):
    """A language model's reply."""

    reply: str = Field(max_length=100_000, description="Text that names one action on a line of its own")
    finish_reason: str | None = Field(default=None, description="The server's; a reply that was cut is not read")


class LilgymObservation(Observation):
    """The next message to the language model."""

    text: str = Field(default="", description="The rules and the start, then the scene after each action")
    images: list[str] = Field(
        default_factory=list, description="The scene as a data URL of a PNG, if pictures are shown"
    )
    outcome: str = Field(default="", description="Such as continues, success, wrong_stop or not_understood")
    action: str | None = Field(default=None, description="The action that the reply named, if it named one")
    regret: float | None = Field(default=None, description="Return that the turn lost against the expert, if known")
    distance_before: int | None = Field(default=None, description="Actions of a shortest solution before the turn")
    distance_after: int | None = Field(default=None, description="The same after it; 0 after success")


class LilgymEnv(GenericEnvClient):
    """A session of its own on the server: `with LilgymEnv(base_url=url).sync() as env: env.reset(seed=1, level=2)`."""

    def _parse_result(self, payload: dict[str, Any]) -> StepResult[Any]:
        result = super()._parse_result(payload)
        result.observation = LilgymObservation(**result.observation, reward=result.reward, done=result.done)
        return result

    def _parse_state(self, payload: dict[str, Any]) -> State:
        return State(**payload)


def make_app() -> FastAPI:
    """The server's application."""
    return create_app(PlanEnvironment, LilgymAction, LilgymObservation, env_name="lilgym_env", max_concurrent_envs=64)


class PlanEnvironment(Environment):
    """Makes a statement true or false, one action for each reply; reward 1 for success, else 0."""

    SUPPORTS_CONCURRENT_SESSIONS: bool = True
    state: Any = State()  # replaced by that of the episode
    _talk: Conversation | None = None

    def reset(
        self, seed: int | None = None, episode_id: str | None = None, scene: str = "list", **settings: Any
    ) -> LilgymObservation:
        """`seed` determines the task. `settings`: appearance, level, split, min_actions, max_actions.

        `scene`: "list", "image" or "both"; pictures are in the observation's `images`.

        Raises HTTPException: 422 for invalid settings, 408 if no task is found within SEARCH_SECONDS.
        """
        seed = random.randrange(2**32) if seed is None else seed
        try:
            row = next(rows("plan", seed=seed, seconds=SEARCH_SECONDS, **settings))
            self._talk = Conversation(row, scene=scene)
        except (TypeError, ValueError, TimeoutError) as error:
            raise HTTPException(408 if isinstance(error, TimeoutError) else 422, str(error)) from None
        self.state = State(episode_id=episode_id or str(uuid4()))
        return _observation(self._talk, text=self._talk.prompt, outcome="continues", reward=0.0)

    def step(self, action: LilgymAction, timeout_s: float | None = None, **_: Any) -> LilgymObservation:
        """Reads a reply; after the end, and before the first reset, the outcome is "over"."""
        if self._talk is None or self._talk.done:
            return LilgymObservation(text="Reset first.", outcome="over", done=True, reward=0.0)
        self.state.step_count += 1
        return _observation(self._talk, **self._talk.step(action.reply, action.finish_reason)._asdict())


def _observation(talk: Conversation, **fields: Any) -> LilgymObservation:
    return LilgymObservation(images=[image_part(image)["image_url"]["url"] for image in talk.images], **fields)
