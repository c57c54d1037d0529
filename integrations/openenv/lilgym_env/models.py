"""The messages from and to the agent."""

from openenv.core.env_server.types import Action, Observation
from pydantic import Field


class LilgymAction(Action):
    """A language model's reply."""

    reply: str = Field(max_length=100_000, description="Text that names one action on a line of its own")
    finish_reason: str | None = Field(default=None, description="The server's; a reply that was cut is not read")


class LilgymObservation(Observation):
    """The next message to the language model."""

    text: str = Field(default="", description="The rules and the start, then the scene after each action")
    outcome: str = Field(default="", description="Such as continues, success, wrong_stop or not_understood")
    regret: float | None = Field(default=None, description="Return that the turn lost against the expert, if known")
    distance_before: int | None = Field(default=None, description="Actions of a shortest solution before the turn")
    distance_after: int | None = Field(default=None, description="The same after it; 0 after success")
