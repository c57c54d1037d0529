"""Proximal policy optimisation, from rewards.

Trains an agent with proximal policy optimisation, from rewards (by default also from programs, to exchange colours;
--no-recolour for rewards alone). Ctrl-C saves a checkpoint and exits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.evaluation import CONFIGURATIONS
from lilgym_mp.evaluation.policies import GREEDY, SAMPLED
from lilgym_mp.learning.common.learners import Learner
from lilgym_mp.learning.common.recipes import RunOptions, UpdateRecipe, setting
from lilgym_mp.scene.appearances import make_appearance
from lilgym_mp.scene.arrays import AnyDict
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
_WEIGHTS = "directory of pretrained weights: config.json, model.safetensors and tokenizer"
_EVALUATIONS = "steps between evaluations on dev, for learning curves (default: no evaluations)"


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
    sampled: bool = setting(True, "sample actions in validation instead of greedy play", flag="sampled_validation")
    reduced_precision: bool = setting(True, "compute in bfloat16 on CUDA, and pretrained models on CPUs with AVX-512")

    def __post_init__(self) -> None:
        """Raises ValueError naming the setting, its value and its bounds or choices."""
        UpdateRecipe.__post_init__(self)
        if self.nlvr_reward and self.recolour:
            raise ValueError(
                "nlvr-reward and recolour exclude each other: the corpus has no recoloured scenes; add --no-recolour"
            )

    @classmethod
    def of(cls, configuration: str, named: str | None = None, **changes: Any) -> PPORecipe:
        """`named`: one of RECIPES, by default `ours`."""
        cls.check_known(changes)
        choose("configuration", configuration, CONFIGURATIONS)
        settings = choose("recipe", named or DEFAULT_RECIPE, RECIPES)
        return cls(**{**settings(configuration, changes.get("model", DEFAULT_MODEL)), **changes})


# The named recipes, with the source of each value. [P] Wu et al. 2023, section 6 and appendix C. [B] the authors'
# released baselines: their README's commands, else the code's defaults. [ours] this package's choice, often because
# neither specifies it. docs/training.md compares them.


PAPER_ENTROPY = {"tower": 0.1}  # of Tower alone; 0.3 for other appearances


def _paper(configuration: str, model: str) -> AnyDict:
    appearance, start = CONFIGURATIONS[configuration]
    fine_tuned = model in FINE_TUNED
    entropy = PAPER_ENTROPY.get(appearance, 0.3)
    return {
        "critic": "separate",  # [P]
        "mask": False,  # [P]
        "recolour": False,  # [P]
        "empty_starts": 0.0,  # [P] a model for each configuration
        "held_out": 0.05,  # [P] a part of train; the fraction is ours
        "validate_every": 40_960,  # [ours]
        "patience": 40,  # [P] uses patience; the number is ours
        "sampled": True,  # [P]
        "envs": 1,  # [B]
        "same_statement": 1,  # [P] each episode samples a task
        "rollout": 2048,  # [P]
        "batch_size": 64,  # [P]
        "epochs": 4,  # [B] the code's default; its README has 10
        "optimiser": "adamw" if fine_tuned else "adam",  # [P]
        "learning_rate": 3e-5 if fine_tuned or start == "flipit" else 3e-4,  # [P]
        "schedule": "cosine" if fine_tuned else "linear",  # [P] cosine; unspecified for the others: [B]
        "warmup": 0.01 if fine_tuned else 0.0,  # [P]
        "entropy": entropy,  # [P]
        "final_entropy": entropy / 10,  # [ours] a constant bonus leaves the policy random
        "gamma": 0.99,  # [B]
        "gae_lambda": 0.95,  # [B]
        "advantages": "normalised",  # [B]
        "forced_baseline": False,  # [ours] with it a forced STOP's advantage vanishes once its success is expected
        "clip": 0.2,  # [B]
        "ratio_cap": 10.0,  # [P] uses a cap M; its value is ours
        "cap_every_ratio": True,  # [P] min(r, M) replaces r everywhere
        "value": 0.5,  # [B]
        "clip_value": True,  # [B]
        "gradient_norm": 0.5,  # [B]
    }


def _release(configuration: str, model: str) -> AnyDict:
    fine_tuned = model in FINE_TUNED
    return {
        **_paper(configuration, model),
        "critic": "separate" if fine_tuned else "shared",  # [B] C3 shares the image layers and the target embedding
        "held_out": 0.0,  # [B]
        "epochs": 10,  # [B]
        "forced_baseline": True,  # [B]
        "patience": 0,  # [B]
        "sampled": False,  # [B] greedy at test
        "learning_rate": 3e-5 if fine_tuned else 3e-4,  # [B]
        "entropy": 0.0,  # [B] its README says .1, but there the bonus has no gradient
        "final_entropy": 0.0,  # [B]
        "ratio_cap": 5.184705528587072e21,  # [B] exp(50)
    }


def _ours(configuration: str, model: str) -> AnyDict:
    start = CONFIGURATIONS[configuration][1]
    fine_tuned = model in FINE_TUNED
    return {
        "empty_starts": 0.25 if start == "flipit" else 0.0,
        "learning_rate": 3e-5 if fine_tuned else 3e-4 if model in TRANSFORMERS else 1e-3,
        "optimiser": "adamw" if fine_tuned else "adam",
    }


RECIPES: Mapping[str, Callable[[str, str], AnyDict]] = {"ours": _ours, "paper": _paper, "release": _release}


@dataclass(frozen=True, slots=True)
class PPOOptions(RunOptions):
    """The options of a PPO run besides its recipe; the defaults of the recipe's settings are those of `ours`."""

    steps: int = setting(1_000_000, "environment steps", 1)
    recipe_name: str = setting(DEFAULT_RECIPE, f"one of {', '.join(sorted(RECIPES))}", flag="recipe", metavar="NAME")
    weights: Path | None = setting(None, _WEIGHTS, kind=Path, metavar="DIR")
    evaluate_every: int | None = setting(None, _EVALUATIONS, 1, kind=int)


def _train(*arguments: Any, **options: Any) -> Any:
    from lilgym_mp.learning.ppo.training import train_ppo

    return train_ppo(*arguments, **options)


def _load_agent(path: Path, device: str) -> Any:
    from lilgym_mp.learning.ppo.agent import PPOAgent

    return PPOAgent.load(path, device)


def _check(settings: EnvConfig, recipe: PPORecipe) -> None:
    """Raises UnsupportedAppearance for an appearance whose actions the model has no heads for."""
    from lilgym_mp.learning.common.factored_policy import joint_factorisation

    if recipe.model not in TRANSFORMERS:
        joint_factorisation(make_appearance(settings.appearance, settings.grid))


LEARNER = Learner(
    PPORecipe,
    PPOOptions,
    _train,
    _load_agent,
    __doc__,
    directory="{configuration}",
    action_modes=(GREEDY, SAMPLED),  # the most probable first action may be STOP
    check=_check,
)
