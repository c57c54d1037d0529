"""Policies that choose the type of an action first, then only the arguments that the type needs.

An argument that a type does not need is marginalised: it adds nothing to the action's log-probability. Source: Wu et
al. 2023, section 6 (the action head of all models).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from lilgym_mp.actions import Action, ActionType, AddBlock, AddItem, RemoveBlock, RemoveItem
from lilgym_mp.appearances import Appearance, Scatter
from lilgym_mp.appearances.numbering import ITEM_TYPES, item_type_of
from lilgym_mp.arrays import BoolArray, Float32Array, Float64Array, Int64Array
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, IMAGE_WIDTH, Colour

UNUSED = -1
STOP = 0  # index of the action
MOST_ACTIONS = 50_000


class Head(NamedTuple):
    """An argument that is chosen, given the type, independently of the others."""

    name: str
    size: int
    types: tuple[ActionType, ...]  # that need it


@dataclass(frozen=True)
class Factorisation:
    """What the heads' choices mean for each action of an appearance."""

    heads: tuple[Head, ...]
    types: Int64Array  # (actions,) type of each, UNUSED for one that the heads leave out
    choices: Int64Array  # (actions, heads) what each head must choose; UNUSED where the type does not need it

    @property
    def action_count(self) -> int:
        return len(self.types)

    def actions(self, types: Int64Array, choices: Sequence[Int64Array]) -> Int64Array:
        """(N,) actions of N types and of N choices of each head, those not needed ignored."""
        found = np.full(len(types), STOP, np.int64)
        for action_type in (ActionType.ADD, ActionType.REMOVE):
            rows = np.flatnonzero(types == action_type)
            needed = tuple(choices[index][rows] for index, head in enumerate(self.heads) if action_type in head.types)
            found[rows] = self._table(action_type)[needed]
        return found

    def _table(self, action_type: ActionType) -> Int64Array:
        """The action of each choice of the heads that the type needs."""
        needed = [index for index, head in enumerate(self.heads) if action_type in head.types]
        return _table(self, action_type, tuple(needed))

    def __hash__(self) -> int:
        return id(self)


@cache
def _table(factorisation: Factorisation, action_type: ActionType, needed: tuple[int, ...]) -> Int64Array:
    table = np.empty([factorisation.heads[index].size for index in needed], np.int64)
    actions = np.flatnonzero(factorisation.types == action_type)
    table[tuple(factorisation.choices[actions, index] for index in needed)] = actions
    return table


_EDITS = (ActionType.ADD, ActionType.REMOVE)
_SLOTS = {  # names of the slots of the released array form after the type, and who needs them
    3: (("box", _EDITS), ("colour", (ActionType.ADD,))),
    6: (
        ("x", _EDITS),
        ("y", _EDITS),
        ("shape", (ActionType.ADD,)),
        ("colour", (ActionType.ADD,)),
        ("size", (ActionType.ADD,)),
    ),
}


@cache
def slot_factorisation(appearance: Appearance) -> Factorisation:
    """A head for each slot of the released array form; ADD and REMOVE share those of the position, as released.

    Tower: box 3, colour 3. Scatter on the released grid: x 19, y 5, shape 3, colour 3, size 3.
    """
    count = appearance.action_count
    arrays = np.array([appearance.to_array(appearance.decode(index)) for index in range(count)], np.int64)
    slots = _SLOTS[arrays.shape[1]]
    heads = tuple(Head(name, int(arrays[:, 1 + i].max()) + 1, types) for i, (name, types) in enumerate(slots))
    return Factorisation(heads, arrays[:, 0], arrays[:, 1:])


@cache
def joint_factorisation(appearance: Appearance) -> Factorisation:
    """One head for all that an ADD needs, by box, cell of the box and look, and one for a REMOVE's box and cell.

    A Tower box is one cell with three looks, its colours. Scatter's cells on separators are left out: they have no
    probability, as nothing is ever valid there.
    """
    count = appearance.action_count
    found = [_joint(appearance, appearance.decode(index)) for index in range(count)]
    types = np.array([action_type for action_type, _ in found], np.int64)
    adds, removes = ([choice for action_type, choice in found if action_type == wanted] for wanted in _EDITS)
    choices = np.full((count, 2), UNUSED, np.int64)
    choices[types == ActionType.ADD, 0] = adds
    choices[types == ActionType.REMOVE, 1] = removes
    heads = Head("add", 1 + max(adds), (ActionType.ADD,)), Head("remove", 1 + max(removes), (ActionType.REMOVE,))
    return Factorisation(heads, types, choices)


