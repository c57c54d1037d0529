"""Reads an experiment's TOML file into a list of runs with their commands; all checks happen here, before any run."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from lilgym_mp.corpus.records import FLIPIT, SCRATCH, SPLITS
from lilgym_mp.evaluation.episodes import GREEDY, SAMPLED
from lilgym_mp.evaluation.named_policies import BUILT_IN_POLICIES
from lilgym_mp.evaluation.settings import CONFIGURATIONS, Settings
from lilgym_mp.learning.learners import PACKAGES, Learner, find_learner
from lilgym_mp.options import CommandError, flag_name

ENVIRONMENT = ("rules", "horizon", "grid")
KEYS = ("corpus", "splits", "configurations", "seeds", "policies", "optimal", "learners", *ENVIRONMENT)
LEARNER_KEYS = ("name", "learner", "corpus", "configurations", "seeds", "actions", "passes")
POLICIES_RUN = "policies"


@dataclass(frozen=True)
class PlannedRun:
    """A training run with its evaluation, or the evaluation of built-in policies."""

    name: str  # name of its directories and log
    train: tuple[str, ...]  # arguments of `lilgym-mp`, except --out and --threads; empty if nothing is trained
    evaluate: tuple[tuple[str, ...], ...]  # one command per split, except the run directory and --record
    budget: tuple[str, float] | None = None  # a key of the progress file, and its value at the end of training

    @property
    def commands(self) -> list[list[str]]:
        """The commands as JSON; they identify the run."""
        return [list(self.train), *map(list, self.evaluate)]


class _Checker:
    """Checks values of the file; its errors name the file and the key."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def error(self, key: str, message: str) -> CommandError:
        return CommandError(f"{self.path}: {key}: {message}")

    def check_keys(self, prefix: str, table: Mapping[str, Any], choices: Sequence[str]) -> None:
        for key in table:
            if key not in choices:
                raise self.error(f"{prefix}{key}", f"unknown key; choose from {', '.join(choices)}")

    def checked_list(self, key: str, values: Any, choices: Sequence[Any] | None, value_type: type) -> list[Any]:
        """`values` if it is a non-empty list of distinct values of the type, all among the choices."""
        if not isinstance(values, list) or not values:
            raise self.error(key, f"must be a non-empty list, not {values!r}")
        for value in values:
            if type(value) is not value_type or (choices is not None and value not in choices):
                listed = ", ".join(map(str, choices or ()))
                rule = f"choose from {listed}" if choices else f"must be of type {value_type.__name__}"
                raise self.error(key, f"unknown value {value!r}; {rule}")
        if len(set(values)) < len(values):
            raise self.error(key, f"duplicate value in {values}")
        return values


def read_plan(path: Path) -> list[PlannedRun]:
    """The runs of an experiment's file. Raises CommandError naming the file, the key and the choices."""
    checker = _Checker(path)
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise CommandError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise CommandError(f"{path}: invalid TOML: {error}") from None
    checker.check_keys("", data, KEYS)
    known = list(CONFIGURATIONS)
    common = {
        "splits": checker.checked_list("splits", data.get("splits", ["dev"]), list(SPLITS), str),
        "configurations": checker.checked_list("configurations", data.get("configurations", known), known, str),
        "seeds": _seeds(checker, "seeds", data.get("seeds", [0])),
    }
    environment = _environment_options(checker, data, common["configurations"])
    evaluation = [*environment, *(["--optimal"] if data.get("optimal", False) else [])]
    learners = data.get("learners", [])
    if not isinstance(learners, list) or not learners or not all(isinstance(table, dict) for table in learners):
        raise checker.error("learners", "must be one or more tables [[learners]]")
    runs: list[PlannedRun] = []
    for index, table in enumerate(learners):
        runs += _learner_runs(checker, f"learners[{index}].", table, common, environment, evaluation)
    if len({run.name for run in runs}) < len(runs):
        raise checker.error("learners", "two have the same name; names must be unique")
    if "policies" in data:
        policies = checker.checked_list("policies", data["policies"], sorted(BUILT_IN_POLICIES), str)
        command = ("evaluate", "--policy", *policies, "--configuration", *common["configurations"], *evaluation)
        runs.append(PlannedRun(POLICIES_RUN, (), tuple((*command, "--split", split) for split in common["splits"])))
    return runs


def _seeds(checker: _Checker, key: str, values: Any) -> list[int]:
    seeds = checker.checked_list(key, values, None, int)
    if min(seeds) < 0:
        raise checker.error(key, f"must be at least 0, not {min(seeds)}")
    return seeds


def _environment_options(checker: _Checker, data: Mapping[str, Any], configurations: Sequence[str]) -> list[str]:
    """The environment's settings as command-line options, checked by making each environment once."""
    corpus = data.get("corpus", "builtin")
    if not isinstance(corpus, str):
        raise checker.error("corpus", f"must be a string, not {corpus!r}")
    if not isinstance(data.get("optimal", False), bool):
        raise checker.error("optimal", f"must be true or false, not {data['optimal']!r}")
    given = {key: data[key] for key in ENVIRONMENT if key in data}
    grid = given.get("grid")
    settings = {**given, **({"grid": tuple(grid)} if isinstance(grid, list) else {})}
    try:
        for name in configurations:
            Settings(name, corpus, **settings).make("dev")
    except (ValueError, TypeError) as error:
        raise checker.error(", ".join(["corpus", *given]), str(error)) from None
    options = {**given, **({"grid": "x".join(map(str, grid))} if isinstance(grid, list) else {})}
    return ["--corpus", corpus, *(word for key, value in options.items() for word in (f"--{key}", str(value)))]


