"""Everything that can be set of an imitation run but the environment and the budget."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

_MANY = float("inf")


def _setting(default: Any, description: str, lowest: float = 0, highest: float = _MANY) -> Any:
    return field(default=default, metadata={"description": description, "bounds": (lowest, highest)})


@dataclass(frozen=True, slots=True)
class ImitationRecipe:
    """Imitation of sets of optimal first actions; docs/imitation.md says what each part is worth."""

    width: int = _setting(128, "of the network's vectors; a multiple of 8", 8)
    text_layers: int = _setting(2, "layers that read the statement", 0)
    item_layers: int = _setting(2, "layers that read items in the light of the statement", 1)
    dropout: float = _setting(0.1, "of the network", 0, 0.9)
    statements: int = _setting(24, "in a batch", 1)
    solved: int = _setting(8, "scenes with optimal actions of each statement in a batch", 1)
    judged: int = _setting(8, "further scenes of each, as many true as false where there are both", 2)
    learning_rate: float = _setting(1.5e-3, "of AdamW, at its highest", 0, 1)
    warmup: float = _setting(
        0.03, "share of the budget in which the learning rate rises; then it falls as a cosine", 0, 1
    )
    weight_decay: float = _setting(0.02, "of AdamW")
    gradient_norm: float = _setting(1.0, "longest gradient, longer ones are scaled down")
    truth: float = _setting(3.0, "coefficient of the loss on the statement's truth, hence on STOP")
    steps: float = _setting(0.1, "coefficient of the loss on the number of steps to go")
    legal: float = _setting(1.0, "coefficient of the loss on which edits are valid (Scatter)")
    single_action: bool = _setting(False, "imitate one of the optimal actions instead of the set, for comparison")
    recolour: bool = _setting(True, "exchange colours at random in words and scenes where both name the same ones")
    unknown_words: float = _setting(0.02, "share of words made unknown while learning", 0, 1)
    exploring: float = _setting(
        0.15, "share of the processor time spent on finding scenes and asking the expert", 0, 0.95
    )
    own_states: float = _setting(
        0.5, "share of exploring that plays the network itself, once it has learnt a little", 0, 1
    )
    empty_starts: float = _setting(
        0.25, "share of walks from the empty scene in a FlipIt run; above 0 the agent plays Scratch as well", 0, 1
    )
    first_scenes: int = _setting(3, "scenes with optimal actions of each statement before learning begins", 1)
    pretraining: float = _setting(
        0.1, "share of the run, its first, in which the text layers learn to write the statements' programs", 0, 0.9
    )
    budget: int = _setting(20_000, "scenes that the expert looks at for one set, at most", 1)
    held_out: float = _setting(0.05, "share of the training statements kept apart to choose when to stop by", 0, 0.5)
    derived: float = _setting(
        0.0, "share of a batch's statements made of training ones: other shapes, numbers and sides", 0, 0.9
    )
    generated: float = _setting(0.0, "share of a batch's statements that are generated, not of the corpus", 0, 0.9)
    pool: int = _setting(1000, "derived statements kept at a time, and generated ones likewise", 1)
    mixed_share: float = _setting(0.3, "share of other tasks' statements in a batch, where other tasks are given", 0, 1)
    reduced_precision: bool = _setting(True, "calculate in bfloat16 where that is known to do")

    def __post_init__(self) -> None:
        """Raises ValueError naming the setting, its value and what it may be."""
        for setting in fields(self):
            lowest, highest = setting.metadata["bounds"]
            value = getattr(self, setting.name)
            if not lowest <= value <= highest:
                upper = "" if highest == _MANY else f" and at most {highest:g}"
                name = setting.name.replace("_", "-")
                raise ValueError(f"{name} must be at least {lowest:g}{upper}, not {value}")
        if self.width % 8:
            raise ValueError(f"width must be a multiple of 8, not {self.width}")

    def to_json(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> ImitationRecipe:
        """What `to_json` gave. Raises ValueError, TypeError for unknown keys."""
        return cls(**data)


def default_recipe(appearance: str, **changes: Any) -> ImitationRecipe:
    """The recipe for "tower" or "scatter", with some settings changed."""
    return ImitationRecipe(**{**_BY_APPEARANCE[appearance], **changes})


_BY_APPEARANCE: Mapping[str, Mapping[str, Any]] = {
    "tower": {"solved": 16, "judged": 32},
    "scatter": {"exploring": 0.2, "own_states": 0.4, "first_scenes": 2},
}
