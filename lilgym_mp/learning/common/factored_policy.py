"""Factored policies: a categorical over action types, then one over each argument the type uses.

Unused arguments are marginalised out: they add nothing to the action's log-probability. Source: Wu et al. 2023,
section 6 (the action head of all models).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import prod
from typing import Any, NamedTuple, Protocol

import numpy as np
import torch
from torch import Tensor

from lilgym_mp.scene import BOX_COUNT, Colour, Shape, Size
from lilgym_mp.scene.actions import ActionType
from lilgym_mp.scene.appearances import Appearance, UnsupportedAppearance
from lilgym_mp.scene.appearances.base import action_arrays
from lilgym_mp.scene.appearances.places import places_of
from lilgym_mp.scene.arrays import Float32Array, Float64Array, Int64Array

UNUSED = -1  # sentinel: an argument the type does not use, or an action without probability
STOP = 0  # action index
ITEM_FIELDS = {"shape": len(Shape), "colour": len(Colour), "size": len(Size)}  # their numbers of values
MAX_ACTIONS = 50_000


class Head(NamedTuple):
    """A categorical over one argument, independent of the other arguments given the type."""

    size: int
    types: tuple[ActionType, ...]  # action types that use the argument


@dataclass(frozen=True, eq=False)
class Factorisation:
    """The mapping between an appearance's actions and the choices of the heads."""

    heads: tuple[Head, ...]
    types: Int64Array  # (actions,) type of each; UNUSED for actions the heads cannot express
    choices: Int64Array  # (actions, heads) choice of each head; UNUSED if the type does not use it

    @property
    def action_count(self) -> int:
        """The number of actions, including STOP."""
        return len(self.types)

    def actions(self, types: Int64Array, choices: Sequence[Int64Array]) -> Int64Array:
        """(N,) action indices from N types and N choices of each head, ignoring unused ones."""
        actions = np.full(len(types), STOP, np.int64)
        for action_type in (ActionType.ADD, ActionType.REMOVE):
            rows = np.flatnonzero(types == action_type)
            used = tuple(index for index, head in enumerate(self.heads) if action_type in head.types)
            actions[rows] = edit_actions(self, action_type, used)[tuple(choices[index][rows] for index in used)]
        return actions


@cache
def edit_actions(factorisation: Factorisation, action_type: ActionType, used: tuple[int, ...]) -> Int64Array:
    """The action index of each edit of a type, by the choices of the heads `used` by it."""
    table = np.empty([factorisation.heads[index].size for index in used], np.int64)
    actions = np.flatnonzero(factorisation.types == action_type)
    table[tuple(factorisation.choices[actions, index] for index in used)] = actions
    return table


_EDITS = (ActionType.ADD, ActionType.REMOVE)


@cache
def slot_factorisation(appearance: Appearance) -> Factorisation:
    """One head per slot of the released array form; ADD and REMOVE share the position heads, as in the release.

    Tower: box 3, colour 3. Scatter on the released grid: x 19, y 5, shape 3, colour 3, size 3.
    """
    types, choices = np.split(action_arrays(appearance), [1], 1)
    used = [[edit for edit in _EDITS if edit in types[column != UNUSED]] for column in choices.T]
    heads = (Head(1 + int(column.max()), tuple(edits)) for column, edits in zip(choices.T, used, strict=True))
    return Factorisation(tuple(heads), types[:, 0], choices)


@cache
def joint_factorisation(appearance: Appearance, *, separators: bool = False) -> Factorisation:
    """One head for ADD, over box, cell and item type, and one for REMOVE, over box and cell.

    A Tower box is a single cell with three item types, its colours. Scatter's cells on separators, where no edit is
    ever legal, come after the others with `separators`, and have probability 0 without. Raises UnsupportedAppearance
    unless every place has an ADD of every item type and the action arrays have a slot for each field.
    """
    types, *slots = action_arrays(appearance).T
    places = places_of(appearance.grid)
    fields = appearance.example._fields
    item_sizes = [ITEM_FIELDS[field] for field in fields[len(places.counts) :]]
    if len(slots) == len(fields):
        indices = places.by_box(*slots[: len(places.counts)])
        item_types = np.ravel_multi_index([slot.clip(0) for slot in slots[len(places.counts) :]], item_sizes)
        chosen = {ActionType.ADD: indices * prod(item_sizes) + item_types, ActionType.REMOVE: indices}
        if not separators:
            in_box = indices < BOX_COUNT * prod(places.box_shape)
            types = np.where(in_box | (types == ActionType.STOP), types, UNUSED)
        choices = np.stack([np.where(types == edit, chosen[edit], UNUSED) for edit in _EDITS], 1)
        heads = tuple(Head(1 + int(choices[:, index].max()), (edit,)) for index, edit in enumerate(_EDITS))
        if heads[0].size == heads[1].size * prod(item_sizes) == np.count_nonzero(types == ActionType.ADD):
            return Factorisation(heads, types, choices)
    raise UnsupportedAppearance(f"appearance {appearance.name!r} has no heads for its actions; choose another model")