def _joint(appearance: Appearance, action: Action) -> tuple[int, int]:
    """The type, and the choice of its one head; UNUSED for an action on a separator."""
    match action:
        case AddBlock(box, colour):
            return ActionType.ADD, box * len(Colour) + colour
        case RemoveBlock(box):
            return ActionType.REMOVE, box
        case AddItem(column, row, shape, colour, size):
            cell = _cell(appearance, column, row)
            return (
                (UNUSED, 0)
                if cell is None
                else (ActionType.ADD, cell * len(ITEM_TYPES) + item_type_of(shape, colour, size))
            )
        case RemoveItem(column, row):
            cell = _cell(appearance, column, row)
            return (UNUSED, 0) if cell is None else (ActionType.REMOVE, cell)
        case _:
            return ActionType.STOP, UNUSED


def _cell(appearance: Appearance, column: int, row: int) -> int | None:
    """The cell counted box by box, row by row; None on a separator."""
    assert isinstance(appearance, Scatter)
    rows, columns, pitch = box_cells(appearance)
    box, across = divmod(column, pitch)
    return None if across >= columns else (box * rows + row) * columns + across


def box_cells(appearance: Scatter) -> tuple[int, int, int]:
    """Rows and columns of a box's cells, and columns from a box to the next."""
    columns, rows = appearance.grid
    width = IMAGE_WIDTH // columns
    return rows, BOX_SIDE // width, BOX_PITCH // width


def cells_of(appearance: Appearance) -> int:
    """Cells of all boxes, separators left out."""
    if not isinstance(appearance, Scatter):
        return BOX_COUNT
    rows, columns, _ = box_cells(appearance)
    return BOX_COUNT * rows * columns


class FactoredPolicy:
    """The distributions over actions of N states, of the logits of the type and of each head."""

    def __init__(
        self, factorisation: Factorisation, types: Tensor, heads: Sequence[Tensor], legal: Tensor | None = None
    ) -> None:
        """`types` (N, 3) and `heads` (N, size) each; `legal` (N, actions) leaves nothing else its probability."""
        self.factorisation = factorisation
        self.types = torch.log_softmax(types, -1)
        self._heads = heads
        self.masked = None if legal is None else _masked(self.joint(), legal)

    def evaluate_actions(self, actions: Tensor) -> tuple[Tensor, Tensor]:
        """(N,) log-probabilities of N actions, and (N,) entropies.

        The entropy is exact: the type's, and each head's as often as it is needed.
        """
        if self.masked is not None:
            return self.masked.gather(1, actions[:, None]).squeeze(1), _entropy(self.masked)
        entropy = _entropy(self.types)
        probabilities = self.types.exp()
        log_probs: list[Tensor] = []
        for head, logits, chosen in self._chosen(actions):
            log_prob, of_head = log_prob_and_entropy(logits, chosen)
            log_probs.append(log_prob)
            entropy = entropy + probabilities[:, list(head.types)].sum(1) * of_head
        return self._joined(actions, log_probs), entropy

    def log_prob(self, actions: Tensor) -> Tensor:
        """(N,) of N actions."""
        if self.masked is not None:
            return self.masked.gather(1, actions[:, None]).squeeze(1)
        heads = self._chosen(actions)
        return self._joined(
            actions,
            [logits.gather(1, chosen[:, None]).squeeze(1) - logits.logsumexp(1) for _, logits, chosen in heads],
        )

    def _chosen(self, actions: Tensor) -> list[tuple[Head, Tensor, Tensor]]:
        """Each head, its logits, and (N,) what N actions choose of it; anything where they need nothing."""
        choices = _tensors(self.factorisation, actions.device)[1][actions].clamp(min=0)
        heads = zip(self.factorisation.heads, self._heads, strict=True)
        return [(head, logits, choices[:, index]) for index, (head, logits) in enumerate(heads)]

    def _joined(self, actions: Tensor, of_heads: Sequence[Tensor]) -> Tensor:
        """(N,) log-probabilities of N actions: of the type, and of what the heads that it needs choose."""
        action_types, choices = _tensors(self.factorisation, actions.device)
        action_type = action_types[actions]
        total = self.types.gather(1, action_type.clamp(min=0)[:, None]).squeeze(1)
        for index, found in enumerate(of_heads):
            total = total + torch.where(choices[actions, index] == UNUSED, torch.zeros_like(found), found)
        return total.masked_fill(action_type == UNUSED, -torch.inf)

    def entropy(self) -> Tensor:
        """(N,) as `evaluate_actions` has it."""
        return self.evaluate_actions(torch.full((len(self.types),), STOP, device=self.types.device))[1]

    def joint(self) -> Tensor:
        """(N, actions) log-probability of every action."""
        action_types, choices = _tensors(self.factorisation, self.types.device)
        total = self.types[:, action_types.clamp(min=0)]
        for index, logits in enumerate(self._heads):
            needed = choices[:, index] != UNUSED
            found = torch.log_softmax(logits, -1)[:, choices[:, index].clamp(min=0)]
            total = total + torch.where(needed, found, torch.zeros_like(found))
        return total.masked_fill(action_types == UNUSED, -torch.inf)

    def probabilities(self) -> Tensor:
        """(N, actions) of being drawn; with a mask, of the legal ones alone."""
        return (self.joint() if self.masked is None else self.masked).float().exp()

    def sample(self, rng: np.random.Generator) -> Int64Array:
        """(N,) actions drawn."""
        count = len(self.types)
        if self.masked is not None:
            return _drawn(_array(self.masked), rng.random(count))
        types = _drawn(_array(self.types), rng.random(count))
        choices: list[Int64Array] = []
        for head, logits in zip(self.factorisation.heads, self._heads, strict=True):
            drawn, thresholds = np.zeros(count, np.int64), rng.random(count)
            needed = np.isin(types, head.types)
            drawn[needed] = _drawn(_array(logits)[needed], thresholds[needed])
            choices.append(drawn)
        return self.factorisation.actions(types, choices)

    def likeliest(self) -> Int64Array:
        """(N,) the likeliest type with its likeliest arguments; with a mask, the likeliest legal action."""
        if self.masked is not None:
            return _array(self.masked).argmax(1)
        return self.factorisation.actions(
            _array(self.types).argmax(1), [_array(logits).argmax(1) for logits in self._heads]
        )

    def stop_probability(self) -> Tensor:
        """(N,)."""
        return (self.types if self.masked is None else self.masked)[:, STOP].exp()


