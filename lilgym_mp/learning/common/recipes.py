"""Hyperparameters and further options of training, as dataclass fields with descriptions. Imports no torch."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import Field, asdict, dataclass, fields
from typing import Any, ClassVar, Self

from lilgym_mp.envs.config import option_name, setting
from lilgym_mp.envs.registration import CONFIGURATIONS
from lilgym_mp.scene.appearances import part_of
from lilgym_mp.scene.arrays import AnyDict, AnyMapping
from lilgym_mp.scene.choices import choose, flag_name


class Recipe:
    """Base of recipes: frozen dataclasses whose fields are made by `setting`."""

    __slots__ = ()
    dashes: ClassVar[str] = ""  # before names in errors
    by_appearance: ClassVar[Mapping[str, AnyMapping]] = {}  # settings that differ from the fields' defaults

    def __post_init__(self) -> None:
        """Raises ValueError naming the first setting out of bounds, its value and its bounds or choices."""
        for each in self.settings():
            value = getattr(self, each.name)
            lowest, highest = each.metadata["bounds"]
            name = self.dashes + flag_name(option_name(each))
            if each.metadata["choices"]:
                choose(name, value, dict.fromkeys(each.metadata["choices"]))
            elif value is None or each.metadata["kind"] not in (bool, int, float):
                continue
            elif not lowest <= value <= highest:
                upper = "" if highest == math.inf else f" and at most {highest:g}"
                raise ValueError(f"{name} must be at least {lowest:g}{upper}, not {value}")
            elif each.name == "width" and value % lowest:
                raise ValueError(f"{name} must be a multiple of {lowest}, not {value}")

    @classmethod
    def of(cls, configuration: str, named: str | None = None, **changes: Any) -> Self:
        """The recipe for a configuration, or the one `named` so if a learner has several, with some settings changed.

        Raises ValueError naming the choices, or a setting and its bounds.
        """
        defaults: AnyMapping = {}
        if cls.by_appearance:
            appearance, _ = choose("configuration", configuration, CONFIGURATIONS)
            defaults = part_of(appearance, "recipe for this learner", cls.by_appearance)
        return cls(**{**defaults, **changes})

    def to_json(self) -> AnyDict:
        """All settings by name."""
        return asdict(self)  # pyright: ignore[reportArgumentType]

    @classmethod
    def from_json(cls, data: AnyMapping) -> Self:
        """Inverse of `to_json`. Raises ValueError naming an unknown setting, TypeError."""
        cls.check_known(data)
        return cls(**data)

    @classmethod
    def settings(cls) -> Sequence[Field[Any]]:
        """The fields of the recipe, in their order."""
        return fields(cls)  # pyright: ignore[reportArgumentType]

    @classmethod
    def names(cls) -> list[str]:
        """Names of all settings."""
        return [each.name for each in cls.settings()]

    @classmethod
    def check_known(cls, data: Iterable[str]) -> None:
        """Raises ValueError for an unknown setting, naming the choices."""
        for name in data:
            if name not in cls.names():
                raise ValueError(f"unknown setting {name!r} of a recipe; choose from {', '.join(cls.names())}")


class RunOptions(Recipe):
    """Base of the options of a run besides its environment and recipe: frozen dataclasses made like recipes."""

    __slots__ = ()
    dashes = "--"

    @classmethod
    def remembered(cls, saved: AnyMapping) -> AnyDict:
        """The options, by name, that a saved run's identity or its own options contain."""
        kinds = {each.name: each.metadata["kind"] for each in cls.settings()}
        return {name: kind(saved[name]) for name, kind in kinds.items() if saved.get(name) is not None}


@dataclass(frozen=True, slots=True)
class UpdateBudget(RunOptions):
    """Options of learners whose budget is counted in updates of the optimiser."""

    updates: int = setting(1_000, "updates of the optimiser", 1)
    minutes: float | None = setting(None, "end after this CPU time, even if fewer were made", kind=float, metavar="N")
    seed: int = setting(0, "random seed of network and data")


