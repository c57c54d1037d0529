"""What a policy went by in each step of an episode, in a form small enough to keep with the episodes.

docs/report.md describes every key.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from lilgym_mp.actions import Action, ActionType, AddBlock, AddItem, RemoveBlock, RemoveItem, describe, named
from lilgym_mp.appearances import Appearance
from lilgym_mp.arrays import BoolArray, Float64Array, Int64Array
from lilgym_mp.scene import BOX_COUNT

LONGEST_ANSWER = 4_000  # characters kept of what an agent wrote
LIKELIEST = 5  # actions kept of each step, and programs
LEAST_PROBABILITY = 0.0005  # that a cell must have to be kept
DIGITS = 4

Cells = Mapping[int, float]  # probability by cell
FloatArray = NDArray[np.floating[Any]]


class PolicyOutput(NamedTuple):
    """What a policy's latest call came to, for B states."""

    probabilities: FloatArray  # (B, actions) of being chosen; a row with a single 1 where nothing is drawn
    values: FloatArray | None = None  # (B,) return that a critic expects
    success_probabilities: Sequence[float] | None = None  # (B,) of the plan that is followed, as its planner states it
    programs: Sequence[Mapping[str, float]] | None = None  # B times: probability of each program that was planned for


class AgentAnswer(NamedTuple):
    """What an agent that reads and writes answered."""

    text: str
    understood: bool  # whether it decided for one action

    @classmethod
    def shortened(cls, text: str, *, understood: bool) -> Self:
        """Without the middle of a text that is too long to keep."""
        if len(text) > LONGEST_ANSWER:
            text = f"{text[: LONGEST_ANSWER // 2]} [...] {text[-LONGEST_ANSWER // 2 :]}"
        return cls(text, understood)


@dataclass(frozen=True)
class Decision:
    """What a policy went by in one step, before its action."""

    types: tuple[float, float, float]  # probabilities of STOP, ADD, REMOVE
    add_cells: Cells  # probability of an ADD to each cell that has LEAST_PROBABILITY; cells as in `places`
    remove_cells: Cells
    likeliest: tuple[tuple[Action, float], ...]  # the most probable actions, the first first
    legal: tuple[int, int, int]  # legal actions by type
    legal_probability: float  # of all legal actions together
    value: float | None = None  # return that the critic expects
    success_probability: float | None = None  # of the plan, as its planner states it
    programs: Mapping[str, float] = field(default_factory=dict[str, float])  # the likeliest of those planned for
    optimal: bool | None = None  # whether the action taken begins a shortest solution; None: not asked, or not known
    steps_to_go: int | None = None  # actions of a shortest solution, STOP included; None as above
    answers: tuple[AgentAnswer, ...] = ()  # of an agent that reads and writes, the one that was acted upon last

    def to_json(self) -> dict[str, Any]:
        values = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        for name in ("add_cells", "remove_cells"):
            values[name] = [[cell, probability] for cell, probability in values[name].items()]
        values["answers"] = [list(answer) for answer in self.answers]
        return {**values, "likeliest": [[describe(action), probability] for action, probability in self.likeliest]}

    @classmethod
    def from_json(cls, data: Any) -> Self:
        """What `to_json` gave. Raises ValueError, TypeError, KeyError for anything else."""
        values = dict(data)
        for name in ("add_cells", "remove_cells"):
            values[name] = {int(cell): _probability(name, found) for cell, found in values[name]}
        likeliest = values["likeliest"]
        values["likeliest"] = tuple((named(name), _probability("likeliest", found)) for name, found in likeliest)
        values["types"] = tuple(_probability("types", found) for found in values["types"])
        values["legal"] = tuple(map(int, values["legal"]))
        _probability("legal_probability", values["legal_probability"])
        for name, found in dict(values["programs"]).items():
            _probability(f"programs: {name:.40}", found)
        values["answers"] = tuple(AgentAnswer(str(text), bool(known)) for text, known in values.get("answers", ()))
        if len(values["types"]) != len(ActionType) or len(values["legal"]) != len(ActionType):
            raise ValueError(f"types and legal must be {len(ActionType)} numbers each")
        return cls(**values)

    def judged(self, *, optimal: bool | None, steps_to_go: int | None) -> Self:
        """With what the expert says."""
        return replace(self, optimal=optimal, steps_to_go=steps_to_go)