def _masked(log_probabilities: Tensor, legal: Tensor) -> Tensor:
    kept = log_probabilities.masked_fill(~legal, -torch.inf)
    return kept - kept.logsumexp(1, keepdim=True)


def _entropy(log_probabilities: Tensor) -> Tensor:
    """(N,) of (N, size); what has no probability counts nothing."""
    finite = log_probabilities.clamp(min=torch.finfo(log_probabilities.dtype).min)
    return -(log_probabilities.exp() * finite).sum(1)


def _array(tensor: Tensor) -> Float32Array:
    return tensor.detach().float().cpu().numpy()


def _drawn(logits: Float32Array, thresholds: Float64Array) -> Int64Array:
    """(N,) places, drawn from (N, size) by numbers from 0 to 1 (N,)."""
    sums = np.exp(logits - logits.max(1, keepdims=True, initial=-np.inf)).cumsum(1)
    return (sums <= (thresholds * sums[:, -1])[:, None]).sum(1)


CHUNK = 64  # rows of logits at once, so that they stay in the processor's cache


class _LogProbAndEntropy(torch.autograd.Function):
    """Row by row, calculated again for the gradients: cheaper than to write it to memory and read it."""

    @staticmethod
    def forward(ctx: Any, logits: Tensor, choices: Tensor) -> tuple[Tensor, Tensor]:
        log_probs, entropies = logits.new_empty(len(logits)), logits.new_empty(len(logits))
        for rows in _chunks(logits):
            logs = torch.log_softmax(logits[rows], 1)
            log_probs[rows] = logs.gather(1, choices[rows, None]).squeeze(1)
            entropies[rows] = _entropy(logs)
        ctx.save_for_backward(logits, choices, entropies)
        return log_probs, entropies

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        logits, choices, entropies = ctx.saved_tensors
        of_log_probs, of_entropies = (gradient[:, None] for gradient in gradients)
        found = torch.empty_like(logits)
        for rows in _chunks(logits):
            logs = torch.log_softmax(logits[rows], 1)
            weights = (logs + entropies[rows, None]).mul_(of_entropies[rows]).add_(of_log_probs[rows])
            part = torch.mul(logs.exp_(), weights, out=found[rows]).neg_()
            part.scatter_add_(1, choices[rows, None], of_log_probs[rows])
        return found, None


def _chunks(logits: Tensor) -> list[slice]:
    size = CHUNK if logits.device.type == "cpu" else len(logits)
    return [slice(first, first + size) for first in range(0, len(logits), size)]


def log_prob_and_entropy(logits: Tensor, choices: Tensor) -> tuple[Tensor, Tensor]:
    """(N,) log-probabilities of choices (N,) and (N,) entropies, from logits (N, size)."""
    return _LogProbAndEntropy.apply(logits, choices)


@cache
def _tensors(factorisation: Factorisation, device: torch.device) -> tuple[Tensor, Tensor]:
    return torch.from_numpy(factorisation.types).to(device), torch.from_numpy(factorisation.choices).to(device)


def mask_of(legal: BoolArray, device: torch.device) -> Tensor:
    return torch.from_numpy(legal).to(device)
