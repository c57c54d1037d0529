"""Evaluate language models, generate prompts for training them, or score their replies."""

from __future__ import annotations

import argparse

from lilgym_mp.cli.options import add_commands


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the actions play, prompts and score, each in a module of its own."""
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    add_commands(actions, {name: f"lilgym_mp.cli.llm_{name}" for name in ("play", "prompts", "score")})
