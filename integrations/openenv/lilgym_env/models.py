"""The messages from and to the agent."""

from openenv.core.env_server.types import Action, Observation
from pydantic import Field


class LilgymAction(Action):
    """A language model's reply."""

    reply: str = Field(max_length=100_000, description="Text that names one action on a line of its own")


class LilgymObservation(Observation):
    """The next message to the language model."""

    text: str = Field(default="", description="The rules and the start, then the scene after each action")
    outcome: str = Field(default="", description="Such as continues, success, wrong_stop or not_understood")
