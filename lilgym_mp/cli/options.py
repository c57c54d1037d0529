"""Command-line options that several commands share, and the error of all commands.

An option that was not given has the value None; only then do the defaults of `EnvConfig` or of a recipe apply.
"""

from __future__ import annotations

import math
from argparse import SUPPRESS, ArgumentParser, ArgumentTypeError, BooleanOptionalAction, Namespace, _ActionsContainer
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import Field
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from lilgym_mp.corpus import NoTasksError, TaskSet, load_all_tasks
from lilgym_mp.corpus.locations import fixed_name
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.envs.config import CORPUS_HELP, EnvConfig, option_name
from lilgym_mp.envs.registration import CONFIGURATIONS
from lilgym_mp.evaluation.files import fresh_file
from lilgym_mp.scene.arrays import AnyDict
from lilgym_mp.scene.choices import flag_name
from lilgym_mp.submodules import submodule_getter

JSON = AnyDict  # an object
RUNS = Path("runs")  # default parent of training runs
INTERRUPTED = 130  # exit code after Ctrl-C, as in shells
PREFERRED_SPLITS = ["dev", "train", "test"]  # the first that has tasks is played unless a split is named
CONFIGURATIONS_HELP = ", ".join(CONFIGURATIONS)


class CommandError(Exception):
    """An error that the user can correct; only its message is printed, without a traceback."""


def help_of(text: str | None) -> AnyDict:
    """The help of a command: the text's first line in lists of commands, the rest in its own."""
    summary, _, description = (text or "").strip().partition("\n\n")
    return {"help": summary[:1].lower() + summary[1:-1], "description": description}


def argument_type(parse: Callable[[str], Any]) -> Callable[[str], Any]:
    """`parse` for argparse, which shows the message of its ValueError. Whole numbers may be written as 1e6."""

    def read(text: str) -> Any:
        try:
            return whole_number(text) if parse is int else parse(text)
        except ValueError as error:
            raise ArgumentTypeError(str(error)) from None

    return read


def whole_number(text: str) -> int:
    """The number written as 1000000, 1_000_000 or 1e6. Raises ValueError."""
    try:
        number = float(text) if "e" in text.lower() else int(text)
    except ValueError:
        number = math.inf
    if not math.isfinite(number) or number != int(number):
        raise ValueError(f"{text!r} is not a whole number")
    return int(number)


def add_commands(commands: Any, modules: Mapping[str, str], more: Mapping[str, Sequence[Any]] | None = None) -> None:
    """The commands of an argparse's subparsers, by name: modules that define `add_options` and, mostly, `run`.

    `more`: further arguments of a command's `add_options`.
    """
    for name, place in modules.items():
        package, _, module_name = place.rpartition(".")
        module = submodule_getter(package)(module_name)
        command = commands.add_parser(name, **help_of(module.__doc__))
        command.set_defaults(run=getattr(module, "run", None))
        module.add_options(command, *(more or {}).get(name, ()))


def add_settings(
    parser: ArgumentParser, config: type[EnvConfig] = EnvConfig, texts: Mapping[str, str] | None = None
) -> None:
    """An option for every field of the configuration that is a setting; `texts` as in `add_fields`."""
    add_fields(parser.add_argument_group("environment"), config.settings().values(), texts)


def add_fields(group: _ActionsContainer, fields: Iterable[Field[Any]], texts: Mapping[str, str] | None = None) -> None:
    """An option for each field made by `setting`; its help ends with its default unless it has told one.

    `texts`: help, by name, of options that differ from what the fields say.
    """
    for each in fields:
        default = each.default
        known = each.metadata
        shown = f"{default:g}" if isinstance(default, float) else str(default)
        kind: AnyDict = {"type": argument_type(known["kind"])}
        if isinstance(default, bool):
            shown = "on" if default else "off"
            kind = {"action": BooleanOptionalAction}
        elif known["choices"]:
            kind = {"choices": known["choices"]}
        elif known["kind"] in (int, float):
            kind["metavar"] = "N"
        text = (texts or {}).get(each.name) or known["description"] or ""
        text += "" if default is None or "(default" in text else f" (default: {shown})"
        details = dict(known["shown"])
        details.pop("flag", None)
        group.add_argument(
            f"--{flag_name(option_name(each))}", dest=each.name, default=None, help=text, **{**kind, **details}
        )


def add_corpus(parser: ArgumentParser) -> None:
    """--corpus, for commands that need no further environment settings."""
    parser.add_argument("--corpus", type=fixed_name, default="builtin", help=CORPUS_HELP)


