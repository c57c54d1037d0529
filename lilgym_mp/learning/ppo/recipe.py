"""How PPO learns: every number of a run, and the named recipes with the source of each value.

[P] Wu et al. 2023, section 6 and appendix C. [B] the authors' released baselines: their README's commands, else the
code's defaults. [ours] neither says it, or this package's own choice. docs/training.md has the recipes side by side.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from lilgym_mp.choices import choose
from lilgym_mp.evaluation.settings import CONFIGURATIONS

MODELS = {
    "ours": "a transformer over boxes and words, nothing pretrained",
    "c3-bert": "three convolutions, and a BERT that stays as it is",
    "c10-bert": "ten convolutions, and a BERT that stays as it is",
    "vilt": "ViLT, trained throughout",
    "flava": "FLAVA, trained throughout",
    "imitation": "the network of an imitation run, which knew programs, trained on by rewards",
}
IMITATION = "imitation"  # needs the directory of a run
TRANSFORMERS = ("c3-bert", "c10-bert", "vilt", "flava")  # these need a directory of weights
TRAINED_THROUGHOUT = ("vilt", "flava")
DEFAULT_MODEL = "ours"
DEFAULT_RECIPE = "ours"
REPORTED_PARAMETERS = {  # as the paper or the release has them
    "c3-bert": "the release's: 2.59 million trained",
    "vilt": "the paper's: 87.4 million",
    "flava": "the paper's: 350 million",
}
CHOICES: Mapping[str, tuple[str, ...]] = {
    "model": tuple(MODELS),
    "critic": ("separate", "shared"),
    "optimiser": ("adam", "adamw"),
    "schedule": ("constant", "linear", "cosine"),
    "advantages": ("normalised", "scaled"),
}


def _setting(default: Any, description: str, lowest: float = 0, highest: float = float("inf")) -> Any:
    return field(default=default, metadata={"description": description, "bounds": (lowest, highest)})


@dataclass(frozen=True, slots=True)
class PPORecipe:
    """Every setting of a run but the environment and the number of steps; the defaults are those of `ours`."""

    seed: int = _setting(0, "of the tasks, the network and the actions drawn", 0, 2**32 - 1)
    model: str = _setting(DEFAULT_MODEL, "the network")
    critic: str = _setting("shared", "network of the value: separate, or shared with the policy as the model has it")
    stop_forcing: bool = _setting(False, "while training, STOP wherever it succeeds (PPO+SF)")
    mask: bool = _setting(False, "show the policy which actions are legal, in training and in play")
    nlvr_reward: bool = _setting(False, "reward STOP in scenes of the corpus alone (Scratch), as the paper's ablation")
    permute_boxes: bool = _setting(False, "begin with the boxes in any order (FlipIt)")
    recolour: bool = _setting(True, "exchange colours at random, in words and scenes alike")
    exchange_shapes: bool = _setting(
        False, "exchange shapes, and left and right, at random as well, for as many tasks more (Scatter)"
    )
    empty_starts: float = _setting(
        0.25, "share of episodes from the empty scene in a FlipIt run; above 0 the agent plays Scratch as well", 0, 0.9
    )
    held_out: float = _setting(0.04, "share of the training statements kept apart for validation", 0, 0.5)
    validate_every: int = _setting(100_000, "steps between validations", 1)
    patience: int = _setting(0, "validations without a better one after which training ends; 0: never")
    sampled: bool = _setting(True, "validate with actions drawn instead of the likeliest")
    envs: int = _setting(512, "environments side by side", 1)
    same_statement: int = _setting(16, "environments that play the same statement at a time", 1)
    rollout: int = _setting(4096, "actions of all environments together between two updates", 1)
    batch_size: int = _setting(1024, "actions in a step of the optimiser", 1)
    microbatch: int = _setting(0, "actions whose gradient is calculated at once; 0: all of the batch")
    epochs: int = _setting(2, "times each action is learnt from", 1)
    optimiser: str = _setting("adam", "adam or adamw")
    epsilon: float = _setting(1e-5, "of the optimiser", 0, 1)
    beta2: float = _setting(0.999, "of the optimiser: memory of squared gradients", 0, 1)
    weight_decay: float = _setting(0.0, "of adamw")
    learning_rate: float = _setting(1e-3, "at its highest", 0, 1)
    schedule: str = _setting("linear", "how the learning rate falls to nothing by the last step, or constant")
    warmup: float = _setting(0.0, "share of the steps in which the learning rate rises", 0, 1)
    entropy: float = _setting(0.08, "coefficient of the policy's entropy, at the beginning")
    final_entropy: float = _setting(0.01, "the same at the end; it falls linearly")
    gamma: float = _setting(0.99, "discount a step", 0, 1)
    gae_lambda: float = _setting(0.95, "of generalised advantage estimation", 0, 1)
    advantages: str = _setting("scaled", "normalised: mean 0 and deviation 1 in a rollout; scaled: not centred")
    forced_baseline: bool = _setting(
        False, "judge a forced STOP against the value, which comes to expect its reward; else by the reward alone"
    )
    clip: float = _setting(0.2, "how far the probability ratio may leave 1")
    ratio_cap: float = _setting(10.0, "M: highest probability ratio of a forced STOP", 1)
    cap_every_ratio: bool = _setting(False, "cap the ratio of actions that were not forced, too")
    value: float = _setting(0.5, "coefficient of half the squared error of the value")
    clip_value: bool = _setting(False, "clip the change of the value as the ratio's")
    gradient_norm: float = _setting(0.5, "longest gradient, longer ones are scaled down")
    reduced_precision: bool = _setting(True, "calculate in bfloat16 on CUDA")

    def __post_init__(self) -> None:
        """Raises ValueError naming the setting, its value and what it may be."""
        for setting in fields(self):
            value, name = getattr(self, setting.name), option(setting.name)
            if setting.name in CHOICES:
                choose(name, value, {choice: choice for choice in CHOICES[setting.name]})
                continue
            lowest, highest = setting.metadata["bounds"]
            if not lowest <= value <= highest:
                upper = "" if highest == float("inf") else f" and at most {highest:g}"
                raise ValueError(f"{name} must be at least {lowest:g}{upper}, not {value}")
        for whole, part in (("rollout", "envs"), ("envs", "same_statement")):
            if getattr(self, whole) % getattr(self, part):
                raise ValueError(
                    f"{option(whole)} must be a multiple of {option(part)}:"
                    f" {getattr(self, whole)} is none of {getattr(self, part)}"
                )
        if self.batch_size > self.rollout:
            raise ValueError(f"batch-size must be at most rollout, {self.rollout}, not {self.batch_size}")
        if self.nlvr_reward and self.recolour:
            raise ValueError(
                "nlvr-reward and recolour exclude each other: the corpus has no recoloured scenes; say --no-recolour"
            )

    def to_json(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> PPORecipe:
        """What `to_json` gave. Raises ValueError naming an unknown setting, TypeError."""
        check_known(data)
        return cls(**data)


DESCRIPTIONS: Mapping[str, str] = {setting.name: setting.metadata["description"] for setting in fields(PPORecipe)}


def option(name: str) -> str:
    """A setting's name on the command line, without the dashes before it."""
    return name.replace("_", "-")