class Uniforms(Protocol):
    """A source of random numbers, such as NumPy's generators."""

    def random(self, size: int, /) -> Float64Array:
        """(size,) numbers from 0 to 1."""
        ...


class FactoredPolicy:
    """Action distributions of N states, from the logits of the type and of each head."""

    def __init__(
        self, factorisation: Factorisation, types: Tensor, heads: Sequence[Tensor], legal: Tensor | None = None
    ) -> None:
        """`types` (N, 3), `heads` (N, size) each; `legal` (N, actions) masks illegal actions."""
        self.factorisation = factorisation
        self.type_log_probs = torch.log_softmax(types, -1)
        self._heads = heads
        self._masked = None if legal is None else _masked(self.joint_log_probs(), legal)  # (N, actions)

    def evaluate_actions(self, actions: Tensor) -> tuple[Tensor, Tensor]:
        """(N,) log-probabilities of N actions, and (N,) exact entropies.

        The entropy is the type's plus each head's, weighted by the probability that the head is used.
        """
        if self._masked is not None:
            return self._masked.gather(1, actions[:, None]).squeeze(1), _entropy(self._masked)
        entropy = _entropy(self.type_log_probs)
        probabilities = self.type_log_probs.exp()
        log_probs: list[Tensor] = []
        for head, logits, chosen in self._head_choices(actions):
            log_prob, head_entropy = log_prob_and_entropy(logits, chosen)
            log_probs.append(log_prob)
            entropy = entropy + sum(probabilities[:, int(used)] for used in head.types) * head_entropy
        return self._action_log_probs(actions, log_probs), entropy

    def log_prob(self, actions: Tensor) -> Tensor:
        """(N,) log-probabilities of N actions."""
        if self._masked is not None:
            return self._masked.gather(1, actions[:, None]).squeeze(1)
        heads = self._head_choices(actions)
        return self._action_log_probs(
            actions,
            [logits.gather(1, chosen[:, None]).squeeze(1) - logits.logsumexp(1) for _, logits, chosen in heads],
        )

    def _head_choices(self, actions: Tensor) -> list[tuple[Head, Tensor, Tensor]]:
        """Each head with its logits and (N,) choices of N actions, arbitrary where unused."""
        choices = _tensors(self.factorisation, actions.device)[1][actions].clamp(min=0)
        heads = zip(self.factorisation.heads, self._heads, strict=True)
        return [(head, logits, choices[:, index]) for index, (head, logits) in enumerate(heads)]

    def _action_log_probs(self, actions: Tensor, head_log_probs: Sequence[Tensor]) -> Tensor:
        """(N,) sums of the type's log-probability and those of the heads it uses."""
        action_types, choices = _tensors(self.factorisation, actions.device)
        action_type = action_types[actions]
        total = self.type_log_probs.gather(1, action_type.clamp(min=0)[:, None]).squeeze(1)
        for index, log_probs in enumerate(head_log_probs):
            total = total + torch.where(choices[actions, index] == UNUSED, torch.zeros_like(log_probs), log_probs)
        return total.masked_fill(action_type == UNUSED, -torch.inf)

    def joint_log_probs(self) -> Tensor:
        """(N, actions) log-probabilities of all actions, unmasked."""
        action_types, choices = _tensors(self.factorisation, self.type_log_probs.device)
        total = self.type_log_probs[:, action_types.clamp(min=0)]
        for index, logits in enumerate(self._heads):
            used = choices[:, index] != UNUSED
            log_probs = torch.log_softmax(logits, -1)[:, choices[:, index].clamp(min=0)]
            total = total + torch.where(used, log_probs, torch.zeros_like(log_probs))
        return total.masked_fill(action_types == UNUSED, -torch.inf)

    def probabilities(self) -> Tensor:
        """(N, actions); masked if there is a mask."""
        return (self.joint_log_probs() if self._masked is None else self._masked).float().exp()

    def sample(self, rng: Uniforms) -> Int64Array:
        """(N,) sampled action indices."""
        count = len(self.type_log_probs)
        if self._masked is not None:
            return _sample(as_numpy(self._masked), rng.random(count))
        types = _sample(as_numpy(self.type_log_probs), rng.random(count))
        choices: list[Int64Array] = []
        for head, logits in zip(self.factorisation.heads, self._heads, strict=True):
            sampled = np.zeros(count, np.int64)
            uniforms = rng.random(count)
            used = np.isin(types, head.types)
            sampled[used] = _sample(as_numpy(logits)[used], uniforms[used])
            choices.append(sampled)
        return self.factorisation.actions(types, choices)

    def greedy(self) -> Int64Array:
        """(N,) the most probable type with its most probable arguments; if masked, the most probable legal action."""
        if self._masked is not None:
            return as_numpy(self._masked).argmax(1)
        return self.factorisation.actions(
            as_numpy(self.type_log_probs).argmax(1), [as_numpy(logits).argmax(1) for logits in self._heads]
        )

    def stop_probability(self) -> Tensor:
        """(N,)."""
        return (self.type_log_probs if self._masked is None else self._masked)[:, STOP].exp()


