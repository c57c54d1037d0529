"""Reads an experiment's TOML file into a list of runs with their commands; all checks happen here, before any run."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from lilgym_mp.corpus.records import FLIPIT, SCRATCH, SPLITS
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.registration import CONFIGURATIONS
from lilgym_mp.evaluation.options import CommandError, flag_name
from lilgym_mp.evaluation.policies import BUILT_IN_POLICIES, GREEDY, SAMPLED
from lilgym_mp.learning.common.learners import PACKAGES, Learner, find_learner

KEYS = ("splits", "configurations", "seeds", "policies", "optimal", "learners", *EnvConfig.settings())
LEARNER_KEYS = ("name", "learner", "corpus", "configurations", "seeds", "actions", "passes")
POLICIES_RUN = "policies"


@dataclass(frozen=True)
class PlannedRun:
    """A training run with its evaluation, or the evaluation of built-in policies."""

    name: str  # name of its directories and log
    train: tuple[str, ...]  # arguments of `lilgym-mp`, except --out and --threads; empty if nothing is trained
    evaluate: tuple[tuple[str, ...], ...]  # one command per split, except the run directory and --record
    budget: tuple[str, float] | None = None  # a key of the progress file, and its value at the end of training
    records: bool = True  # whether evaluations are recorded, or else written as JSON

    @property
    def commands(self) -> list[list[str]]:
        """The commands as JSON; they identify the run."""
        return [list(self.train), *map(list, self.evaluate)]


class _Table:
    """A table of the file; its errors name the file and the key."""

    def __init__(self, path: Path, prefix: str, values: Mapping[str, Any]) -> None:
        """`prefix`: of its keys in errors."""
        self.path = path
        self.prefix = prefix
        self.values = values

    def error(self, key: str, message: str) -> CommandError:
        return CommandError(f"{self.path}: {self.prefix}{key}: {message}")

    def check_keys(self, choices: Sequence[str]) -> None:
        for key in self.values:
            if key not in choices:
                raise self.error(key, f"unknown key; choose from {', '.join(choices)}")

    def value(self, key: str, default: Any, rule: str) -> Any:
        """The value if it has the type of the default; else an error with the rule."""
        value = self.values.get(key, default)
        if type(value) is not type(default):
            raise self.error(key, f"must be {rule}, not {value!r}")
        return value

    def distinct(self, key: str, default: list[Any], choices: Iterable[Any] = ()) -> list[Any]:
        """The value if it is a list of distinct values of the default's type, and of the choices if there are any."""
        values = self.values.get(key, default)
        if not isinstance(values, list) or not values:
            raise self.error(key, f"must be a non-empty list, not {values!r}")
        choices, value_type = list(choices), type(default[0])
        for value in values:
            if type(value) is not value_type or (choices and value not in choices):
                listed = f"choose from {', '.join(choices)}" if choices else f"must be of type {value_type.__name__}"
                raise self.error(key, f"unknown value {value!r}; {listed}")
        if len(set(values)) < len(values):
            raise self.error(key, f"duplicate value in {values}")
        return values

    def seeds(self, default: list[int]) -> list[int]:
        seeds = self.distinct("seeds", default)
        if min(seeds) < 0:
            raise self.error("seeds", f"must be at least 0, not {min(seeds)}")
        return seeds

    def check_environment(
        self, keys: Sequence[str], configurations: Sequence[str], split: str, **settings: Any
    ) -> None:
        """Makes each environment once; `keys` are those to name in an error."""
        try:
            for name in configurations:
                EnvConfig(name, **settings).make(split)
        except (ValueError, TypeError) as error:
            raise self.error(", ".join(keys), str(error)) from None


class _Experiment(NamedTuple):
    """Settings that the learners share."""

    splits: Sequence[str]
    configurations: Sequence[str]
    seeds: list[int]
    environment: Sequence[str]  # options, beginning with --corpus CORPUS
    evaluation: Sequence[str]  # these and further options of `evaluate`


def read_plan(path: Path, split: str | None = None) -> list[PlannedRun]:
    """The runs of an experiment's file, evaluated on `split` instead of the file's splits if given.

    Raises CommandError naming the file, the key and the choices.
    """
    try:
        table = _Table(path, "", tomllib.loads(path.read_text(encoding="utf-8-sig")))
    except OSError as error:
        raise CommandError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise CommandError(f"{path}: invalid TOML: {error}") from None
    table.check_keys(KEYS)
    splits = table.distinct("splits", ["dev"], SPLITS) if split is None else [split]
    configurations = table.distinct("configurations", list(CONFIGURATIONS), CONFIGURATIONS)
    environment = _environment_options(table, configurations, split or "dev")
    evaluation = [*environment, *["--optimal"] * table.value("optimal", False, "true or false")]
    experiment = _Experiment(splits, configurations, table.seeds([0]), environment, evaluation)
    learners = table.values.get("learners", [])
    if not isinstance(learners, list) or not learners or not all(isinstance(values, dict) for values in learners):
        raise table.error("learners", "must be one or more tables [[learners]]")
    runs: list[PlannedRun] = []
    for index, values in enumerate(learners):
        runs += _learner_runs(_Table(path, f"learners[{index}].", values), experiment)
    if len({run.name for run in runs}) < len(runs):
        raise table.error("learners", "two have the same name; names must be unique")
    if "policies" in table.values:
        policies = table.distinct("policies", [""], sorted(BUILT_IN_POLICIES))
        command = ("evaluate", "--policy", *policies, "--configuration", *configurations, *evaluation)
        runs.append(PlannedRun(POLICIES_RUN, (), tuple((*command, "--split", split) for split in splits)))
    return runs


