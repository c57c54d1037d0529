"""lilgym_mp as an OpenEnv environment."""

from .client import LilgymEnv
from .models import LilgymAction, LilgymObservation

__all__ = ["LilgymAction", "LilgymEnv", "LilgymObservation"]
