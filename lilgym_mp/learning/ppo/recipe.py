"""Hyperparameters of PPO, and the named recipes with the source of each value. Imports no torch.

[P] Wu et al. 2023, section 6 and appendix C. [B] the authors' released baselines: their README's commands, else the
code's defaults. [ours] this package's choice, often because neither specifies it. docs/training.md compares them.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from lilgym_mp.evaluation.options import flag_name
from lilgym_mp.evaluation.settings import CONFIGURATIONS
from lilgym_mp.learning.recipes import Recipe, setting
from lilgym_mp.scene.choices import choose

MODELS = {
    "ours": "a transformer over boxes and words, nothing pretrained",
    "ours-separators": "the same, with actions on Scatter's separators too, which are never legal",
    "c3-bert": "three convolutions and a frozen BERT",
    "c10-bert": "ten convolutions and a frozen BERT",
    "vilt": "ViLT, fine-tuned",
    "flava": "FLAVA, fine-tuned",
}
TRANSFORMERS = ("c3-bert", "c10-bert", "vilt", "flava")  # models that need a directory of pretrained weights
FINE_TUNED = ("vilt", "flava")
DEFAULT_MODEL = "ours"
DEFAULT_RECIPE = "ours"
REPORTED_PARAMETERS = {  # parameter counts of the paper or the release
    "c3-bert": "the release's: 2.59 million trained",
    "vilt": "the paper's: 87.4 million",
    "flava": "the paper's: 350 million",
}


@dataclass(frozen=True, slots=True)
class UpdateRecipe(Recipe):
    """Hyperparameters of tasks, rollouts and updates, also used by other learners; the defaults are those of `ours`."""

    seed: int = setting(0, "seed of the tasks, the network and the sampled actions", 0, 2**32 - 1)
    permute_boxes: bool = setting(False, "augment start scenes by permuting their boxes (FlipIt)")
    recolour: bool = setting(True, "augment tasks by permuting colours in words and scenes alike")
    exchange_shapes: bool = setting(
        False, "also augment by permuting shapes and mirroring, which doubles the tasks (Scatter)"
    )
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
    optimiser: str = setting("adam", "optimiser", choices=("adam", "adamw"))
    epsilon: float = setting(1e-5, "epsilon of the optimiser", 0, 1)
    beta2: float = setting(0.999, "beta2 of the optimiser", 0, 1)
    weight_decay: float = setting(0.0, "weight decay of adamw")
    learning_rate: float = setting(1e-3, "peak learning rate", 0, 1)
    schedule: str = setting(
        "linear",
        "decay of the learning rate to 0 at the last step, or constant",
        choices=("constant", "linear", "cosine"),
    )
    warmup: float = setting(0.0, "fraction of the steps for linear warm-up", 0, 1)
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


@dataclass(frozen=True, slots=True)
class PPORecipe(UpdateRecipe):
    """Hyperparameters, except the environment and the number of steps."""

    model: str = setting(DEFAULT_MODEL, "the network", choices=MODELS)
    critic: str = setting(
        "shared",
        "value network: separate, or shared with the policy as the model defines",
        choices=("separate", "shared"),
    )
    stop_forcing: bool = setting(False, "while training, force STOP wherever it succeeds (PPO+SF)")
    mask: bool = setting(False, "mask illegal actions in training and in play")
    nlvr_reward: bool = setting(False, "reward STOP only in scenes of the corpus (Scratch; the paper's ablation)")
    validate_every: int = setting(100_000, "steps between validations", 1)
    patience: int = setting(0, "stop after this many validations without improvement; 0: never")
    sampled: bool = setting(True, "sample actions in validation instead of greedy play")
    reduced_precision: bool = setting(True, "compute in bfloat16 on CUDA, and pretrained models on CPUs with AMX")

    def __post_init__(self) -> None:
        """Raises ValueError naming the setting, its value and its bounds or choices."""
        UpdateRecipe.__post_init__(self)
        if self.nlvr_reward and self.recolour:
            raise ValueError(
                "nlvr-reward and recolour exclude each other: the corpus has no recoloured scenes; add --no-recolour"
            )


def _paper(configuration: str, model: str) -> dict[str, Any]:
    appearance, start = CONFIGURATIONS[configuration]
    fine_tuned = model in FINE_TUNED
    return {
        "critic": "separate",  # [P]
        "mask": False,  # [P]
        "permute_boxes": False,  # [P] the start scenes are those of the corpus
        "recolour": False,  # [P]
        "exchange_shapes": False,  # [P]
        "empty_starts": 0.0,  # [P] a model for each configuration
        "held_out": 0.05,  # [P] a part of train; the fraction is ours
        "validate_every": 40_960,  # [ours]
        "patience": 20,  # [P] uses patience; the number is ours
        "sampled": True,  # [P]
        "envs": 1,  # [B]
        "same_statement": 1,  # [P] each episode samples a task
        "rollout": 2048,  # [P]
        "batch_size": 64,  # [P]
        "epochs": 10,  # [B]
        "optimiser": "adamw" if fine_tuned else "adam",  # [P]
        "epsilon": 1e-8 if fine_tuned else 1e-5,  # [B]
        "beta2": 0.98 if fine_tuned else 0.999,  # [B]
        "weight_decay": 0.01 if fine_tuned else 0.0,  # [ours] the default of AdamW
        "learning_rate": 3e-5 if fine_tuned or start == "flipit" else 3e-4,  # [P]
        "schedule": "cosine" if fine_tuned else "constant",  # [P] cosine; unspecified for the others
        "warmup": 0.01 if fine_tuned else 0.0,  # [P]
        "entropy": 0.1 if appearance == "tower" else 0.3,  # [P]
        "final_entropy": 0.1 if appearance == "tower" else 0.3,  # [P]
        "gamma": 0.99,  # [B]
        "gae_lambda": 0.95,  # [B]
        "advantages": "normalised",  # [B]
        "forced_baseline": True,  # [B]
        "clip": 0.2,  # [B]
        "ratio_cap": 10.0,  # [P] uses a cap M; its value is ours
        "cap_every_ratio": True,  # [P] min(r, M) replaces r everywhere
        "value": 0.5,  # [B]
        "clip_value": True,  # [B]
        "gradient_norm": 0.5,  # [B]
    }


def _release(configuration: str, model: str) -> dict[str, Any]:
    fine_tuned = model in FINE_TUNED
    return {
        **_paper(configuration, model),
        "critic": "separate" if fine_tuned else "shared",  # [B] C3 shares the image layers and the target embedding
        "held_out": 0.0,  # [B]
        "patience": 0,  # [B]
        "sampled": False,  # [B] greedy at test
        "learning_rate": 3e-5 if fine_tuned else 3e-4,  # [B]
        "schedule": "cosine" if fine_tuned else "linear",  # [B]
        "warmup": 0.01 if fine_tuned else 0.0,  # [B]
        "entropy": 0.0,  # [B] its README says .1, but there the bonus has no gradient
        "final_entropy": 0.0,  # [B]
        "ratio_cap": 5.184705528587072e21,  # [B] exp(50)
    }


def _ours(configuration: str, model: str) -> dict[str, Any]:
    start = CONFIGURATIONS[configuration][1]
    fine_tuned = model in FINE_TUNED
    return {
        "empty_starts": 0.25 if start == "flipit" else 0.0,
        "learning_rate": 3e-5 if fine_tuned else 3e-4 if model in TRANSFORMERS else 1e-3,
        "optimiser": "adamw" if fine_tuned else "adam",
    }


RECIPES: Mapping[str, Callable[[str, str], dict[str, Any]]] = {"ours": _ours, "paper": _paper, "release": _release}


def make_recipe(name: str, configuration: str, **changes: Any) -> PPORecipe:
    """The recipe called `name`, or from the TOML file `name`, for a configuration, with some settings changed.

    Raises ValueError naming the choices, the file, or a setting and its bounds.
    """
    PPORecipe.check_known(changes)
    choose("configuration", configuration, CONFIGURATIONS)
    model = changes.get("model", DEFAULT_MODEL)
    if name not in RECIPES and Path(name).suffix == ".toml":
        from_file = _of_file(Path(name))
        model = changes.get("model", from_file.get("model", model))
        return PPORecipe(**{**_ours(configuration, model), **from_file, **changes})
    settings = choose("recipe", name, RECIPES)(configuration, model)
    return PPORecipe(**{**settings, **changes})


def _of_file(path: Path) -> dict[str, Any]:
    try:
        settings = tomllib.loads(path.read_text(encoding="utf-8-sig"))
        PPORecipe.check_known(settings)
        for each in fields(PPORecipe):
            kind = type(each.default)
            if each.name in settings and type(settings[each.name]) not in ({kind, int} if kind is float else {kind}):
                raise ValueError(f"{each.name} must be of type {kind.__name__}, not {settings[each.name]!r}")
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from None
    return settings