def _environment_options(table: _Table, configurations: Sequence[str], split: str) -> list[str]:
    """The environment's settings as command-line options, checked by making each environment once."""
    given = {key: table.values[key] for key in EnvConfig.settings() if key in table.values}
    corpus = table.value("corpus", "builtin", "a string")
    table.check_environment(list(given) or ["corpus"], configurations, split, **given)
    return ["--corpus", corpus, *EnvConfig(configurations[0], **{**given, "corpus": "builtin"}).options()]


def _learner_runs(table: _Table, experiment: _Experiment) -> Iterator[PlannedRun]:
    """The runs of one table [[learners]], for each of its configurations and seeds."""
    kind = table.values.get("learner")
    if not isinstance(kind, str) or kind not in PACKAGES:
        raise table.error("learner", f"unknown learner {kind!r}; choose from {', '.join(PACKAGES)}")
    learner = find_learner(kind)
    table.check_keys((*LEARNER_KEYS, *learner.option_names))
    name = table.values.get("name", kind)
    if not isinstance(name, str) or not name.replace("-", "").replace("_", "").replace("+", "").isalnum():
        raise table.error("name", f"must consist of letters, digits and -, _, +, not {name!r}")
    configurations = table.distinct("configurations", list(experiment.configurations), experiment.configurations)
    if learner.config is None and "configurations" in table.values:
        raise table.error("configurations", "one agent plays all configurations; leave the key out")
    seeds = table.seeds(experiment.seeds)
    modes = table.distinct("actions", [GREEDY], [GREEDY, SAMPLED])
    passes = table.value("passes", 1, "a whole number above 0")
    if passes < 1:
        raise table.error("passes", f"must be a whole number above 0, not {passes}")
    options = {key: value for key, value in table.values.items() if key not in LEARNER_KEYS}
    _, own_corpus, *settings = experiment.environment
    corpus = table.value("corpus", own_corpus, "a string")
    if corpus != own_corpus:
        table.check_environment(["corpus"], configurations, "train", corpus=corpus)
    training = ["--corpus", corpus, *(() if learner.config is None else settings)]
    for configuration in (None,) if learner.config is None else configurations:
        own = [configuration] if configuration else []
        command = (*own, *training, *_flags(options))
        budget, recipe = _checked_options(table, kind, learner, command)
        played = _played_configurations(configuration, recipe, experiment.configurations)
        evaluate = ("evaluate", "--name", name, "--actions", *modes, "--configuration", *played)
        evaluate = (*evaluate, *experiment.evaluation, *(["--passes", str(passes)] if passes > 1 else []))
        if learner.plays_games:
            evaluate = ("evaluate", *experiment.environment[:2])
        for seed in seeds:
            yield PlannedRun(
                "-".join([name, *own, str(seed)]),
                ("train", kind, *own, "--seed", str(seed), *training, *_flags(options)),
                tuple((*evaluate, "--split", split) for split in experiment.splits),
                budget,
                not learner.plays_games,
            )


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


def _checked_options(
    table: _Table, name: str, learner: Learner, command: Sequence[str]
) -> tuple[tuple[str, float], Any]:
    """The budget and the recipe of `train`'s command with these words."""
    from lilgym_mp.cli import parse_args
    from lilgym_mp.learning.common.commands import requested

    try:
        settings, recipe, own, _ = requested(parse_args(["train", name, *command]), name, learner)
        if learner.plays_games:
            settings.setup()
    except (CommandError, ValueError) as error:
        raise CommandError(f"{table.path}: {table.prefix.rstrip('.')}: {error}") from None
    return learner.budget(recipe, own), recipe


def _flags(options: Mapping[str, Any]) -> Iterator[str]:
    """The words of the command line for options, several for a list."""
    for key, value in options.items():
        if isinstance(value, bool):
            yield f"--{'' if value else 'no-'}{flag_name(key)}"
        else:
            yield from (f"--{flag_name(key)}", *map(str, value if isinstance(value, list) else [value]))