def _learner_runs(
    checker: _Checker,
    prefix: str,
    table: Mapping[str, Any],
    common: Mapping[str, Any],
    environment: Sequence[str],
    evaluation: Sequence[str],
) -> Iterator[PlannedRun]:
    """The runs of one table [[learners]], for each of its configurations and seeds; `prefix`: of its keys in errors."""
    kind = table.get("learner")
    if not isinstance(kind, str) or kind not in PACKAGES:
        raise checker.error(f"{prefix}learner", f"unknown learner {kind!r}; choose from {', '.join(PACKAGES)}")
    learner = find_learner(kind)
    recipe_keys = [field.name for field in fields(learner.recipe) if field.name != "seed"]
    checker.check_keys(prefix, table, (*LEARNER_KEYS, *learner.numbers, *learner.texts, *recipe_keys))
    name = table.get("name", kind)
    if not isinstance(name, str) or not name.replace("-", "").replace("_", "").replace("+", "").isalnum():
        raise checker.error(f"{prefix}name", f"must consist of letters, digits and -, _, +, not {name!r}")
    all_configurations = common["configurations"]
    configurations = checker.checked_list(
        f"{prefix}configurations", table.get("configurations", all_configurations), all_configurations, str
    )
    if learner.plays_everything and "configurations" in table:
        raise checker.error(f"{prefix}configurations", "one agent plays all configurations; leave the key out")
    seeds = _seeds(checker, f"{prefix}seeds", table.get("seeds", common["seeds"]))
    modes = checker.checked_list(f"{prefix}actions", table.get("actions", [GREEDY]), [GREEDY, SAMPLED], str)
    passes = table.get("passes", 1)
    if type(passes) is not int or passes < 1:
        raise checker.error(f"{prefix}passes", f"must be a whole number above 0, not {passes!r}")
    options = {key: value for key, value in table.items() if key not in LEARNER_KEYS}
    training = ["--corpus", _training_corpus(checker, f"{prefix}corpus", table, configurations, environment[1])]
    if not learner.plays_everything:
        training += environment[2:]
    for configuration in (None,) if learner.plays_everything else configurations:
        budget, recipe = _checked_options(checker, prefix, learner, configuration, options)
        played = _played_configurations(configuration, recipe, all_configurations)
        evaluate = ("evaluate", "--name", name, "--actions", *modes, "--configuration", *played, *evaluation)
        evaluate = (*evaluate, *(["--passes", str(passes)] if passes > 1 else []))
        if learner.evaluate != "evaluate":
            evaluate = (learner.evaluate, *environment[:2])
        for seed in seeds:
            train = ["train", kind, *([configuration] if configuration else []), "--seed", str(seed), *training]
            yield PlannedRun(
                "-".join([name, *([configuration] if configuration else []), str(seed)]),
                (*train, *_flags(options)),
                tuple((*evaluate, "--split", split) for split in common["splits"]),
                budget,
            )


def _training_corpus(
    checker: _Checker, key: str, table: Mapping[str, Any], configurations: Sequence[str], default: str
) -> str:
    """The learner's own corpus, checked by making each environment once, or else the experiment's."""
    corpus = table.get("corpus", default)
    if not isinstance(corpus, str):
        raise checker.error(key, f"must be a string, not {corpus!r}")
    if corpus != default:
        try:
            for name in configurations:
                Settings(name, corpus).make("train")
        except ValueError as error:
            raise checker.error(key, str(error)) from None
    return corpus


def _played_configurations(configuration: str | None, recipe: Any, choices: Sequence[str]) -> Sequence[str]:
    """Those of `choices` that the agent plays: with both starts if it was trained on FlipIt and some empty scenes."""
    if configuration is None:
        return choices
    appearance, start = CONFIGURATIONS[configuration]
    starts = (SCRATCH, FLIPIT) if start == FLIPIT and getattr(recipe, "empty_starts", 0) else (start,)
    played = [name for name in choices if CONFIGURATIONS[name] in [(appearance, start) for start in starts]]
    return played or [configuration]


def _checked_options(
    checker: _Checker, prefix: str, learner: Learner, configuration: str | None, options: Mapping[str, Any]
) -> tuple[tuple[str, float], Any]:
    """The learner's budget, and the recipe that its options make."""
    for key in learner.numbers.keys() & options.keys():
        value, number = options[key], int if key == "evaluate_every" else int | float
        if isinstance(value, bool) or not isinstance(value, number) or value <= 0:
            raise checker.error(f"{prefix}{key}", f"must be a number above 0, not {value!r}")
    defaults = {field.name: field.default for field in fields(learner.recipe)}
    for key, value in options.items():
        if key in learner.numbers:
            continue
        expected = str if key in learner.texts else type(defaults[key])
        if type(value) is not expected and not (expected is float and type(value) is int):
            raise checker.error(f"{prefix}{key}", f"must be of type {expected.__name__}, not {value!r}")
    settings = {key: value for key, value in options.items() if key not in learner.numbers}
    try:
        recipe = learner.make_recipe(configuration or "", settings)
    except ValueError as error:
        raise checker.error(prefix.rstrip("."), str(error)) from None
    return learner.budget({**learner.numbers, **options}), recipe


def _flags(options: Mapping[str, Any]) -> Iterator[str]:
    for key, value in options.items():
        if isinstance(value, bool):
            yield f"--{'' if value else 'no-'}{flag_name(key)}"
        else:
            yield from (f"--{flag_name(key)}", str(value))
