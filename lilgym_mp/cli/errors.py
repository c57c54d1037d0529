"""The one exception that a command raises for a person to read."""

from __future__ import annotations


class CommandError(Exception):
    """Something a user can put right; its text is printed alone, without a traceback."""
