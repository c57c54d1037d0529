"""A policy's action probabilities, value and plan at each step, compact enough to be recorded with the episodes.

docs/report.md describes every key.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from math import prod
from typing import Any, Self

import numpy as np

from lilgym_mp.evaluation.policies import PolicyOutput
from lilgym_mp.scene.actions import Action, ActionType, describe, named
from lilgym_mp.scene.appearances import Appearance
from lilgym_mp.scene.appearances.base import action_arrays
from lilgym_mp.scene.appearances.places import places_of
from lilgym_mp.scene.arrays import AnyDict, BoolArray, Float64Array, Int64Array, Strings

MAX_LIKELIEST = 5  # actions and programs recorded per step
MIN_PROBABILITY = 0.0005  # cells with lower probabilities are not recorded
DIGITS = 4

Cells = Mapping[int, float]  # probability by cell


@dataclass(frozen=True)
class Decision:
    """A policy's outputs at one step, before its action."""

    types: tuple[float, float, float]  # probabilities of STOP, ADD, REMOVE
    add_cells: Cells  # probability of an ADD by cell, if at least MIN_PROBABILITY; indices as in `action_cells`
    remove_cells: Cells
    likeliest: tuple[tuple[Action, float], ...]  # the most probable actions, in descending order
    legal: tuple[int, int, int]  # number of legal actions by type
    legal_probability: float  # total probability of legal actions
    value: float | None = None  # the critic's value estimate
    success_probability: float | None = None  # the planner's estimate for its plan
    programs: Mapping[str, float] = field(default_factory=dict)  # the most probable programs planned for
    optimal: bool | None = None  # whether the action taken begins a shortest solution; None if not judged or unknown
    steps_to_go: int | None = None  # length of a shortest solution, including STOP; None as above
    notes: Strings = ()  # lines about the statement, such as its unknown words

    def to_json(self) -> AnyDict:
        """All values in types of JSON; cells as pairs, actions as texts."""
        values = dict(vars(self))
        for name in ("add_cells", "remove_cells"):
            values[name] = [[cell, probability] for cell, probability in values[name].items()]
        return {**values, "likeliest": [[describe(action), probability] for action, probability in self.likeliest]}

    @classmethod
    def from_json(cls, data: Any) -> Self:
        """Inverse of `to_json`. Raises ValueError, TypeError or KeyError for invalid data."""
        values = dict(data)
        for name in ("add_cells", "remove_cells"):
            values[name] = {int(cell): _probability(name, value) for cell, value in values[name]}
        likeliest = values["likeliest"]
        values["likeliest"] = tuple((named(name), _probability("likeliest", value)) for name, value in likeliest)
        values["types"] = tuple(_probability("types", value) for value in values["types"])
        values["legal"] = tuple(map(int, values["legal"]))
        _probability("legal_probability", values["legal_probability"])
        for program, value in dict(values["programs"]).items():
            _probability(f"programs: {program:.40}", value)
        values["notes"] = tuple(map(str, values.get("notes", ())))
        if len(values["types"]) != len(ActionType) or len(values["legal"]) != len(ActionType):
            raise ValueError(f"types and legal must be {len(ActionType)} numbers each")
        return cls(**values)


def _probability(name: str, value: Any) -> float:
    """`value` as a float. Raises ValueError naming the field unless it is a probability."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= 1:
        raise ValueError(f"{name} must be probabilities from 0 to 1, not {value!r:.80}")
    return float(value)


@lru_cache(maxsize=4)
def action_cells(appearance: Appearance) -> tuple[Int64Array, Int64Array, int]:
    """(actions,) the type and the cell, 0 for STOP, of each action, and the number of cells.

    Tower's cells are its boxes; Scatter's have the index column x rows + row.
    """
    counts = places_of(appearance.grid).counts
    types, *fields = action_arrays(appearance).T[: 1 + len(counts)].clip(0)
    return types, np.asarray(np.ravel_multi_index(tuple(fields), counts), np.int64), prod(counts)


def decisions(output: PolicyOutput, legal: BoolArray, appearance: Appearance) -> list[Decision]:
    """The decisions in B states; `legal`: (B, actions) exact masks, even if the policy did not see them.

    Raises ValueError if the shapes differ.
    """
    if output.probabilities.shape != legal.shape:
        raise ValueError(f"the policy returned probabilities of shape {output.probabilities.shape}, not {legal.shape}")
    return [_decision(output, row, legal[row], appearance) for row in range(len(legal))]


def _decision(output: PolicyOutput, row: int, legal: BoolArray, appearance: Appearance) -> Decision:
    probabilities = np.asarray(output.probabilities[row], np.float64)
    action_types, cells, count = action_cells(appearance)
    stop, add, remove = map(_rounded, np.bincount(action_types, probabilities, len(ActionType)).tolist())
    adds, removes = (
        np.bincount(cells, np.where(action_types == action_type, probabilities, 0.0), count)
        for action_type in (ActionType.ADD, ActionType.REMOVE)
    )
    programs = {} if output.programs is None else output.programs[row]
    best = sorted(programs, key=lambda program: (-programs[program], program))[:MAX_LIKELIEST]
    return Decision(
        types=(stop, add, remove),
        add_cells=_kept(adds),
        remove_cells=_kept(removes),
        likeliest=_likeliest(probabilities, appearance),
        legal=tuple(np.bincount(action_types[legal], minlength=len(ActionType)).tolist()),
        legal_probability=_rounded(float(probabilities[legal].sum())),
        value=None if output.values is None else round(float(output.values[row]), DIGITS),
        success_probability=_rounded(output.success_probabilities[row]) if output.success_probabilities else None,
        programs={program: _rounded(programs[program]) for program in best},
        notes=output.notes[row] if output.notes else (),
    )


def _likeliest(probabilities: Float64Array, appearance: Appearance) -> tuple[tuple[Action, float], ...]:
    """The MAX_LIKELIEST most probable actions, without those of probability 0; ties in order of index."""
    order = np.argsort(-probabilities, kind="stable")[:MAX_LIKELIEST]
    chosen = [index for index in order.tolist() if probabilities[index] > 0]
    return tuple((appearance.decode(index), _rounded(float(probabilities[index]))) for index in chosen)


def _kept(cells: np.ndarray) -> dict[int, float]:
    kept = np.flatnonzero(cells >= MIN_PROBABILITY)
    return dict(zip(kept.tolist(), cells[kept].clip(0, 1).round(DIGITS).tolist(), strict=True))


def _rounded(probability: float) -> float:
    """Rounded and clipped to 0 .. 1, which float32 sums may exceed."""
    return round(min(max(probability, 0.0), 1.0), DIGITS)
