"""The fields of an environment, each once; keywords, command-line options and JSON derive from them."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import KW_ONLY, Field, dataclass, field, fields
from typing import TYPE_CHECKING, Any, Self, cast

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from lilgym_mp.corpus import TaskSet, load_tasks
from lilgym_mp.corpus.locations import fixed_name, fixed_path
from lilgym_mp.envs.observation import TEXT
from lilgym_mp.envs.registration import configuration_name, environment_id, read_configuration
from lilgym_mp.envs.rules import RULE_SETS, Dynamics, make_dynamics
from lilgym_mp.scene.appearances import NATIVE, RELEASED_GRID, make_appearance
from lilgym_mp.scene.appearances.grids import read_grid

if TYPE_CHECKING:
    from lilgym_mp.corpus.statement_arrays import VocabularyOrPath
    from lilgym_mp.envs.batched import BatchedEnv
    from lilgym_mp.envs.sampling import Sampler
    from lilgym_mp.envs.single import LilGymEnv

CORPUS_HELP = '"builtin" (default), "lilgym" (the official corpus), or a path'
COARSE_GRID_HELP = f"columns and rows of Scatter (default: {'x'.join(map(str, RELEASED_GRID))})"
GRID_HELP = f'{COARSE_GRID_HELP}, or "{NATIVE}" for pixels'


def setting(
    default: Any,
    description: str,
    lowest: float = 0,
    highest: float = math.inf,
    *,
    choices: Collection[str] = (),
    kind: Callable[[str], Any] | None = None,
    **shown: Any,
) -> Any:
    """A field of an environment, a recipe or a run's options that is also an option of commands.

    `description` is its help text; recipes and options check `lowest` to `choices`. `choices` are for strings.
    `kind`: the type, or a function that reads the command line's text and raises ValueError; by default the type of the
    default. `shown`: how the command line shows an option: its `metavar`, `nargs`, or another `flag`.
    """
    metadata = {"description": description, "bounds": (lowest, highest), "choices": choices}
    more = {"kind": kind or type(default), "shown": shown}
    return field(default=default, metadata={**metadata, **more})


def option_name(field: Field[Any]) -> str:
    """The name of a field as an option, which may differ from the field's: that of a saved recipe never changes."""
    return field.metadata["shown"].get("flag", field.name)


def _plain(value: Any) -> Any:
    """Lists, as from JSON, and arrays as tuples, and NumPy's integers as ints, so that equal settings are equal."""
    if isinstance(value, np.integer):
        return int(value)
    if type(value) in (list, tuple) or (isinstance(value, np.ndarray) and value.ndim):
        return tuple(_plain(part) for part in value)
    return value