def _masked(log_probabilities: Tensor, legal: Tensor) -> Tensor:
    masked = log_probabilities.masked_fill(~legal, -torch.inf)
    return masked - masked.logsumexp(1, keepdim=True)


def _entropy(log_probabilities: Tensor) -> Tensor:
    """(N,) of (N, size); -inf contributes 0."""
    finite = log_probabilities.clamp(min=torch.finfo(log_probabilities.dtype).min)
    return -(log_probabilities.exp() * finite).sum(1)


def as_numpy(tensor: Tensor) -> Float32Array:
    """A float32 copy on the CPU, without gradients."""
    return tensor.detach().float().cpu().numpy()


def _sample(logits: Float32Array, uniforms: Float64Array) -> Int64Array:
    """(N,) indices by inverse transform sampling from logits (N, size) and uniform numbers (N,)."""
    sums = np.exp(logits - logits.max(1, keepdims=True, initial=-np.inf)).cumsum(1)
    return (sums <= (uniforms * sums[:, -1])[:, None]).sum(1)


CHUNK = 64  # rows of logits per operation, to stay in the CPU cache


class _LogProbAndEntropy(torch.autograd.Function):
    """Log-probability and entropy in chunks, recomputed in the backward pass: cheaper than storing log-softmaxes."""

    @staticmethod
    def forward(ctx: Any, logits: Tensor, choices: Tensor) -> tuple[Tensor, Tensor]:
        log_probs = logits.new_empty(len(logits))
        entropies = logits.new_empty(len(logits))
        for rows in _chunks(logits):
            logs = torch.log_softmax(logits[rows], 1)
            log_probs[rows] = logs.gather(1, choices[rows, None]).squeeze(1)
            entropies[rows] = _entropy(logs)
        ctx.save_for_backward(logits, choices, entropies)
        return log_probs, entropies

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        logits, choices, entropies = ctx.saved_tensors
        log_prob_gradients, entropy_gradients = (gradient[:, None] for gradient in gradients)
        logit_gradients = torch.empty_like(logits)
        for rows in _chunks(logits):
            logs = torch.log_softmax(logits[rows], 1)
            weights = (logs + entropies[rows, None]).mul_(entropy_gradients[rows]).add_(log_prob_gradients[rows])
            part = torch.mul(logs.exp_(), weights, out=logit_gradients[rows]).neg_()
            part.scatter_add_(1, choices[rows, None], log_prob_gradients[rows])
        return logit_gradients, None


def _chunks(logits: Tensor) -> list[slice]:
    size = CHUNK if logits.device.type == "cpu" else len(logits)
    return [slice(first, first + size) for first in range(0, len(logits), size)]


def log_prob_and_entropy(logits: Tensor, choices: Tensor) -> tuple[Tensor, Tensor]:
    """(N,) log-probabilities of choices (N,) and (N,) entropies, from logits (N, size)."""
    return _LogProbAndEntropy.apply(logits, choices)


@cache
def _tensors(factorisation: Factorisation, device: torch.device) -> tuple[Tensor, Tensor]:
    return torch.from_numpy(factorisation.types).to(device), torch.from_numpy(factorisation.choices).to(device)
