"""What an experiment's file asks for: every run with its commands, checked before any of them begins."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from lilgym_mp.cli.errors import CommandError
from lilgym_mp.cli.options import option
from lilgym_mp.corpus.records import FLIPIT, SCRATCH, SPLITS
from lilgym_mp.evaluation.named_policies import BUILT_IN
from lilgym_mp.evaluation.settings import CONFIGURATIONS, Settings
from lilgym_mp.learning.imitation.recipe import ImitationRecipe, default_recipe
from lilgym_mp.learning.parsing.recipe import ParserRecipe
from lilgym_mp.learning.ppo.recipe import DEFAULT_RECIPE, PPORecipe, make_recipe

PARSE_AND_PLAN, IMITATION, PPO = "parse-and-plan", "imitation", "ppo"
RECIPES: Mapping[str, Any] = {PARSE_AND_PLAN: ParserRecipe, IMITATION: ImitationRecipe, PPO: PPORecipe}
# By learner, options of its training beside the recipe, with their defaults.
BUDGETS: Mapping[str, Mapping[str, Any]] = {
    PARSE_AND_PLAN: {},
    IMITATION: {"minutes": 10.0},
    PPO: {"steps": 1_000_000, "evaluate_every": None},
}
TEXTS: Mapping[str, Sequence[str]] = {PPO: ("recipe", "weights")}  # by learner, further options of its training
ENVIRONMENT = ("rules", "horizon", "grid")
KEYS = ("corpus", "splits", "configurations", "seeds", "policies", "optimal", "learners", *ENVIRONMENT)
LEARNER_KEYS = ("name", "learner", "corpus", "configurations", "seeds", "actions")
POLICIES_RUN = "policies"


@dataclass(frozen=True)
class PlannedRun:
    """A training run with its evaluation, or the evaluation of simple policies."""

    name: str  # of its directories and log
    train: tuple[str, ...]  # words after `lilgym-mp`, but for --out and --threads; empty where nothing is trained
    evaluate: tuple[tuple[str, ...], ...]  # one command a split, but for the run's directory and --record
    budget: tuple[str, float] | None = None  # the entry of the progress that grows to this number

    @property
    def commands(self) -> list[list[str]]:
        """What makes the run that run, as JSON has it."""
        return [list(self.train), *map(list, self.evaluate)]


class _File:
    """Faults with the file's name before them."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def error(self, key: str, message: str) -> CommandError:
        return CommandError(f"{self.path}: {key}: {message}")

    def known(self, where: str, given: Mapping[str, Any], choices: Sequence[str]) -> None:
        for key in given:
            if key not in choices:
                raise self.error(f"{where}{key}", f"unknown key; choose from {', '.join(choices)}")

    def some(self, key: str, values: Any, choices: Sequence[Any] | None, kind: type) -> list[Any]:
        """A list that holds something, each once, all of them choices."""
        if not isinstance(values, list) or not values:
            raise self.error(key, f"must be a list with something in it, not {values!r}")
        for value in values:
            if type(value) is not kind or (choices is not None and value not in choices):
                named = ", ".join(map(str, choices or ()))
                offered = f"choose from {named}" if choices else f"must be of type {kind.__name__}"
                raise self.error(key, f"unknown value {value!r}; {offered}")
        if len(set(values)) < len(values):
            raise self.error(key, f"the same value twice in {values}")
        return values


