"""V(statement, scene) = P(true): what is computed of items, boxes and the scene is modulated by the statement.

With binary features f_i of item i and g_b of box b, and elementwise scales s_n and shifts t_n computed from the words:
a_b = sum over items of act(s_1 * A relu(F f_i) + t_1), u_b = act(s_2 * B code(a_b) + t_2 + G g_b), x = sum over boxes
of [a_b, u_b], logit = c . relu(s_4 * D relu(s_3 * C code(x) + t_3) + t_4) + constant; biases of A to G are left out.
`act` is relu, but a sigmoid in a few units, whose sums are soft counts; `code` compares these with 1/2, 3/2, ... 13/2.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple, cast

import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor, nn

from lilgym_mp.learning.common.attention import Attention, Feedforward, TextEncoder, among_all, attention_mask

CODE = 8  # values for a count: seven comparisons, and itself
SPARSE = -1.5  # initial bias of what is counted: few items are


class BoxFeatures(NamedTuple):
    """Features of U boxes per statement, or of the same boxes for all statements (S = 1)."""

    items: Tensor  # (S, M, F) those that differ; the first is none
    members: Tensor  # (S, U, I) the items of each box; 0 for none
    looks: Tensor  # (S, U, G)


class Reading(NamedTuple):
    """S statements encoded, independent of scenes."""

    item_weights: Tensor  # (S, F, d)
    box_weights: Tensor  # (S, G, d)
    scales: tuple[Tensor, ...]  # of the modulated layers, (S, 1, d or d + k)
    shifts: tuple[Tensor, ...]

    def first(self, count: int) -> Reading:
        """The first `count` encodings."""
        scales, shifts = ([part[:count] for part in parts] for parts in (self.scales, self.shifts))
        return Reading(self.item_weights[:count], self.box_weights[:count], (*scales,), (*shifts,))


class ModulatedNetwork(nn.Module):
    """Width d, of which no unit is a count, and k soft counts of items and of boxes besides."""

    def __init__(
        self,
        vocabulary: int,
        item_width: int,
        box_width: int,
        *,
        width: int = 64,
        counts: int = 0,
        tokens: int = 6,
        dropout: float = 0.1,
        heads: int = 4,
        layers: int = 2,
    ) -> None:
        super().__init__()
        self.width = width
        self.counts = counts
        self.text = TextEncoder(vocabulary, width, heads, layers, dropout)
        self.queries = nn.Parameter(0.3 * torch.randn(tokens, width))
        self.readings = nn.ModuleList(Attention(width, heads) for _ in range(layers))
        self.feedforwards = nn.ModuleList(Feedforward(width) for _ in range(layers))
        self.norm = nn.LayerNorm(width)
        self._modulated = [width + counts, width + counts, width, width]
        self.modulation = nn.Linear(tokens * width, 2 * sum(self._modulated))
        self.item = nn.Linear(item_width, width)
        self.box = nn.Linear(box_width, width)
        self.item_layer = nn.Linear(width, width + counts)
        self.box_layer = nn.Linear(width + CODE * counts, width + counts)
        self.scene_layer = nn.Linear(2 * (width + CODE * counts), width)
        self.last_layer = nn.Linear(width, width)
        self.output = nn.Linear(width, 1)

    def read(self, words: Tensor, item_columns: Tensor, box_columns: Tensor) -> Reading:
        """(S, T) word indices, and the exchanged feature columns (S, F) and (S, G) of each statement."""
        text = self.text(words)
        mask = attention_mask(words)
        x = self.queries.expand(len(words), -1, -1)
        layers = zip(self.readings, self.feedforwards, strict=True)
        for reading, feedforward in cast("Iterable[tuple[Attention, Feedforward]]", layers):
            x = self.text.dropout(feedforward(reading(x, reading.key_value(text), mask)))
        scales, shifts = self.modulation(self.norm(x).flatten(1))[:, None].chunk(2, -1)
        # permuted weights give of a scene what they would give of the exchanged one
        item_weights = self.item.weight.t()[item_columns]
        box_weights = self.box.weight.t()[box_columns]
        return Reading(
            item_weights, box_weights, (1 + scales).split(self._modulated, -1), shifts.split(self._modulated, -1)
        )

    def item_units(self, reading: Reading, items: Tensor) -> Tensor:
        """(S, M, d + k) of items with features (S or 1, M, F)."""
        hidden = F.relu(items @ reading.item_weights + self.item.bias)
        return self._activated(self.item_layer(hidden) * reading.scales[0] + reading.shifts[0], SPARSE)

    def item_sums(self, reading: Reading, features: BoxFeatures) -> Tensor:
        """(S, U, d + k) of U boxes."""
        units = self.item_units(reading, features.items)
        members = features.members.expand(len(units), -1, -1)  # those of the same boxes for all statements, too
        members = torch.where(members > 0, among_all(members, units.shape[1]), 0)
        # row 0, no item of the first statement, is left out
        sums = F.embedding_bag(members.flatten(0, 1), units.flatten(0, 1), mode="sum", padding_idx=0)
        return sums.unflatten(0, (len(units), -1))

    def box_values(self, reading: Reading, sums: Tensor, looks: Tensor) -> Tensor:
        """(S, U, 2 (d + k)), counts last, from item sums (S, U, d + k) and box features (S or 1, U, G)."""
        looks = F.pad(looks @ reading.box_weights + self.box.bias, (0, self.counts))
        units = self._coded(self.box_layer, sums, self.width) * reading.scales[1] + reading.shifts[1] + looks
        parts = [part.split([self.width, self.counts], -1) for part in (sums, self._activated(units, 0.0))]
        return torch.cat([column for pair in zip(*parts, strict=True) for column in pair], -1)

    def logits(self, reading: Reading, sums: Tensor) -> Tensor:
        """(S, N) of scenes, from their boxes' values summed (S, N, 2 (d + k))."""
        x = F.relu(self._coded(self.scene_layer, sums, 2 * self.width) * reading.scales[2] + reading.shifts[2])
        x = F.relu(self.last_layer(x) * reading.scales[3] + reading.shifts[3])
        return self.output(x).squeeze(-1)

    def _activated(self, x: Tensor, bias: float) -> Tensor:
        if not self.counts:
            return F.relu(x)
        hidden, counted = x.split([self.width, self.counts], -1)
        return torch.cat([F.relu(hidden), torch.sigmoid(counted + bias)], -1)

    def _coded(self, layer: nn.Linear, sums: Tensor, width: int) -> Tensor:
        """The layer of the sums, of which all but the first `width` columns are coded."""
        if not self.counts:
            return layer(sums)
        plain = layer.weight[:, :width]
        codes = layer.weight[:, width:].unflatten(1, (-1, CODE))
        thresholds = 4 * torch.arange(CODE - 1, device=sums.device, dtype=sums.dtype) + 2
        compared = torch.sigmoid(4 * sums[..., width:, None] - thresholds).flatten(-2)
        same = F.linear(sums, torch.cat([plain, 0.25 * codes[..., -1]], 1), layer.bias)
        return same + F.linear(compared, codes[..., :-1].flatten(1))

    def forward(self, reading: Reading, features: BoxFeatures, scenes: Tensor) -> Tensor:
        """(S, N) logits of `scenes` (S, N, 3), which index the U boxes with these features."""
        values = self.box_values(reading, self.item_sums(reading, features), features.looks)
        return self.logits(reading, sum_boxes(values, scenes))


def sum_boxes(values: Tensor, scenes: Tensor) -> Tensor:
    """(S, N, n) the values (S, U, n) of each scene's boxes, summed; `scenes` (S, N, 3)."""
    sums = F.embedding_bag(among_all(scenes, values.shape[1]).flatten(0, 1), values.flatten(0, 1), mode="sum")
    return sums.unflatten(0, scenes.shape[:2])