def _probability(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= 1:
        raise ValueError(f"{name} must be probabilities from 0 to 1, not {value!r:.80}")
    return float(value)


class Places(NamedTuple):
    """Where an appearance's actions act."""

    types: Int64Array  # (actions,) ActionType
    cells: Int64Array  # (actions,) 0 for STOP
    count: int  # cells


@lru_cache(maxsize=4)
def places(appearance: Appearance) -> Places:
    """The cells of Tower are its boxes; Scatter's are numbered column by column: column x rows + row."""
    actions = [appearance.decode(index) for index in range(appearance.action_count)]
    grid: tuple[int, int] = getattr(appearance, "grid", (BOX_COUNT, 1))
    types = np.array([_type(action) for action in actions], np.int64)
    return Places(types, np.array([_cell(action, grid[1]) for action in actions], np.int64), grid[0] * grid[1])


def _type(action: Action) -> ActionType:
    if isinstance(action, AddBlock | AddItem):
        return ActionType.ADD
    return ActionType.REMOVE if isinstance(action, RemoveBlock | RemoveItem) else ActionType.STOP


def _cell(action: Action, rows: int) -> int:
    match action:
        case AddBlock(box, _) | RemoveBlock(box):
            return box
        case AddItem(column, row, _, _, _) | RemoveItem(column, row):
            return column * rows + row
        case _:
            return 0


def decisions(output: PolicyOutput, legal: BoolArray, appearance: Appearance) -> list[Decision]:
    """What is kept of B states; `legal` (B, actions) are the exact masks, whether the policy saw them or not.

    Raises ValueError when the policy's output does not fit them.
    """
    if output.probabilities.shape != legal.shape:
        raise ValueError(f"the policy gave probabilities {output.probabilities.shape}, not {legal.shape}")
    return [_decision(output, row, legal[row], appearance) for row in range(len(legal))]


def _decision(output: PolicyOutput, row: int, legal: BoolArray, appearance: Appearance) -> Decision:
    probabilities = np.asarray(output.probabilities[row], np.float64)
    kinds, cells, count = places(appearance)
    types = _sums(kinds, probabilities, len(ActionType))
    adds, removes = (
        _sums(cells, np.where(kinds == kind, probabilities, 0.0), count) for kind in (ActionType.ADD, ActionType.REMOVE)
    )
    programs = {} if output.programs is None else output.programs[row]
    best = sorted(programs, key=lambda program: (-programs[program], program))[:LIKELIEST]
    return Decision(
        types=(_rounded(float(types[0])), _rounded(float(types[1])), _rounded(float(types[2]))),
        add_cells=_kept(adds),
        remove_cells=_kept(removes),
        likeliest=_likeliest(probabilities, appearance),
        legal=tuple(np.bincount(kinds[legal], minlength=len(ActionType)).tolist()),
        legal_probability=_rounded(float(probabilities[legal].sum())),
        value=None if output.values is None else round(float(output.values[row]), DIGITS),
        success_probability=_rounded(output.success_probabilities[row]) if output.success_probabilities else None,
        programs={program: _rounded(programs[program]) for program in best},
    )


def _sums(groups: Int64Array, probabilities: Float64Array, count: int) -> Float64Array:
    """(count,) of each group."""
    return np.bincount(groups, probabilities, count).astype(np.float64, copy=False)


def _likeliest(probabilities: Float64Array, appearance: Appearance) -> tuple[tuple[Action, float], ...]:
    """Those that have any probability; of equals the first."""
    order = np.argsort(-probabilities, kind="stable")[:LIKELIEST]
    chosen = [index for index in order.tolist() if probabilities[index] > 0]
    return tuple((appearance.decode(index), _rounded(float(probabilities[index]))) for index in chosen)


def _kept(cells: Float64Array) -> dict[int, float]:
    kept = np.flatnonzero(cells >= LEAST_PROBABILITY)
    return dict(zip(kept.tolist(), cells[kept].clip(0, 1).round(DIGITS).tolist(), strict=True))


def _rounded(probability: float) -> float:
    """Within 0 .. 1, whatever float32 made of it."""
    return round(min(max(probability, 0.0), 1.0), DIGITS)


def certain(chosen: Int64Array, action_count: int) -> FloatArray:
    """(B, actions) of a policy that draws nothing: 1 for the B actions that it chose."""
    probabilities = np.zeros((len(chosen), action_count))
    probabilities[np.arange(len(chosen)), chosen] = 1
    return probabilities
