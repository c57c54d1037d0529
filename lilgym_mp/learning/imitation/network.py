"""The network: from words and boxes to the statement's truth and the policy's logits.

Boxes are encoded conditioned on the statement, once per statement-box pair, however many scenes share it. A scene is a
sum over its three boxes, so its truth is invariant to their order. The policy factorises: STOP from the truth and the
target, otherwise ADD or REMOVE, then the type's arguments.

Module attributes are the keys of saved parameters, so renaming one breaks model files.
"""

from __future__ import annotations

from typing import NamedTuple, cast

import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor, nn

from lilgym_mp.learning.common.attention import (
    Attention,
    Feedforward,
    StatementEncodings,
    TextEncoder,
    among_all,
    attention_mask,
)
from lilgym_mp.learning.imitation.box_features import CELLS, FIXED_FEATURES, OFFSETS, RELATIONS
from lilgym_mp.scene import FOOTPRINT_COUNT, Colour
from lilgym_mp.scene.appearances import part_of
from lilgym_mp.scene.appearances.scatter.actions import ITEM_TYPE_COUNT, ITEM_TYPE_FOOTPRINTS

MAX_STEPS = 8  # classes of the steps-to-go head
RELATION_GATES = 8  # per relation layer
CELL_CHANNELS = 32  # dimension of cell keys and item type queries
CELL_HIDDEN = 64
GEOMETRY_CHANNELS = VALUE_CHANNELS = 16


class Inputs(NamedTuple):
    """S statements with at most U boxes of K items each, M items in total, and N scenes composed of those boxes.

    Cells are encoded for the first V boxes of each statement, which hold C items in total.
    """

    words: Tensor  # (S, T) word indices, 0 is padding
    features: Tensor  # (S, M, F) features of each item, except its colour
    colours: Tensor  # (S, M)
    by_box: Tensor  # (S, U, K) index of each box's items among the S * M; S * M is padding
    by_item: Tensor  # (S, M) index of each item among the S * U * K
    relations: Tensor  # (S, U, K, K) between the items of a box
    cell_boxes: Tensor  # (S, V) only its shape is used
    cell_items: Tensor  # (C,) item index among the S * M
    item_boxes: Tensor  # (C,) index of the item's box among the S * V
    offsets: Tensor  # (C, 2, 5) of items to cell columns and rows
    scenes: Tensor  # (S, N, 3) box indices 0 .. U - 1 of each scene


class BoxEncodings(NamedTuple):
    """U boxes for each of S statements, the first V of them with their cells (Scatter)."""

    scene_terms: Tensor  # (S, U, 2 d) contribution to the scene vector
    refinement_terms: Tensor  # (S, U, d) contribution to its refinement
    action_terms: Tensor  # (S, U, d) contribution to the action features
    cells: Tensor | None  # (S, V, 25, C) cell keys
    legal: Tensor | None  # (S, V, 25, 10) logits of legality: ADD of each footprint, REMOVE


class Outputs(NamedTuple):
    """Truth logits of S x N scenes, and action logits of the first A scenes of each statement."""

    truth: Tensor  # (S, N) logit of the statement being true
    types: Tensor  # (S, A, 2) logits of ADD and REMOVE, given not STOP
    adds: Tensor  # (S, A, adds)
    removes: Tensor  # (S, A, removes)
    steps: Tensor  # (S, A, MAX_STEPS) logits of the steps to go
    legal: Tensor | None  # (S, V, 25, 10) logits of legality: ADD of each footprint, REMOVE


