"""One conversation for each session."""

import random
from typing import Any
from uuid import uuid4

from fastapi import HTTPException
from openenv.core.env_server.interfaces import Environment
from openenv.core.env_server.types import State

from lilgym_mp.contrib.rlvr import Conversation, rows

try:
    from ..models import LilgymAction, LilgymObservation
except ImportError:
    from models import LilgymAction, LilgymObservation


SEARCH_SECONDS = 20.0  # of a reset, for a task with the wanted settings


class PlanEnvironment(Environment):
    """Makes a statement true or false, one action for each reply; reward 1 for success, else 0."""

    SUPPORTS_CONCURRENT_SESSIONS: bool = True

    def __init__(self) -> None:
        super().__init__()
        self._state = State(episode_id=str(uuid4()), step_count=0)
        self._talk: Conversation | None = None

    def reset(self, seed: int | None = None, episode_id: str | None = None, **settings: Any) -> LilgymObservation:
        """`seed` determines the task. `settings`: appearance, level, split, min_actions, max_actions.

        Raises HTTPException: 422 for invalid settings, 408 if no task is found within SEARCH_SECONDS.
        """
        seed = random.randrange(2**32) if seed is None else seed
        try:
            self._talk = Conversation(next(rows("plan", seed=seed, seconds=SEARCH_SECONDS, **settings)))
        except (TypeError, ValueError) as error:
            raise HTTPException(422, str(error)) from None
        except TimeoutError as error:
            raise HTTPException(408, str(error)) from None
        self._state = State(episode_id=episode_id or str(uuid4()), step_count=0)
        return LilgymObservation(text=self._talk.prompt, outcome="continues", done=False, reward=0.0)

    def step(self, action: LilgymAction, timeout_s: float | None = None, **_: Any) -> LilgymObservation:
        if self._talk is None or self._talk.done:
            return LilgymObservation(text="Reset first.", outcome="over", done=True, reward=0.0)
        self._state.step_count += 1
        turn = self._talk.step(action.reply, action.finish_reason)
        names = ("text", "outcome", "done", "reward", "regret", "distance_before", "distance_after")
        return LilgymObservation(**{name: getattr(turn, name) for name in names})

    @property
    def state(self) -> State:
        return self._state