def read_plan(path: Path) -> list[PlannedRun]:
    """The runs that the file asks for. Raises CommandError naming file, key and choices."""
    file = _File(path)
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise CommandError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise CommandError(f"{path}: no TOML: {error}") from None
    file.known("", data, KEYS)
    known = list(CONFIGURATIONS)
    common = {
        "splits": file.some("splits", data.get("splits", ["dev"]), list(SPLITS), str),
        "configurations": file.some("configurations", data.get("configurations", known), known, str),
        "seeds": _seeds(file, "seeds", data.get("seeds", [0])),
    }
    environment = _environment(file, data, common["configurations"])
    evaluated = [*environment, *(["--optimal"] if data.get("optimal", False) else [])]
    learners = data.get("learners", [])
    if not isinstance(learners, list) or not learners or not all(isinstance(one, dict) for one in learners):
        raise file.error("learners", "must be one or several tables [[learners]]")
    runs: list[PlannedRun] = []
    for index, learner in enumerate(learners):
        runs += _learner_runs(file, f"learners[{index}].", learner, common, environment, evaluated)
    if len({run.name for run in runs}) < len(runs):
        raise file.error("learners", "two have the same name; give each a name of its own")
    if "policies" in data:
        policies = file.some("policies", data["policies"], sorted(BUILT_IN), str)
        words = ("evaluate", "--policy", *policies, "--configuration", *common["configurations"], *evaluated)
        runs.append(PlannedRun(POLICIES_RUN, (), tuple((*words, "--split", split) for split in common["splits"])))
    return runs


def _seeds(file: _File, key: str, values: Any) -> list[int]:
    seeds = file.some(key, values, None, int)
    if min(seeds) < 0:
        raise file.error(key, f"must be at least 0, not {min(seeds)}")
    return seeds


def _environment(file: _File, data: Mapping[str, Any], configurations: Sequence[str]) -> list[str]:
    """The environment as options, once it can be made."""
    corpus = data.get("corpus", "builtin")
    if not isinstance(corpus, str):
        raise file.error("corpus", f"must be a text, not {corpus!r}")
    if not isinstance(data.get("optimal", False), bool):
        raise file.error("optimal", f"must be true or false, not {data['optimal']!r}")
    given = {key: data[key] for key in ENVIRONMENT if key in data}
    grid = given.get("grid")
    settings = {**given, **({"grid": tuple(grid)} if isinstance(grid, list) else {})}
    try:
        for name in configurations:
            Settings(name, corpus, **settings).make("dev")
    except (ValueError, TypeError) as error:
        raise file.error(", ".join(["corpus", *given]), str(error)) from None
    shown = {**given, **({"grid": "x".join(map(str, grid))} if isinstance(grid, list) else {})}
    return ["--corpus", corpus, *(word for key, value in shown.items() for word in (f"--{key}", str(value)))]


def _learner_runs(
    file: _File,
    where: str,
    learner: Mapping[str, Any],
    common: Mapping[str, Any],
    environment: Sequence[str],
    evaluated: Sequence[str],
) -> Iterator[PlannedRun]:
    kind = learner.get("learner")
    if not isinstance(kind, str) or kind not in RECIPES:
        raise file.error(f"{where}learner", f"unknown learner {kind!r}; choose from {', '.join(RECIPES)}")
    recipe = [field.name for field in fields(RECIPES[kind]) if field.name != "seed"]
    file.known(where, learner, (*LEARNER_KEYS, *BUDGETS[kind], *TEXTS.get(kind, ()), *recipe))
    name = learner.get("name", kind)
    if not isinstance(name, str) or not name.replace("-", "").replace("_", "").replace("+", "").isalnum():
        raise file.error(f"{where}name", f"must be of letters, digits and -, _, +, not {name!r}")
    every = common["configurations"]
    configurations = file.some(f"{where}configurations", learner.get("configurations", every), every, str)
    if kind == PARSE_AND_PLAN and "configurations" in learner:
        raise file.error(f"{where}configurations", "one agent plays all configurations here; leave the key out")
    seeds = _seeds(file, f"{where}seeds", learner.get("seeds", common["seeds"]))
    manners = file.some(f"{where}actions", learner.get("actions", ["greedy"]), ["greedy", "sampled"], str)
    options = {key: value for key, value in learner.items() if key not in LEARNER_KEYS}
    learnt = ["--corpus", _training_corpus(file, f"{where}corpus", learner, configurations, environment[1])]
    for configuration in (None,) if kind == PARSE_AND_PLAN else configurations:
        budget, recipe = _checked_options(file, where, kind, configuration, options)
        for seed in seeds:
            words = ["train", kind, *([configuration] if configuration else []), "--seed", str(seed)]
            words += learnt if kind == PARSE_AND_PLAN else [*learnt, *environment[2:]]
            played = _played(configuration, recipe, every)
            test = ("evaluate", "--name", name, "--actions", *manners, "--configuration", *played, *evaluated)
            yield PlannedRun(
                "-".join([name, *([configuration] if configuration else []), str(seed)]),
                (*words, *_flags(options)),
                tuple((*test, "--split", split) for split in common["splits"]),
                budget,
            )


