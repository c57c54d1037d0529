"""Reads an experiment's TOML file into a list of runs with their commands, which are parsed here, before any run."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from lilgym_mp.cli.options import CommandError, check_at_least
from lilgym_mp.corpus.locations import fixed_name
from lilgym_mp.corpus.records import FLIPIT, SCRATCH, read_text
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.registration import CONFIGURATIONS
from lilgym_mp.evaluation.policies import GREEDY, built_in_policy
from lilgym_mp.learning.common.learners import Learner, find_learner
from lilgym_mp.scene.arrays import AnyMapping, Strings
from lilgym_mp.scene.choices import choose, flag_name

KEYS = ("splits", "configurations", "seeds", "policies", "optimal", "learners", *EnvConfig.settings())
LEARNER_KEYS = ("name", "learner", "corpus", "configurations", "seeds", "actions", "passes")
# In the text of an option, replaced by the run's seed and the results directory
SEED = "{seed}"
OUT = "{out}"
INVALID = (CommandError, ValueError, TypeError)  # raised for a value that an environment or a command refuses


@dataclass(frozen=True)
class PlannedRun:
    """A training run with its evaluation, or the evaluation of built-in policies."""

    name: str  # name of its directories and log
    train: Strings  # arguments of `lilgym-mp`, except --out and --threads; empty if nothing is trained
    evaluate: tuple[Strings, ...]  # one command per split, except the run directory and --record
    budget: tuple[str, float] | None = None  # a key of the progress file, and its value at the end of training
    records: bool = True  # whether evaluations are recorded, or else written as JSON

    @property
    def commands(self) -> list[list[str]]:
        """The commands in order, as JSON."""
        return [list(words) for words in (self.train, *self.evaluate) if words]


class _Experiment(NamedTuple):
    """Settings that the learners share."""

    splits: Sequence[str]
    configurations: Sequence[str]
    seeds: Sequence[Any]
    environment: Sequence[str]  # options, beginning with --corpus CORPUS
    evaluation: Sequence[str]  # these and further options of `evaluate`


def read_plan(path: Path, split: str | None = None) -> list[PlannedRun]:
    """The runs of an experiment's file, evaluated on `split` instead of the file's splits if given.

    Raises CommandError naming the file, the key and the choices.
    """
    try:
        values = tomllib.loads(read_text(path)[0])
    except tomllib.TOMLDecodeError as error:
        raise CommandError(f"{path}: invalid TOML: {error}") from None
    try:
        return _plan(values, split)
    except INVALID as error:
        raise CommandError(f"{path}: {error}") from None


def _plan(values: AnyMapping, split: str | None) -> list[PlannedRun]:
    _check_keys(values, KEYS)
    configurations = _distinct(values, "configurations", list(CONFIGURATIONS))
    given = {key: values[key] for key in EnvConfig.settings() if key in values}
    splits = [split] if split else _distinct(values, "splits", ["dev"])
    for name, played in product(configurations, splits):
        EnvConfig(name, **given).make(played)
    options = EnvConfig(configurations[0], **{**given, "corpus": "builtin"}).options()
    environment = ["--corpus", fixed_name(given.get("corpus", "builtin")), *options]
    if not isinstance(optimal := values.get("optimal", False), bool):
        raise CommandError(f"optimal: must be true or false, not {optimal!r}")
    evaluation = [*environment, *(["--optimal"] if optimal else [])]
    experiment = _Experiment(splits, configurations, _distinct(values, "seeds", [0]), environment, evaluation)
    learners = values.get("learners", [])
    if not isinstance(learners, list) or not learners or not all(isinstance(learner, dict) for learner in learners):
        raise CommandError("learners: must be one or more tables [[learners]]")
    runs: list[PlannedRun] = []
    for index, learner in enumerate(learners):
        try:
            runs += _learner_runs(learner, experiment)
        except INVALID as error:
            raise CommandError(f"learners[{index}]: {error}") from None
    if len({run.name for run in runs}) < len(runs):
        raise CommandError("learners: two have the same name; names must be unique")
    if "policies" in values:
        policies = _distinct(values, "policies", [])
        command = ["--policy", *(built_in_policy(name) and name for name in policies)]
        command += ["--configuration", *configurations, *evaluation]
        runs.append(PlannedRun("policies", (), tuple(_evaluations(command, splits))))
    return runs


def _check_keys(values: AnyMapping, choices: Sequence[str]) -> None:
    for key in values:
        choose("key", key, dict.fromkeys(choices))
    if not isinstance(corpus := values.get("corpus", ""), str):
        raise CommandError(f"corpus: must be a string, not {corpus!r}")


def _distinct(values: AnyMapping, key: str, default: list[Any]) -> list[Any]:
    """The value, a list of distinct elements."""
    found = values.get(key, default)
    if not isinstance(found, list) or not found or len(set(map(str, found))) < len(found):
        raise CommandError(f"{key}: must be a non-empty list of distinct values, not {found!r}")
    return found


def _learner_runs(values: AnyMapping, experiment: _Experiment) -> Iterator[PlannedRun]:
    """The runs of one table [[learners]], for each of its configurations and seeds."""
    kind = values.get("learner", "")
    learner = find_learner(kind)
    _check_keys(values, (*LEARNER_KEYS, *learner.option_names))
    name = values.get("name", kind)
    if not isinstance(name, str) or not re.fullmatch(r"[\w+-]+", name):
        raise CommandError(f"name: must consist of letters, digits and -, _, +, not {name!r}")
    if learner.config is None and "configurations" in values:
        raise CommandError("configurations: one agent plays all configurations; leave the key out")
    configurations = _distinct(values, "configurations", list(experiment.configurations))
    _, own_corpus, *settings = experiment.environment
    corpus = fixed_name(values.get("corpus", own_corpus))
    for each in configurations:
        choose("configuration", each, dict.fromkeys(experiment.configurations))
        if corpus != own_corpus:
            EnvConfig(each, corpus).make("train")
    options = {key: value for key, value in values.items() if key not in LEARNER_KEYS}
    training = ["--corpus", corpus, *(() if learner.config is None else settings), *_flags(options)]
    modes = _distinct(values, "actions", [GREEDY])
    passes = _flags({"passes": values["passes"]} if values.get("passes", 1) != 1 else {})
    seeds = _distinct(values, "seeds", list(experiment.seeds))
    for configuration in (None,) if learner.config is None else configurations:
        own = [configuration] if configuration else []
        commands = [
            ("train", kind, *own, "--seed", str(seed), *(word.replace(SEED, str(seed)) for word in training))
            for seed in seeds
        ]
        (budget, recipe), *_ = [_checked(command, learner) for command in commands]
        played = _played_configurations(configuration, recipe, experiment.configurations)
        evaluating = ["--name", name, "--actions", *modes, "--configuration", *played]
        evaluating += [*experiment.evaluation, *passes]
        if learner.plays_games:
            if unused := {"actions", "passes"} & values.keys():
                raise CommandError(f"{min(unused)}: games are evaluated once, by the most probable actions")
            evaluating = experiment.environment[:2]
        evaluations = tuple(_evaluations(evaluating, experiment.splits))
        for seed, command in zip(seeds, commands, strict=True):
            run = "-".join([name, *own, str(seed)])
            yield PlannedRun(run, command, evaluations, budget, not learner.plays_games)


def _played_configurations(configuration: str | None, recipe: Any, choices: Sequence[str]) -> Sequence[str]:
    """Selects the configurations to play: with both starts for an agent trained on FlipIt and some empty scenes.

    A recipe without this setting, as the reward model's, always trains on both.
    """
    if configuration is None:
        return choices
    appearance, start = CONFIGURATIONS[configuration]
    starts = (SCRATCH, FLIPIT) if start == FLIPIT and getattr(recipe, "empty_starts", 1) else (start,)
    played = [name for name in choices if CONFIGURATIONS[name] in [(appearance, start) for start in starts]]
    return played or [configuration]


def _checked(command: Sequence[str], learner: Learner) -> tuple[tuple[str, float], Any]:
    """The budget and the recipe of a command that trains."""
    from lilgym_mp.cli import parse_args
    from lilgym_mp.cli.training import requested

    args = parse_args(command)
    check_at_least(args, 0, "seed")
    settings, recipe, own, _ = requested(args, command[1], learner)
    if learner.plays_games:
        from lilgym_mp.envs.proposer_verifier import Game

        Game(settings)
    return learner.budget(recipe, own), recipe


def _evaluations(options: Iterable[str], splits: Iterable[str]) -> Iterator[Strings]:
    """The commands that evaluate on each split with these options."""
    from lilgym_mp.cli import parse_args

    for split in splits:
        command = ("evaluate", *options, "--split", str(split))
        check_at_least(parse_args(command), 1, "passes")
        yield command


def _flags(options: AnyMapping) -> list[str]:
    """The words of the command line for options, several for a list."""
    words: list[str] = []
    for key, value in options.items():
        if isinstance(value, bool):
            words.append(f"--{'' if value else 'no-'}{flag_name(key)}")
        else:
            words += [f"--{flag_name(key)}", *map(_word, value if isinstance(value, list) else [value])]
    return words


def _word(value: Any) -> str:
    """The value on a command line, where whole numbers have no decimal point, as 1e5 has in TOML."""
    return str(int(value) if isinstance(value, float) and value.is_integer() else value)
