"""The client."""

from typing import Any

from openenv.core import EnvClient
from openenv.core.client_types import StepResult
from openenv.core.env_server.types import State

from .models import LilgymAction, LilgymObservation


class LilgymEnv(EnvClient[LilgymAction, LilgymObservation, State]):
    """A session of its own on the server: `with LilgymEnv(base_url=url).sync() as env: env.reset(seed=1, level=2)`."""

    def _step_payload(self, action: LilgymAction) -> dict[str, Any]:
        return {"reply": action.reply, "finish_reason": action.finish_reason}

    def _parse_result(self, payload: dict[str, Any]) -> StepResult[LilgymObservation]:
        signals = {"reward": payload.get("reward"), "done": payload.get("done", False)}
        observation = LilgymObservation(**{**payload.get("observation", {}), **signals})
        return StepResult(observation=observation, **signals)

    def _parse_state(self, payload: dict[str, Any]) -> State:
        return State(**payload)