def check_known(data: Mapping[str, Any]) -> None:
    """Raises ValueError naming a setting that no recipe has, and all that there are."""
    for name in data:
        if name not in DESCRIPTIONS:
            raise ValueError(f"unknown setting {name!r} of a recipe; choose from {', '.join(DESCRIPTIONS)}")


def _paper(configuration: str, model: str) -> dict[str, Any]:
    appearance, start = CONFIGURATIONS[configuration]
    through = model in TRAINED_THROUGHOUT
    return {
        "critic": "separate",  # [P]
        "mask": False,  # [P]
        "permute_boxes": False,  # [P] the start scenes are those of the corpus
        "recolour": False,  # [P]
        "exchange_shapes": False,  # [P]
        "empty_starts": 0.0,  # [P] a model for each configuration
        "held_out": 0.05,  # [P] a part of train; how much is ours
        "validate_every": 40_960,  # [ours]
        "patience": 20,  # [P] there is patience; how much is ours
        "sampled": True,  # [P]
        "envs": 1,  # [B]
        "same_statement": 1,  # [P] each episode draws a task
        "rollout": 2048,  # [P]
        "batch_size": 64,  # [P]
        "epochs": 10,  # [B]
        "optimiser": "adamw" if through else "adam",  # [P]
        "epsilon": 1e-8 if through else 1e-5,  # [B]
        "beta2": 0.98 if through else 0.999,  # [B]
        "weight_decay": 0.01 if through else 0.0,  # [ours] the default of AdamW
        "learning_rate": 3e-5 if through or start == "flipit" else 3e-4,  # [P]
        "schedule": "cosine" if through else "constant",  # [P] cosine; not said for the others
        "warmup": 0.01 if through else 0.0,  # [P]
        "entropy": 0.1 if appearance == "tower" else 0.3,  # [P]
        "final_entropy": 0.1 if appearance == "tower" else 0.3,  # [P]
        "gamma": 0.99,  # [B]
        "gae_lambda": 0.95,  # [B]
        "advantages": "normalised",  # [B]
        "forced_baseline": True,  # [B]
        "clip": 0.2,  # [B]
        "ratio_cap": 10.0,  # [P] there is a cap M; its value is ours
        "cap_every_ratio": False,  # [P] in PPO+SF
        "value": 0.5,  # [B]
        "clip_value": True,  # [B]
        "gradient_norm": 0.5,  # [B]
    }