def _training_corpus(
    file: _File, key: str, learner: Mapping[str, Any], configurations: Sequence[str], default: str
) -> str:
    """What the learner is trained on: the experiment's corpus unless it names its own, once that is there."""
    corpus = learner.get("corpus", default)
    if not isinstance(corpus, str):
        raise file.error(key, f"must be a text, not {corpus!r}")
    if corpus != default:
        try:
            for name in configurations:
                Settings(name, corpus).make("train")
        except ValueError as error:
            raise file.error(key, str(error)) from None
    return corpus


def _played(configuration: str | None, recipe: Any, every: Sequence[str]) -> Sequence[str]:
    """The experiment's configurations that the agent plays: both starts if a FlipIt run begins some episodes empty."""
    if configuration is None:
        return every
    appearance, start = CONFIGURATIONS[configuration]
    starts = (SCRATCH, FLIPIT) if start == FLIPIT and recipe.empty_starts else (start,)
    played = [name for name in every if CONFIGURATIONS[name] in [(appearance, one) for one in starts]]
    return played or [configuration]


def _checked_options(
    file: _File, where: str, kind: str, configuration: str | None, options: Mapping[str, Any]
) -> tuple[tuple[str, float], Any]:
    """The learner's budget, and the recipe that its options make."""
    budgets = {key: options.get(key, default) for key, default in BUDGETS[kind].items()}
    for key, value in budgets.items():
        kinds = int if key == "evaluate_every" else int | float
        if key in options and (isinstance(value, bool) or not isinstance(value, kinds) or value <= 0):
            raise file.error(f"{where}{key}", f"must be a number above 0, not {value!r}")
    texts = TEXTS.get(kind, ())
    rest = {key: value for key, value in options.items() if key not in budgets and key not in texts}
    defaults = {field.name: field.default for field in fields(RECIPES[kind])}
    for key in texts:
        if not isinstance(options.get(key, ""), str):
            raise file.error(f"{where}{key}", f"must be of type str, not {options[key]!r}")
    for key, value in rest.items():
        wanted = type(defaults[key])
        if type(value) is not wanted and not (wanted is float and type(value) is int):
            raise file.error(f"{where}{key}", f"must be of type {wanted.__name__}, not {value!r}")
    try:
        if kind == IMITATION and configuration:
            made = default_recipe(CONFIGURATIONS[configuration][0], **rest)
        elif kind == PPO and configuration:
            made = make_recipe(options.get("recipe", DEFAULT_RECIPE), configuration, **rest)
        else:
            made = RECIPES[kind](**rest)
    except ValueError as error:
        raise file.error(where.rstrip("."), str(error)) from None
    if kind == IMITATION:
        return ("cpu_seconds", 60 * budgets["minutes"]), made
    budget = ("steps", budgets["steps"]) if kind == PPO else ("step", options.get("steps", defaults["steps"]))
    return budget, made


def _flags(options: Mapping[str, Any]) -> Iterator[str]:
    for key, value in options.items():
        if isinstance(value, bool):
            yield f"--{'' if value else 'no-'}{option(key)}"
        else:
            yield from (f"--{option(key)}", str(value))