@dataclass(frozen=True)
class EnvConfig:
    """The identity of an environment; all but the split and the image size is part of the identity of a run.

    Args:
        configuration: Its name, such as "TowerScratch", or a Gymnasium id, which becomes that name.
        corpus: As for `load_tasks`.
        rules: The rule set, "paper" or "release".
        horizon: Actions per episode; None: the rule set's.
        grid: Scatter's columns and rows, or a name.
        split: The split of the tasks.
        image_size: "half", (50, 190, 3), or "native", (100, 380, 3).

    Raises:
        ValueError: For an unknown configuration; the message names the choices. Values of other fields are checked when
            they are used.
    """

    configuration: str  # or a Gymnasium id, which becomes the configuration's name
    corpus: str = setting("builtin", CORPUS_HELP, kind=fixed_name)
    split: str = field(default="train", kw_only=True)
    rules: str = setting("paper", "rule set (default: paper)", choices=sorted(RULE_SETS))
    horizon: int | None = setting(None, "actions per episode (default: the rule set's)", kind=int)
    grid: tuple[int, int] | str = setting(RELEASED_GRID, GRID_HELP, kind=read_grid)
    image_size: str = field(default="half", kw_only=True)  # "half" or "native"

    def __post_init__(self) -> None:
        """Raises ValueError naming the choices for an unknown configuration; what is made of the rest checks it."""
        for each in fields(self):
            object.__setattr__(self, each.name, _plain(getattr(self, each.name)))
        object.__setattr__(self, "configuration", configuration_name(*read_configuration(self.configuration)))
        object.__setattr__(self, "corpus", fixed_name(self.corpus))

    @classmethod
    def of(cls, given: Mapping[str, Any], *others: str) -> Self:
        """The configuration with these keywords; `appearance` and `start` may stand for `configuration`.

        Args:
            given: The keywords.
            others: Further keywords to name in errors.

        Raises:
            TypeError: For an unknown keyword; the message names what replaces it, or the choices.
            ValueError: For an unknown configuration.
        """
        values = {name: value for name, value in given.items() if name != "configuration" or value is not None}
        parts = {name: values.pop(name) for name in ("appearance", "start") if name in values}
        if parts:
            if "configuration" in values:
                raise ValueError("give a configuration, or appearance and start, not both")
            values["configuration"] = configuration_name(**parts)
        names = [each.name for each in fields(cls)]
        if unknown := values.keys() - set(names):
            from lilgym_mp.envs.keywords import check_keywords

            check_keywords(unknown, [*names[1:], *others])
        return cls(**values)

    @classmethod
    def settings(cls) -> dict[str, Field[Any]]:
        """The fields made by `setting`, by name."""
        return {each.name: each for each in fields(cls) if "description" in each.metadata}

    @property
    def appearance(self) -> str:
        """Name of the appearance, the first part of the configuration's name."""
        return read_configuration(self.configuration)[0]

    @property
    def start(self) -> str:
        """How episodes start, the second part of the configuration's name."""
        return read_configuration(self.configuration)[1]

    @property
    def id(self) -> str:
        """The Gymnasium id, such as "lilgym_mp/TowerScratch-v0"."""
        return environment_id(self.appearance, self.start)

    def dynamics(self) -> Dynamics:
        """The MDP's rules, without its tasks.

        Raises:
            ValueError: For invalid settings; the message names the value and the choices.
        """
        return make_dynamics(make_appearance(self.appearance, self.grid), self.rules, self.horizon)

    def tasks(self, split: str | None = None) -> TaskSet:
        """The tasks of a split.

        Args:
            split: The split, by default its own.

        Raises:
            CorpusError: For unusable data.
            ValueError: For an unknown split.
        """
        return load_tasks(self.corpus, self.appearance, self.start, split or self.split)

    def values(self) -> dict[str, Any]:
        """The values of the fields made by `setting`, by name."""
        return {name: getattr(self, name) for name in self.settings()}

    def single(self) -> EnvConfig:
        """The configuration of the single environment with the same corpus and rules."""
        return EnvConfig(self.configuration, **{name: getattr(self, name) for name in EnvConfig.settings()})

    def arguments(self, split: str | None = None) -> dict[str, Any]:
        """The keyword arguments of `gymnasium.make`.

        Args:
            split: The split, by default its own.
        """
        return {**self.values(), "split": split or self.split}

    def make(self, split: str | None = None) -> LilGymEnv:
        """A new environment, without Gymnasium's own wrappers.

        Args:
            split: The split, by default its own.

        Raises:
            ValueError: For invalid settings; the message names the value and the choices.
            CorpusError: For unusable data.
        """
        env = gym.make(self.id, disable_env_checker=True, **self.arguments(split))
        return cast("LilGymEnv", env.unwrapped)

    def make_batch(self, split: str, num_envs: int) -> BatchedEnv:
        """Batched environments without autoreset, whose images are valid until the next step.

        Args:
            split: The split of the tasks.
            num_envs: The number of environments.

        Raises:
            ValueError: As `make`.
            CorpusError: As `make`.
        """
        own = {"num_envs": num_envs, "copy": False, "autoreset_mode": AutoresetMode.DISABLED}
        return cast("BatchedEnv", gym.make_vec(self.id, **own, **self.arguments(split)))

    def options(self) -> list[str]:
        """The words of a command line for the settings that differ from the defaults."""
        words: list[str] = []
        for name, each in self.settings().items():
            if (value := getattr(self, name)) != each.default:
                text = "x".join(map(str, value)) if isinstance(value, tuple) else str(value)
                words += [f"--{name.replace('_', '-')}", text]
        return words

    def to_json(self) -> dict[str, Any]:
        """All values in types of JSON; `EnvConfig(**values)` gives the same settings."""
        values = {"configuration": self.configuration, **self.values()}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """Inverse of `to_json`.

        Args:
            data: The values by name.

        Raises:
            ValueError: For an invalid value.
            TypeError: For an unknown key, or a value of a wrong type.
            KeyError: For a missing key.
        """
        config = cls(**{"configuration": data["configuration"], **data})
        config.dynamics()
        return config


@dataclass(frozen=True)
class SingleConfig(EnvConfig):
    """The configuration of single environments and of batches: also how they are observed."""

    _: KW_ONLY
    observation: str = TEXT  # or "arrays", for learners without text: "statement" int64 (length,), "target" int64 (1,)
    vocabulary: VocabularyOrPath | None = None  # of "arrays", or a saved one's path; None: that of the train split
    length: int | None = None  # of "arrays"; None: that of the longest statement
    sampler: Sampler | None = None  # chooses the task of every reset without the option "task"

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "vocabulary", fixed_path(self.vocabulary))
        if self.sampler is not None and not callable(self.sampler):
            raise ValueError(f"sampler must be a function of a generator and an index, or None, not {self.sampler!r}")

    def tasks(self, split: str | None = None) -> TaskSet:
        """The sampler's own tasks, if it has any, else those of the split. Raises ValueError if they are of another."""
        own: TaskSet | None = getattr(self.sampler, "tasks", None)
        if own is not None and own.provenance.split != (split := split or self.split):
            raise ValueError(f"the sampler has its own tasks, of split {own.provenance.split!r}, not {split!r}")
        return own or super().tasks(split)