class RelationLayer(nn.Module):
    """Sums over the items of a box, gated by their spatial relation to each item; sums, so that it can count."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.gates = nn.Embedding(RELATIONS, RELATION_GATES)
        self.value = nn.Linear(width, width)
        self.out = nn.Linear(width, width)

    def forward(self, x: Tensor, inputs: Inputs) -> Tensor:
        """`x` (S, M, d)."""
        value = items_by_box(F.relu(self.value(self.norm(x))), inputs.by_box)  # (P, K, d)
        pairs, items, width = value.shape
        gates = F.embedding(inputs.relations.flatten(0, 1), torch.sigmoid(self.gates.weight))
        gates = gates.permute(0, 3, 1, 2).to(value.dtype)  # (P, G, K, K)
        sums = gates @ value.view(pairs, items, RELATION_GATES, -1).transpose(1, 2)
        sums = sums.transpose(1, 2).reshape(pairs * items, width)
        return x + self.out(sums.index_select(0, inputs.by_item.flatten()).view(x.shape))


def items_by_box(x: Tensor, by_box: Tensor) -> Tensor:
    """(P, K, d) the items of each of the P statement-box pairs, zero-padded, from (S, M, d)."""
    padded = F.pad(x.flatten(0, 1), (0, 0, 0, 1))
    return padded.index_select(0, by_box.flatten()).view(-1, by_box.shape[-1], x.shape[-1])


class ItemLayer(nn.Module):
    """Items attend to words, then to each other through their relations."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.reading = Attention(width, heads)
        self.relating = RelationLayer(width)
        self.feedforward = Feedforward(width)

    def forward(self, x: Tensor, key_value: Tensor, mask: Tensor, inputs: Inputs) -> Tensor:
        """`x` (S, M, d)."""
        return self.feedforward(self.relating(self.reading(x, key_value, mask), inputs))


class CellGeometry(nn.Module):
    """Encodes each cell from the items around it and predicts which edits are legal there, without the statement."""

    def __init__(self) -> None:
        super().__init__()
        self.across = nn.Embedding(1 + FOOTPRINT_COUNT * OFFSETS, GEOMETRY_CHANNELS, padding_idx=0)
        self.down = nn.Embedding(1 + FOOTPRINT_COUNT * OFFSETS, GEOMETRY_CHANNELS, padding_idx=0)
        self.cells = nn.Parameter(0.1 * torch.randn(CELLS * CELLS, GEOMETRY_CHANNELS))
        self.mix = nn.Linear(GEOMETRY_CHANNELS, CELL_HIDDEN)
        self.legal = nn.Linear(CELL_HIDDEN, FOOTPRINT_COUNT + 1)
        for embedding in (self.across, self.down):
            nn.init.normal_(embedding.weight, std=0.5)
            nn.init.zeros_(embedding.weight[0])

    def item_terms(self, offsets: Tensor) -> Tensor:
        """(..., 25, C) contribution of items to the cells, from their `offsets` (..., 2, 5)."""
        across = self.across(offsets[..., 0, :])
        down = self.down(offsets[..., 1, :])
        return (across[..., :, None, :] * down[..., None, :, :]).flatten(-3, -2)

    def forward(self, sums: Tensor) -> tuple[Tensor, Tensor]:
        """(..., 25, H) cell features and (..., 25, 10) legality logits, from item terms summed over items
        (..., 25, C)."""
        with torch.autocast(sums.device.type, enabled=False):
            hidden = F.relu(self.mix(sums + self.cells))
            return hidden, self.legal(hidden)


