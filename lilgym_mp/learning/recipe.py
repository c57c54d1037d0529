"""How an agent learns: every number that a training run depends on beside its environment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any


def _setting(default: Any, description: str) -> Any:
    return field(default=default, metadata={"description": description})


@dataclass(frozen=True, slots=True)
class Recipe:
    """Proximal policy optimisation with masks; docs/training.md sets the paper's values beside these."""

    seed: int = _setting(0, "of the environments, the network and the actions drawn")
    envs: int = _setting(16, "environments played side by side")
    stop_forcing: bool = _setting(False, "while training, STOP wherever it succeeds (PPO+SF)")
    nlvr_reward: bool = _setting(False, "reward STOP in scenes of the corpus alone (Scratch), as the paper's ablation")
    recolour: bool = _setting(False, "train on every exchange of the three colours in the training tasks too")
    rollout: int = _setting(2048, "actions of all environments together between two updates")
    batch_size: int = _setting(256, "actions in a step of the optimiser")
    epochs: int = _setting(4, "times each action is learnt from")
    learning_rate: float = _setting(2e-3, "of Adam, at the start")
    anneal: bool = _setting(True, "let the learning rate fall linearly to nothing by the last step")
    gamma: float = _setting(0.99, "discount a step")
    gae_lambda: float = _setting(0.95, "of generalised advantage estimation")
    clip: float = _setting(0.2, "how far the probability ratio may leave 1")
    entropy: float = _setting(0.1, "coefficient of the policy's entropy")
    value: float = _setting(0.5, "coefficient of the value loss")
    gradient_norm: float = _setting(0.5, "longest gradient, longer ones are scaled down")

    def __post_init__(self) -> None:
        """Raises ValueError naming the setting, its value and what it may be."""
        for name, (lowest, highest) in BOUNDS.items():
            value = getattr(self, name)
            if not lowest <= value <= highest:
                upper = "" if highest == float("inf") else f" and at most {highest:g}"
                raise ValueError(f"{option(name)} must be at least {lowest:g}{upper}, not {value}")
        if self.rollout % self.envs:
            raise ValueError(f"rollout must be a multiple of envs: {self.rollout} is none of {self.envs}")
        if self.nlvr_reward and self.recolour:
            raise ValueError("nlvr-reward and recolour exclude each other: the corpus has no recoloured scenes")
        if self.batch_size > self.rollout:
            raise ValueError(f"batch-size must be at most rollout, {self.rollout}, not {self.batch_size}")

    def to_json(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Recipe:
        """What `to_json` gave. Raises ValueError, TypeError for unknown keys."""
        return cls(**data)


_MANY = float("inf")
BOUNDS: Mapping[str, tuple[float, float]] = {
    "seed": (0, 2**32 - 1),
    "envs": (1, _MANY),
    "rollout": (2, _MANY),
    "batch_size": (2, _MANY),
    "epochs": (1, _MANY),
    "learning_rate": (0, 1),
    "gamma": (0, 1),
    "gae_lambda": (0, 1),
    "clip": (0, _MANY),
    "entropy": (0, _MANY),
    "value": (0, _MANY),
    "gradient_norm": (0, _MANY),
}

DESCRIPTIONS: Mapping[str, str] = {setting.name: setting.metadata["description"] for setting in fields(Recipe)}


def option(name: str) -> str:
    """A setting's name on the command line, without the dashes before it."""
    return name.replace("_", "-")
