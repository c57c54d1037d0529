"""The exception that commands raise for errors of the user."""

from __future__ import annotations


class CommandError(Exception):
    """An error that the user can correct; only its message is printed, without a traceback."""