class ScatterHeads(nn.Module):
    """Argument heads for Scatter: cell keys times queries, one query per item type to ADD and one for REMOVE."""

    footprints: Tensor  # (27,) the footprint of each item type

    def __init__(self, width: int) -> None:
        super().__init__()
        self.item_types = ITEM_TYPE_COUNT
        self.geometry = CellGeometry()
        self.across = nn.Embedding(1 + FOOTPRINT_COUNT * OFFSETS, VALUE_CHANNELS, padding_idx=0)
        self.down = nn.Embedding(1 + FOOTPRINT_COUNT * OFFSETS, VALUE_CHANNELS, padding_idx=0)
        self.value = nn.Linear(width, VALUE_CHANNELS)
        self.mix = nn.Linear(VALUE_CHANNELS + CELL_HIDDEN, CELL_HIDDEN)
        self.box = nn.Linear(width, CELL_HIDDEN)
        self.out = nn.Linear(CELL_HIDDEN, CELL_CHANNELS)
        self.wanted = nn.Linear(width, self.item_types * CELL_CHANNELS)  # ADD queries
        self.wanted_remove = nn.Linear(width, CELL_CHANNELS)  # REMOVE query
        self.look = nn.Linear(width, self.item_types)  # bias per item type, shared by all cells
        self.register_buffer("footprints", torch.tensor(ITEM_TYPE_FOOTPRINTS), persistent=False)

    def encode_cells(self, items: Tensor, box: Tensor, inputs: Inputs) -> tuple[Tensor, Tensor]:
        """(S, V, 25, C) cell keys and (S, V, 25, 10) legality logits."""
        statements, boxes = inputs.cell_boxes.shape
        # (items, 5, C) each
        across, down = (embedding(inputs.offsets[:, axis]) for axis, embedding in enumerate((self.across, self.down)))
        value = self.value(items.flatten(0, 1).index_select(0, inputs.cell_items)).float()[:, None]
        each = ((across * value)[:, :, None] * down[:, None]).flatten(1, 2)  # (items, 25, C)
        each = torch.cat([self.geometry.item_terms(inputs.offsets), each], -1)
        cells = each.new_zeros(statements * boxes, CELLS**2, each.shape[-1])
        cells = cells.index_add(0, inputs.item_boxes, each).unflatten(0, (statements, boxes))
        geometry, legal = self.geometry(cells[..., :GEOMETRY_CHANNELS])
        features = torch.cat([cells[..., GEOMETRY_CHANNELS:], geometry], -1)
        hidden = F.relu(self.mix(features) + self.box(box[:, :boxes])[..., None, :])
        return self.out(hidden), legal

    def forward(self, boxes: Tensor, encodings: BoxEncodings, acting: Tensor) -> tuple[Tensor, Tensor]:
        """(S, A, adds) and (S, A, removes) logits from `boxes` (S, A, 3, d) of the scenes `acting` (S, A, 3)."""
        cells, legal = (gather_boxes(cast("Tensor", part), acting) for part in (encodings.cells, encodings.legal))
        add_queries = self.wanted(boxes).unflatten(-1, (self.item_types, CELL_CHANNELS))
        add_legality = legal.gather(-1, self.footprints.expand(*legal.shape[:-1], -1))
        adds = cells @ add_queries.transpose(-1, -2) + self.look(boxes)[..., None, :] + add_legality
        removes = (cells @ self.wanted_remove(boxes)[..., None]).squeeze(-1) + legal[..., -1]
        return adds.flatten(2), removes.flatten(2)


class TowerHeads(nn.Module):
    """Argument heads for Tower: ADD of each colour, and REMOVE, for each box."""

    geometry = None  # no cells

    def __init__(self, width: int) -> None:
        super().__init__()
        self.out = nn.Linear(width, len(Colour) + 1)

    def encode_cells(self, items: Tensor, box: Tensor, inputs: Inputs) -> tuple[None, None]:
        """There are none."""
        return None, None

    def forward(self, boxes: Tensor, encodings: BoxEncodings, acting: Tensor) -> tuple[Tensor, Tensor]:
        """(S, A, adds) and (S, A, removes) logits from `boxes` (S, A, 3, d)."""
        logits = self.out(boxes)
        return logits[..., :-1].flatten(2), logits[..., -1]


HEADS: dict[str, type[ScatterHeads | TowerHeads]] = {"scatter": ScatterHeads, "tower": TowerHeads}


