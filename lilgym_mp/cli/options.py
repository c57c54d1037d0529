"""Options that several commands share. All default to None, "not said"."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from lilgym_mp.appearances import NATIVE, RELEASED_GRID, GridError, checked_grid
from lilgym_mp.cli.errors import CommandError
from lilgym_mp.corpus import load_all_tasks
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.rules import RULE_SETS
from lilgym_mp.task import Task

RUNS = Path("runs")  # where training runs go unless told otherwise
INTERRUPTED = 130  # exit code after Ctrl-C, as shells have it


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Options for the fields of `Settings` but the configuration."""
    options = parser.add_argument_group("environment")
    options.add_argument("--corpus", help='"builtin" (default), "lilgym" (the official one), or a path')
    options.add_argument("--rules", choices=sorted(RULE_SETS), help="rule set (default: paper)")
    options.add_argument("--horizon", type=int, metavar="N", help="actions an episode (default: the rule set's)")
    columns, rows = RELEASED_GRID
    options.add_argument(
        "--grid",
        type=parsed_grid,
        metavar="COLUMNSxROWS",
        help=f'Scatter\'s cells (default: {columns}x{rows}), or "{NATIVE}" for pixels',
    )


def add_recipe(
    parser: argparse.ArgumentParser,
    recipe: Any,
    leave_out: Collection[str] = (),
    *,
    choices: Mapping[str, Sequence[str]] | None = None,
    defaults_of: str | None = None,
) -> None:
    """An option for each field of a recipe's dataclass, whose metadata describe it.

    `choices`: what fields of texts may be; `defaults_of`: the named recipe whose values the defaults are.
    """
    origin = "" if defaults_of is None else f" in {defaults_of}"
    group = parser.add_argument_group("recipe")
    for setting in fields(recipe):
        if setting.name in leave_out:
            continue
        flag, kind, described = f"--{option(setting.name)}", type(setting.default), setting.metadata["description"]
        if kind is bool:
            state = "on" if setting.default else "off"
            group.add_argument(
                flag,
                action=argparse.BooleanOptionalAction,
                default=None,
                help=f"{described} (default: {state}{origin})",
            )
        elif kind is str:
            listed = (choices or {})[setting.name]
            group.add_argument(flag, choices=listed, help=f"{described} (default: {setting.default}{origin})")
        else:
            group.add_argument(flag, type=kind, metavar="N", help=f"{described} (default: {setting.default:g}{origin})")


def add_device(parser: argparse.ArgumentParser) -> None:
    """Where networks run; `learning.devices` refuses what is not there."""
    parser.add_argument("--device", default="auto", metavar="NAME", help="auto, cpu or cuda (default: %(default)s)")
    parser.add_argument("--threads", type=int, default=1, metavar="N", help="of the processor (default: %(default)s)")


def option(name: str) -> str:
    """A setting's name on the command line, without the dashes before it."""
    return name.replace("_", "-")


def add_configuration(parser: argparse.ArgumentParser, flag: str = "configuration", **settings: Any) -> None:
    """The name of a configuration, as an argument or as the option `flag`; `Settings` refuses unknown ones."""
    parser.add_argument(flag, metavar="CONFIGURATION", **settings)


def add_split(parser: argparse.ArgumentParser, default: str) -> None:
    parser.add_argument("--split", choices=list(SPLITS), default=default, help=f"of the corpus (default: {default})")


def parsed_grid(text: str) -> tuple[int, int] | str:
    """A grid as written on the command line, such as 38x10. Raises ArgumentTypeError saying what would do."""
    if text == NATIVE:
        return NATIVE
    try:
        columns, rows = (int(count) for count in text.lower().split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} must be {NATIVE!r} or such as 38x10") from None
    try:
        return checked_grid((columns, rows))
    except GridError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def task_with_id(corpus: str, task_id: str) -> Task:
    """The task, from whichever set of the corpus has it. Raises CommandError with ids that there are."""
    sets = list(load_all_tasks(corpus))
    found = [tasks.by_id(task_id) for tasks in sets if task_id in tasks.ids]
    if not found:
        ids = [known for tasks in sets for known in tasks.ids]
        examples = ", ".join(get_close_matches(task_id, ids) or ids[:3])
        raise CommandError(f"no task {task_id!r} in corpus {corpus!r}; there are for example {examples}")
    return found[0]


def said_settings(args: argparse.Namespace) -> dict[str, Any]:
    """The fields of `Settings` that were given on the command line."""
    return said(args, [field.name for field in fields(Settings)])


def said(args: argparse.Namespace, names: Sequence[str]) -> dict[str, Any]:
    """Those of the named options that were given."""
    return {name: value for name in names if (value := getattr(args, name)) is not None}
