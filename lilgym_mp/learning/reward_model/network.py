"""V(statement, scene) = P(true), by counting: words select items, items are counted, counts decide.

Item i of box b with features f_i: h_i = relu(F f_i), a_ik = sigmoid(h_i . q_k + bias_k): soft predicate k of the item.
Counts c_bk = sum of a_ik over the box, coded by `count_code`. Box unit u_bh = sigmoid(W_h . code(c_b) + r_h . g_b +
bias), g_b features of the box. Scene unit z_m = W_m . [code(sum_b c_b), code(sum_b u_b)] + bias; logit =
z_0 + sum_m o_m sigmoid(z_m) + constant. q_k, r_h, W_h, W_m and biases are computed from the statement, once.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple, cast

import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor, nn

from lilgym_mp.learning.imitation.network import Attention, Feedforward, TextEncoder, attention_mask

CODE_SLOTS = 8  # seven thresholds, and the count itself
SPARSE = -1.5  # initial bias of predicates: few items have them
FEATURE_SCALE = 0.5  # initial weights of binary features; with torch's, all items look alike and learning starts late


class Reading(NamedTuple):
    """What the network computes of S statements, before it sees a scene: K predicates, H box and M scene units."""

    item_weights: Tensor  # (S, F, d)
    box_weights: Tensor  # (S, G, d)
    queries: Tensor  # (S, d, K)
    query_bias: Tensor  # (S, 1, K)
    box_counts: Tensor  # (S, K * 8, H)
    box_looks: Tensor  # (S, d, H)
    box_bias: Tensor  # (S, 1, H)
    scene_counts: Tensor  # (S, (K + H) * 8, M)
    scene_bias: Tensor  # (S, 1, M)
    outputs: Tensor  # (S, M, 1)


def count_code(counts: Tensor) -> Tensor:
    """(..., n) soft counts to (..., n * 8): whether each exceeds 1/2, 3/2, ... 13/2, softly, and itself."""
    thresholds = torch.arange(CODE_SLOTS - 1, device=counts.device, dtype=counts.dtype) + 0.5
    steps = torch.sigmoid(4 * (counts[..., None] - thresholds))
    return torch.cat([steps, 0.25 * counts[..., None]], -1).flatten(-2)


class CountingNetwork(nn.Module):
    def __init__(
        self,
        vocabulary: int,
        item_width: int,
        box_width: int,
        *,
        width: int = 64,
        predicates: int = 12,
        box_units: int = 12,
        scene_units: int = 8,
        rank: int = 48,
        dropout: float = 0.1,
        heads: int = 4,
        layers: int = 2,
    ) -> None:
        super().__init__()
        self.predicates, self.box_units, self.scene_units = predicates, box_units, scene_units
        self.text = TextEncoder(vocabulary, width, heads, layers, dropout)
        self.units = nn.Parameter(0.5 * torch.randn(predicates + box_units + scene_units, width))
        self.word_readings = nn.ModuleList(Attention(width, heads) for _ in range(layers))
        self.unit_readings = nn.ModuleList(Attention(width, heads) for _ in range(layers))
        self.feedforwards = nn.ModuleList(Feedforward(width) for _ in range(layers))
        self.norm = nn.LayerNorm(width)
        self.item = nn.Linear(item_width, width)
        self.box = nn.Linear(box_width, width)
        self.query = nn.Linear(width, width + 1)
        self.look = nn.Linear(width, width + 1)
        self.slots = nn.Linear(width, 2 * CODE_SLOTS * rank)  # of predicates: read by box and by scene units
        self.box_slots = nn.Linear(width, CODE_SLOTS * rank)  # of box units: read by scene units
        self.box_reads = nn.Linear(width, rank)
        self.scene_reads = nn.Linear(width, rank + 2)
        self.constant = nn.Parameter(torch.zeros(()))
        for layer in (self.item, self.box):
            nn.init.normal_(layer.weight, std=FEATURE_SCALE)

    def read(self, words: Tensor, item_columns: Tensor, box_columns: Tensor) -> Reading:
        """(S, T) word indices, and the exchanged feature columns (S, F) and (S, G) of each statement."""
        text, mask = self.text(words), attention_mask(words)
        x = self.units.expand(len(words), -1, -1)
        no_mask = torch.zeros((), device=x.device)
        layers = zip(self.word_readings, self.unit_readings, self.feedforwards, strict=True)
        for word_reading, unit_reading, feedforward in cast(
            "Iterable[tuple[Attention, Attention, Feedforward]]", layers
        ):
            x = word_reading(x, word_reading.key_value(text), mask)
            x = unit_reading(x, unit_reading.key_value(unit_reading.norm(x)), no_mask)
            x = self.text.dropout(feedforward(x))
        x = self.norm(x)
        predicates, box_units, scene_units = x.split([self.predicates, self.box_units, self.scene_units], 1)
        width = x.shape[-1]
        query, query_bias = self.query(predicates).split([width, 1], -1)
        look, box_bias = self.look(box_units).split([width, 1], -1)
        for_boxes, for_scenes = self.slots(predicates).unflatten(-1, (2, CODE_SLOTS, -1)).unbind(2)
        for_scenes = torch.cat([for_scenes, self.box_slots(box_units).unflatten(-1, (CODE_SLOTS, -1))], 1)
        rank = for_boxes.shape[-1]
        scene_reads, scene_bias, outputs = self.scene_reads(scene_units).split([rank, 1, 1], -1)
        return Reading(
            _exchanged(self.item.weight, item_columns),
            _exchanged(self.box.weight, box_columns),
            query.transpose(1, 2) * width**-0.5 * 2,
            query_bias.transpose(1, 2) + SPARSE,
            for_boxes.flatten(1, 2) @ self.box_reads(box_units).transpose(1, 2) * rank**-0.5,
            look.transpose(1, 2) * width**-0.5,
            box_bias.transpose(1, 2),
            for_scenes.flatten(1, 2) @ scene_reads.transpose(1, 2) * rank**-0.5,
            scene_bias.transpose(1, 2),
            outputs,
        )

    def count_items(self, reading: Reading, items: Tensor, present: Tensor | None = None) -> Tensor:
        """(S, U, K) counts in boxes: (S or 1, U, I, F) item features and whether each is there (S or 1, U, I)."""
        boxes, capacity = items.shape[1:3]
        hidden = F.relu(items.flatten(1, 2) @ reading.item_weights + self.item.bias)
        predicates = torch.sigmoid(hidden @ reading.queries + reading.query_bias)
        predicates = predicates.unflatten(1, (boxes, capacity))
        return predicates.sum(2) if present is None else (predicates * present[..., None]).sum(2)

    def box_values(self, reading: Reading, counts: Tensor, looks: Tensor) -> Tensor:
        """(S, U, K + H): a box's counts and units, from counts (S, U, K) and box features (S or 1, U, G)."""
        looks = F.relu(looks @ reading.box_weights + self.box.bias)
        units = count_code(counts) @ reading.box_counts + looks @ reading.box_looks + reading.box_bias
        return torch.cat([counts, torch.sigmoid(units)], -1)

    def logits(self, reading: Reading, sums: Tensor) -> Tensor:
        """(S, N) of scenes, from their boxes' values summed (S, N, K + H)."""
        units = count_code(sums) @ reading.scene_counts + reading.scene_bias
        return units[..., 0] + (torch.sigmoid(units) @ reading.outputs).squeeze(-1) + self.constant

    def forward(self, reading: Reading, features: tuple[Tensor, Tensor, Tensor], scenes: Tensor) -> Tensor:
        """(S, N) logits of `scenes` (S, N, 3), which index the U boxes with these features."""
        items, looks, present = features
        values = self.box_values(reading, self.count_items(reading, items, present), looks)
        return self.logits(reading, sum_boxes(values, scenes))


def _exchanged(weight: Tensor, columns: Tensor) -> Tensor:
    """(S, F, d): the weights (d, F), permuted so that scenes give what their exchanged ones would."""
    return weight.t()[columns]


def sum_boxes(values: Tensor, scenes: Tensor) -> Tensor:
    """(S, N, n) the values (S, U, n) of each scene's boxes, summed; `scenes` (S, N, 3)."""
    statements, boxes = values.shape[:2]
    first = torch.arange(statements, device=scenes.device)[:, None, None] * boxes
    flat = (scenes + first).flatten()
    return values.flatten(0, 1).index_select(0, flat).unflatten(0, scenes.shape).sum(2)
