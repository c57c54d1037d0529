"""V(statement, scene) = P(true): what is computed of items, boxes and the scene is modulated by the statement.

With binary features f_i of item i and g_b of box b, and elementwise scales s_n and shifts t_n computed from the words:
s_b = sum over items of relu(s_1 * A relu(F f_i) + t_1), v_b = relu(s_2 * B s_b + t_2 + G g_b), x = sum over boxes of
[s_b, v_b], logit = c . relu(s_4 * D relu(s_3 * C x + t_3) + t_4) + constant; biases of A to G are left out here.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple, cast

import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor, nn

from lilgym_mp.learning.imitation.network import Attention, Feedforward, TextEncoder, attention_mask

MODULATED = 4  # layers


class Reading(NamedTuple):
    """What the network computes of S statements, before it sees a scene."""

    item_weights: Tensor  # (S, F, d)
    box_weights: Tensor  # (S, G, d)
    scales: Tensor  # (4, S, 1, d)
    shifts: Tensor  # (4, S, 1, d)


class ModulatedNetwork(nn.Module):
    def __init__(
        self,
        vocabulary: int,
        item_width: int,
        box_width: int,
        *,
        width: int = 64,
        tokens: int = 6,
        dropout: float = 0.1,
        heads: int = 4,
        layers: int = 2,
    ) -> None:
        super().__init__()
        self.text = TextEncoder(vocabulary, width, heads, layers, dropout)
        self.queries = nn.Parameter(0.3 * torch.randn(tokens, width))
        self.readings = nn.ModuleList(Attention(width, heads) for _ in range(layers))
        self.feedforwards = nn.ModuleList(Feedforward(width) for _ in range(layers))
        self.norm = nn.LayerNorm(width)
        self.modulation = nn.Linear(tokens * width, 2 * MODULATED * width)
        self.item, self.box = nn.Linear(item_width, width), nn.Linear(box_width, width)
        self.item_layer, self.box_layer = nn.Linear(width, width), nn.Linear(width, width)
        self.scene_layer, self.last_layer = nn.Linear(2 * width, width), nn.Linear(width, width)
        self.output = nn.Linear(width, 1)

    def read(self, words: Tensor, item_columns: Tensor, box_columns: Tensor) -> Reading:
        """(S, T) word indices, and the exchanged feature columns (S, F) and (S, G) of each statement."""
        text, mask = self.text(words), attention_mask(words)
        x = self.queries.expand(len(words), -1, -1)
        layers = zip(self.readings, self.feedforwards, strict=True)
        for reading, feedforward in cast("Iterable[tuple[Attention, Feedforward]]", layers):
            x = self.text.dropout(feedforward(reading(x, reading.key_value(text), mask)))
        modulation = self.modulation(self.norm(x).flatten(1)).unflatten(-1, (2, MODULATED, 1, -1))
        scales, shifts = modulation.permute(1, 2, 0, 3, 4)
        # permuted weights give of a scene what they would give of the exchanged one
        item_weights, box_weights = self.item.weight.t()[item_columns], self.box.weight.t()[box_columns]
        return Reading(item_weights, box_weights, 1 + scales, shifts)

    def item_sums(self, reading: Reading, items: Tensor, present: Tensor | None = None) -> Tensor:
        """(S, U, d) of boxes: (S or 1, U, I, F) item features and whether each is there (S or 1, U, I)."""
        hidden = F.relu(items.flatten(1, 2) @ reading.item_weights + self.item.bias)
        hidden = F.relu(self.item_layer(hidden) * reading.scales[0] + reading.shifts[0]).unflatten(1, items.shape[1:3])
        return hidden.sum(2) if present is None else (hidden * present[..., None]).sum(2)

    def box_values(self, reading: Reading, sums: Tensor, looks: Tensor) -> Tensor:
        """(S, U, 2 d) from item sums (S, U, d), which come first, and box features (S or 1, U, G)."""
        looks = looks @ reading.box_weights + self.box.bias
        values = F.relu(self.box_layer(sums) * reading.scales[1] + reading.shifts[1] + looks)
        return torch.cat([sums, values], -1)

    def logits(self, reading: Reading, sums: Tensor) -> Tensor:
        """(S, N) of scenes, from their boxes' values summed (S, N, 2 d)."""
        x = F.relu(self.scene_layer(sums) * reading.scales[2] + reading.shifts[2])
        x = F.relu(self.last_layer(x) * reading.scales[3] + reading.shifts[3])
        return self.output(x).squeeze(-1)

    def forward(self, reading: Reading, features: tuple[Tensor, Tensor, Tensor], scenes: Tensor) -> Tensor:
        """(S, N) logits of `scenes` (S, N, 3), which index the U boxes with these features."""
        items, looks, present = features
        values = self.box_values(reading, self.item_sums(reading, items, present), looks)
        return self.logits(reading, sum_boxes(values, scenes))


def sum_boxes(values: Tensor, scenes: Tensor) -> Tensor:
    """(S, N, n) the values (S, U, n) of each scene's boxes, summed; `scenes` (S, N, 3)."""
    statements, boxes = values.shape[:2]
    first = torch.arange(statements, device=scenes.device)[:, None, None] * boxes
    flat = (scenes + first).flatten()
    return values.flatten(0, 1).index_select(0, flat).unflatten(0, scenes.shape).sum(2)