@dataclass(frozen=True, slots=True)
class UpdateRecipe(Recipe):
    """Hyperparameters of tasks, rollouts and updates, also used by other learners; the defaults are those of `ours`."""

    seed: int = setting(0, "seed of the tasks, the network and the sampled actions", 0, 2**32 - 1)
    recolour: bool = setting(True, "augment tasks by permuting colours in words and scenes alike")
    empty_starts: float = setting(
        0.25, "fraction of episodes from the empty scene in a FlipIt run; above 0 the agent also plays Scratch", 0, 0.9
    )
    held_out: float = setting(0.04, "fraction of training statements held out for validation", 0, 0.5)
    envs: int = setting(512, "parallel environments", 1)
    same_statement: int = setting(16, "environments per group; a group plays one statement at a time", 1)
    rollout: int = setting(4096, "steps per rollout, over all environments", 1)
    batch_size: int = setting(1024, "mini-batch size", 1)
    microbatch: int = setting(0, "states per backward pass (gradient accumulation); 0: the whole mini-batch")
    epochs: int = setting(2, "epochs per rollout", 1)
    optimiser: str = setting("adam", "adam, or adamw with a weight decay of 0.01", choices=("adam", "adamw"))
    learning_rate: float = setting(1e-3, "peak learning rate", 0, 1)
    schedule: str = setting(
        "linear",
        "decay of the learning rate to 0 at the last step, or constant",
        choices=("constant", "linear", "cosine"),
    )
    warmup: float = setting(0.0, "fraction of the steps for linear warm-up", 0, 1, flag="warm_up")
    entropy: float = setting(0.08, "initial entropy coefficient")
    final_entropy: float = setting(0.01, "final entropy coefficient; linear in between")
    gamma: float = setting(0.99, "discount factor", 0, 1)
    gae_lambda: float = setting(0.95, "lambda of generalised advantage estimation", 0, 1)
    advantages: str = setting(
        "scaled",
        "normalised: zero mean, unit variance per rollout; scaled: not centred",
        choices=("normalised", "scaled"),
    )
    forced_baseline: bool = setting(
        False, "subtract the value baseline from the advantage of a forced STOP, too; else it is its return"
    )
    clip: float = setting(0.2, "clip range of the probability ratio")
    ratio_cap: float = setting(10.0, "M: cap on the probability ratio of a forced STOP", 1)
    cap_every_ratio: bool = setting(False, "cap the ratios of unforced actions, too, as the paper does")
    value: float = setting(0.5, "coefficient of the value loss, half the squared error")
    clip_value: bool = setting(False, "clip the change of the value like the ratio")
    gradient_norm: float = setting(0.5, "gradient clipping norm")

    def __post_init__(self) -> None:
        """Raises ValueError naming the setting, its value and its bounds or choices."""
        Recipe.__post_init__(self)
        for whole, part in (("rollout", "envs"), ("envs", "same_statement")):
            if getattr(self, whole) % getattr(self, part):
                raise ValueError(
                    f"{flag_name(whole)} must be a multiple of {flag_name(part)}:"
                    f" {getattr(self, whole)} is not a multiple of {getattr(self, part)}"
                )
        if self.batch_size > self.rollout:
            raise ValueError(f"batch-size must be at most rollout, {self.rollout}, not {self.batch_size}")


@dataclass(frozen=True)
class PairRecipe(Recipe):
    """Hyperparameters of learning to write the programs of statements."""

    batch_size: int = setting(32, "pairs per batch", 1)
    learning_rate: float = setting(2e-3, "peak learning rate of AdamW; cosine decay to 0", 1e-9)
    weight_decay: float = setting(0.01, "weight decay of AdamW")
    smoothing: float = setting(0.05, "label smoothing", 0, 1)
    unknown: float = setting(
        0.03, "word dropout: fraction of words replaced by the unknown word", 0, 1, flag="unknown_words"
    )
    generated: float = setting(0.8, "initial fraction of generated pairs; it falls linearly to an eighth of that", 0, 1)
    shapes: float = setting(0.5, "fraction of pairs augmented by exchanging shapes", 0, 1)
    numbers: float = setting(0.5, "fraction of pairs augmented by exchanging numbers", 0, 1)
