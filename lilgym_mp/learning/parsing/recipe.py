"""How the parser learns, in numbers. No torch here, so that commands can tell of it quickly."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

HEADS = 4  # of attention; they divide the width


def _setting(default: Any, description: str) -> Any:
    return field(default=default, metadata={"description": description})


@dataclass(frozen=True)
class ParserRecipe:
    """Every number that the parser's training depends on beside its corpus."""

    seed: int = _setting(0, "of the network, the pairs and their order")
    steps: int = _setting(6_000, "batches learnt from")
    batch_size: int = _setting(32, "pairs in a batch")
    learning_rate: float = _setting(2e-3, "of AdamW, after warming up; it falls to 0 as a cosine does")
    warm_up: int = _setting(100, "steps over which the learning rate rises from 0")
    weight_decay: float = _setting(0.01, "of AdamW")
    dropout: float = _setting(0.2, "in every layer")
    smoothing: float = _setting(0.05, "of labels")
    unknown: float = _setting(0.03, "share of the words that are replaced by the unknown word")
    generated: float = _setting(0.8, "share of the pairs that the generator makes at first; it falls to an eighth")
    generated_pairs: int = _setting(40_000, "different generated pairs, at most")
    shapes: float = _setting(0.5, "share of the pairs whose shapes are exchanged for others")
    numbers: float = _setting(0.5, "share of the pairs whose numbers are exchanged for others")
    held_out: int = _setting(300, "training statements that are not learnt from but calibrate probabilities")
    width: int = _setting(96, "features of a word or token in the network")

    def __post_init__(self) -> None:
        """Raises ValueError naming the setting, its value and what it may be."""
        for name in ("steps", "batch_size", "warm_up", "generated_pairs", "width"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name.replace('_', '-')} must be at least 1, not {getattr(self, name)}")
        for name in ("dropout", "smoothing", "unknown", "generated", "shapes", "numbers"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must be from 0 to 1, not {getattr(self, name)}")
        if self.seed < 0 or self.held_out < 0 or self.learning_rate <= 0:
            raise ValueError("seed and held-out must be at least 0, and learning-rate above 0")
        if self.width % HEADS:
            raise ValueError(f"width must be a multiple of {HEADS}, not {self.width}")


RECIPE_DESCRIPTIONS = {setting.name: setting.metadata["description"] for setting in fields(ParserRecipe)}