def _release(configuration: str, model: str) -> dict[str, Any]:
    through = model in TRAINED_THROUGHOUT
    return {
        **_paper(configuration, model),
        "critic": "separate" if through else "shared",  # [B] C3 shares the image's layers and the target's embedding
        "held_out": 0.0,  # [B]
        "patience": 0,  # [B]
        "sampled": False,  # [B] the likeliest action is taken at test
        "learning_rate": 3e-5 if through else 3e-4,  # [B]
        "schedule": "cosine" if through else "linear",  # [B]
        "warmup": 0.01 if through else 0.0,  # [B]
        "entropy": 0.0,  # [B] its README says .1, but there the bonus has no gradient: it does nothing
        "final_entropy": 0.0,  # [B]
        "ratio_cap": 5.184705528587072e21,  # [B] exp(50)
        "cap_every_ratio": True,  # [B] in plain PPO too
    }


def _ours(configuration: str, model: str) -> dict[str, Any]:
    start = CONFIGURATIONS[configuration][1]
    through = model in TRAINED_THROUGHOUT
    begun = {  # a policy that knows much already
        "learning_rate": 1e-4,
        "entropy": 0.01,
        "final_entropy": 0.003,
    }
    return {
        "empty_starts": 0.25 if start == "flipit" else 0.0,
        "learning_rate": 1e-3 if model == "ours" else 3e-5 if through else 3e-4,
        "optimiser": "adamw" if through else "adam",
        **(begun if model == IMITATION else {}),
    }


RECIPES: Mapping[str, Callable[[str, str], dict[str, Any]]] = {"ours": _ours, "paper": _paper, "release": _release}


def make_recipe(name: str, configuration: str, **changes: Any) -> PPORecipe:
    """The recipe called `name`, or of a TOML file, for a configuration, with some settings changed.

    Raises ValueError naming the choices, the file, or a setting and what it may be.
    """
    check_known(changes)
    choose("configuration", configuration, CONFIGURATIONS)
    model = changes.get("model", DEFAULT_MODEL)
    if name not in RECIPES and Path(name).suffix == ".toml":
        told = _of_file(Path(name))
        model = changes.get("model", told.get("model", model))
        return PPORecipe(**{**_ours(configuration, model), **told, **changes})
    settings = choose("recipe", name, RECIPES)(configuration, model)
    return PPORecipe(**{**settings, **changes})


def _of_file(path: Path) -> dict[str, Any]:
    try:
        told = tomllib.loads(path.read_text(encoding="utf-8"))
        check_known(told)
        for setting in fields(PPORecipe):
            kind = type(setting.default)
            if setting.name in told and type(told[setting.name]) not in ({kind, int} if kind is float else {kind}):
                raise ValueError(f"{setting.name} must be of type {kind.__name__}, not {told[setting.name]!r}")
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from None
    return told