def add_configuration(
    parser: ArgumentParser, *, nargs: str | None = None, default: Any = None, several: bool = False
) -> None:
    """A configuration, or `several`, with or without --configuration; required unless `nargs` is "?"."""
    group = parser.add_mutually_exclusive_group(required=nargs is None and not several)
    help_text = f"{'any' if several else 'one'} of {CONFIGURATIONS_HELP}{' (default: all)' if several else ''}"
    named: AnyDict = {"nargs": "*" if several else "?", "metavar": "CONFIGURATION", "default": SUPPRESS}
    group.add_argument("configuration", help=help_text, **named)
    option: AnyDict = {"nargs": "+"} if several else {}
    group.add_argument("--configuration", metavar="NAME", default=default, help="the same", **option)


def add_split(parser: ArgumentParser, default: str) -> None:
    """Adds --split for commands that read a single split."""
    parser.add_argument(
        "--split", choices=list(SPLITS), default=default, help=f"split of the corpus (default: {default})"
    )


def add_number(parser: _ActionsContainer, flag: str, default: float | None, purpose: str) -> None:
    """An option of the type of its default, a whole number without one."""
    kind, ends = (int, "") if default is None else (type(default), " (default: %(default)s)")
    parser.add_argument(flag, type=argument_type(kind), default=default, metavar="N", help=purpose + ends)


def add_flag(parser: _ActionsContainer, flag: str, purpose: str) -> None:
    """An option without a value, off by default."""
    parser.add_argument(flag, action="store_true", help=purpose)


def add_out(parser: _ActionsContainer, purpose: str, *, required: bool = False) -> None:
    """--out, a file of results, and --force."""
    parser.add_argument("--out", type=Path, metavar="FILE", required=required, help=purpose)
    add_flag(parser, "--force", "overwrite existing files")


def add_seed(parser: _ActionsContainer, purpose: str) -> None:
    """--seed, 0 by default; `purpose` completes "random seed"."""
    add_number(parser, "--seed", 0, f"random seed {purpose}")


def add_thoughts(parser: ArgumentParser) -> None:
    """--thoughts: tags of thoughts in the replies of language models; None stands for `wrappers.replies.THOUGHTS`."""
    parser.add_argument(
        "--thoughts",
        nargs="+",
        metavar="TAG",
        help="tags of thoughts, which are not read: names, as of <think> and [THINK], or BEGIN...END (default: those of"
        " common models)",
    )


def add_device(parser: ArgumentParser) -> None:
    """Where networks run; `learning.common.model_file` rejects devices that are not available."""
    parser.add_argument("--device", default="auto", metavar="NAME", help="auto, cpu or cuda (default: %(default)s)")
    add_number(parser, "--threads", 1, "CPU threads")


def task_sets_with_id(corpus: str, task_id: str, *choices: Sequence[str]) -> list[TaskSet]:
    """The corpus's task sets that contain the task, at least one.

    `choices`: appearances, starts and splits, by default all. Raises CommandError suggesting existing ids.
    """
    sets = list(load_all_tasks(corpus, *choices))
    matches = [tasks for tasks in sets if task_id in tasks.ids]
    if not matches:
        ids = [known for tasks in sets for known in tasks.ids]
        examples = ", ".join(get_close_matches(task_id, ids) or ids[:3])
        raise CommandError(f"no task {task_id!r} in corpus {corpus!r}; tasks include {examples}")
    return matches


def split_of(settings: EnvConfig, split: str | None, *task_ids: str | None) -> str:
    """`split` if given, else the first of dev, train and test that has the tasks; None stands for any task.

    Raises NoTasksError for a corpus without tasks.
    """
    wanted = {task_id for task_id in task_ids if task_id is not None}
    found: list[str] = []  # splits with tasks
    for name in PREFERRED_SPLITS if split is None else ():
        try:
            ids = settings.tasks(name).ids
        except NoTasksError:
            continue
        if wanted <= set(ids):
            return name
        found.append(name)
    return split or next(iter(found), PREFERRED_SPLITS[0])


def given_environment(args: Namespace) -> AnyDict:
    """The settings of `EnvConfig` that were given on the command line."""
    return given_options(args, list(EnvConfig.settings()))


def given_settings(args: Namespace) -> AnyDict:
    """Returns these settings and the configuration, as far as they were given."""
    return {**given_environment(args), **given_options(args, ["configuration"])}


def given_options(args: Namespace, names: Sequence[str]) -> AnyDict:
    """The values of those options that were given."""
    return {name: value for name in names if (value := getattr(args, name)) is not None}


def check_out(args: Namespace) -> None:
    """Raises OutputError for an --out that cannot be written, before any work."""
    if args.out is not None:
        fresh_file(args.out, force=args.force)


def check_at_least(args: Namespace, minimum: int, *names: str) -> None:
    """Raises CommandError for the first of the options that was given a lower value."""
    for name, value in given_options(args, names).items():
        if value < minimum:
            raise CommandError(f"--{flag_name(name)} must be at least {minimum}, not {value}")
