"""File names of trained agents, in run directories and in the package. Imports no torch."""

from __future__ import annotations

import re
from importlib.resources import files

AGENT_FILE = "agent.safetensors"  # file name in a run directory
SHIPPED = re.compile(r"agent-(.+)\.safetensors")  # files of lilgym_mp.data


def shipped_agents() -> tuple[str, ...]:
    """The names of the agents shipped with the package, all trained on the builtin corpus alone."""
    names = (SHIPPED.fullmatch(file.name) for file in files("lilgym_mp.data").iterdir())
    return tuple(sorted(found[1] for found in names if found is not None))