class ImitationNetwork(nn.Module):
    """Encodes boxes given a statement, then scenes; `HEADS` has the parts that an appearance's actions need."""

    def __init__(
        self,
        appearance: str,
        vocabulary: int,
        *,
        width: int = 128,
        heads: int = 4,
        text_layers: int = 2,
        item_layers: int = 2,
        dropout: float = 0.1,
    ) -> None:
        """`appearance`: of HEADS; `vocabulary`: its size."""
        super().__init__()
        self.text = TextEncoder(vocabulary, width, heads, text_layers, dropout)
        self.item = nn.Linear(FIXED_FEATURES, width)
        self.colour = nn.Embedding(len(Colour), width)
        self.item_layers = nn.ModuleList(ItemLayer(width, heads) for _ in range(item_layers))
        self.item_out = nn.Linear(width, width)
        self.empty_box = nn.Parameter(0.1 * torch.randn(width))
        self.box_reading = Attention(width, heads)
        self.box_feedforward = Feedforward(width)
        self.box_sum = nn.Linear(width, 2 * width)
        self.scene_in = nn.Linear(2 * width, width)
        self.scene_reading = Attention(width, heads)
        self.scene_feedforward = Feedforward(width)
        self.box_again = nn.Linear(width, width)
        self.scene_to_box = nn.Linear(width, width)
        self.again_sum = nn.Linear(width, width)
        self.scene_again = Feedforward(width)
        self.truth = nn.Linear(width, 1)
        self.target = nn.Embedding(2, width)
        self.act_box = nn.Linear(width, width)
        self.act_scene = nn.Linear(width, width)
        self.act_feedforward = Feedforward(width)
        self.types = nn.Linear(width, 2)
        self.steps = nn.Linear(width, MAX_STEPS)
        self.dropout = nn.Dropout(dropout)
        # The appearance's name is in the names of its saved parameters
        self._appearance = appearance
        self.add_module(appearance, part_of(appearance, "network for imitation", HEADS)(width))

    @property
    def heads(self) -> ScatterHeads | TowerHeads:
        """Those of the appearance."""
        return cast("ScatterHeads | TowerHeads", self.get_submodule(self._appearance))

    def forward(self, inputs: Inputs, targets: Tensor) -> Outputs:
        """`targets` (S, A) of the first A scenes of each statement: 1 to make it true, 0 false."""
        statements = self.encode_statements(inputs.words)
        return self.predict(statements, self.encode_boxes(inputs, statements), inputs.scenes, targets)

    def encode_statements(self, words: Tensor) -> StatementEncodings:
        """Encodes statements, given as (S, T) word indices."""
        mask = attention_mask(words)
        x = self.text(words)
        layers = (cast("ItemLayer", layer).reading for layer in self.item_layers)
        attentions = (*layers, self.box_reading, self.scene_reading)
        return StatementEncodings(tuple(attention.key_value(x) for attention in attentions), mask)

    def encode_boxes(self, inputs: Inputs, statements: StatementEncodings) -> BoxEncodings:
        """The boxes conditioned on their statements."""
        key_values, mask = statements
        items = self.item(inputs.features.to(key_values[0].dtype))
        x = items + self.colour(inputs.colours).to(items.dtype)
        for layer, key_value in zip(self.item_layers, key_values, strict=False):
            x = layer(x, key_value, mask, inputs)
        box = items_by_box(F.relu(self.item_out(x)), inputs.by_box).sum(1) + self.empty_box.to(x.dtype)
        box = box.unflatten(0, inputs.by_box.shape[:2])
        box = self.box_feedforward(self.box_reading(box, key_values[len(self.item_layers)], mask))
        terms = self.box_sum(box), self.box_again(box), self.act_box(box)
        return BoxEncodings(*terms, *self.heads.encode_cells(x, box, inputs))

    def predict(self, statements: StatementEncodings, boxes: BoxEncodings, scenes: Tensor, targets: Tensor) -> Outputs:
        """Outputs for `scenes` (S, N, 3), composed of the boxes; `targets` (S, A) as in `forward`."""
        scene = self.scene_in(F.relu(gather_boxes(boxes.scene_terms, scenes).sum(2)))
        scene = self.scene_feedforward(self.scene_reading(scene, statements.key_values[-1], statements.mask))
        refinement = gather_boxes(boxes.refinement_terms, scenes) + self.scene_to_box(scene)[:, :, None]
        scene = self.dropout(self.scene_again(scene + self.again_sum(F.relu(refinement).sum(2))))  # (S, N, d)
        truth = self.truth(scene).squeeze(-1)
        count = targets.shape[1]
        acting = scenes[:, :count]
        conditioned = scene[:, :count] + self.target(targets).to(scene.dtype)
        features = gather_boxes(boxes.action_terms, acting) + self.act_scene(conditioned)[:, :, None]
        features = self.act_feedforward(features)  # (S, A, 3, d) of each box given its scene and target
        adds, removes = self.heads(features, boxes, acting)
        whole = features.sum(2)
        outputs = Outputs(truth, self.types(whole), adds, removes, self.steps(whole), boxes.legal)
        return Outputs._make(None if output is None else output.float() for output in outputs)


def gather_boxes(vectors: Tensor, scenes: Tensor) -> Tensor:
    """(S, N, 3, ...) the vectors of each scene's boxes, from (S, U, ...) of all boxes."""
    flat = among_all(scenes, vectors.shape[1]).flatten()
    return vectors.flatten(0, 1).index_select(0, flat).unflatten(0, scenes.shape)
