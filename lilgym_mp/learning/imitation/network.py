"""The network: words and boxes in, the statement's truth and the policy's logits out.

Boxes are understood in the light of the statement, each pair of statement and box once, however many scenes share
it; a scene is then a sum over its three boxes, so their order makes no difference to its truth. The policy is STOP by
the truth and the target, else ADD or REMOVE, then the arguments that the type needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, cast

import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor, nn
from torch.nn.utils.rnn import pad_sequence

from lilgym_mp.learning.imitation.box_features import CELLS, FIXED_FEATURES, OFFSETS, RELATIONS
from lilgym_mp.scene import BOX_COUNT, FOOTPRINT_COUNT, Colour, Shape, Size

MAX_STEPS = 8  # the steps to go that the auxiliary head tells apart at most
RELATION_GATES = 8  # relations between items that a layer looks at
CELL_CHANNELS = 32  # of a cell's vector, against what a look asks for
CELL_HIDDEN = 64
GEOMETRY_CHANNELS = VALUE_CHANNELS = 16
MAX_WORDS = 64  # words; the rest is cut off
MIN_PADDED_WORDS = 16  # for the words of a batch of statements: torch is slow at softmax over fewer


class Inputs(NamedTuple):
    """S statements, each with U boxes of K items at most, M items in all at most, and N scenes made of those boxes.

    C items lie in those boxes, the first V of each statement, whose cells are asked for.
    """

    words: Tensor  # (S, T) word numbers, 0 for none
    features: Tensor  # (S, M, F) what is known of each item but its colour
    colours: Tensor  # (S, M)
    by_box: Tensor  # (S, U, K) where the box's items are among the S * M; S * M for none
    by_item: Tensor  # (S, M) where the item is among the S * U * K
    relations: Tensor  # (S, U, K, K) of each of a box's items to each
    cell_boxes: Tensor  # (S, V) of which only the shape matters
    cell_items: Tensor  # (C,) among the S * M
    cell_places: Tensor  # (C,) the item's box among the S * V
    offsets: Tensor  # (C, 2, 5) of items to cells
    scenes: Tensor  # (S, N, 3) the boxes of each scene, 0 to U - 1


class StatementEncodings(NamedTuple):
    """S statements as the parts of a network attend to them."""

    key_values: tuple[Tensor, ...]  # (S, T, 2 d) for each layer that attends to words
    mask: Tensor  # (S, 1, 1, T) what hides the places without a word, to be added to scores

    @classmethod
    def from_cache(cls, statements: Sequence[Sequence[Tensor]]) -> StatementEncodings:
        """Statements read before: the key-values of each without the places that have no word."""
        padded = [pad_sequence(list(parts), batch_first=True) for parts in zip(*statements, strict=True)]
        missing = max(0, MIN_PADDED_WORDS - padded[0].shape[1])
        key_values = tuple(F.pad(key_value, (0, 0, 0, missing)) for key_value in padded)
        lengths = torch.tensor([len(parts[0]) for parts in statements], device=key_values[0].device)
        places = torch.arange(key_values[0].shape[1], device=lengths.device)
        return cls(key_values, word_mask(places[None] < lengths[:, None]))


class Packing(NamedTuple):
    """How R rows without gaps stand for (S, N) places by statement, so that linear layers see no vacant ones."""

    padded: Tensor  # (S, N) the row in each place, 0 in vacant places
    places: Tensor  # (R,) where each row is among the S * N


class BoxEncodings(NamedTuple):
    """U boxes of each of S statements, V of them with their cells (Scatter)."""

    sums: Tensor  # (S, U, 2 d) what each box gives to a scene
    again: Tensor  # (S, U, d) and, once the scene is known, gives again
    acts: Tensor  # (S, U, d) and gives to what is to be done in it
    cells: Tensor | None  # (S, V, 25, C) what the cells are like
    legal: Tensor | None  # (S, V, 25, 10) logits of what is valid there: an ADD of each footprint, a REMOVE


class Outputs(NamedTuple):
    """What the network says of S x N scenes, and of the first A of each statement's scenes what to do there."""

    truth: Tensor  # (S, N) logit of the statement being true
    types: Tensor  # (S, A, 2) logits of ADD and REMOVE, given that it is not STOP
    adds: Tensor  # (S, A, adds)
    removes: Tensor  # (S, A, removes)
    steps: Tensor  # (S, A, MAX_STEPS) logits of how many actions are still to be taken
    legal: Tensor | None  # (S, V, 25, 10) logits of an ADD of each footprint and a REMOVE being valid


class Feedforward(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.up = nn.Linear(width, 2 * width)
        self.down = nn.Linear(2 * width, width)

    def forward(self, x: Tensor) -> Tensor:
        return x + self.down(F.relu(self.up(self.norm(x))))


class Attention(nn.Module):
    """Attention of anything to words."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.norm = nn.LayerNorm(width)
        self.query = nn.Linear(width, width)
        self.key_value = nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)

    def forward(self, x: Tensor, key_value: Tensor, mask: Tensor, packing: Packing | None = None) -> Tensor:
        """`x` (S, N, d), or (R, d) with `packing`; `key_value` (S, T, 2 d) what `self.key_value` makes of words, or
        that by heads (S, 2, heads, T, d / heads); `mask` as in `StatementEncodings`."""
        query = self.query(self.norm(x))
        if packing is not None:
            query = query.index_select(0, packing.padded.flatten()).unflatten(0, packing.padded.shape)
        batch, count, width = query.shape
        query = query.view(batch, count, self.heads, -1).transpose(1, 2)
        key, value = (self.by_heads(key_value) if key_value.dim() == 3 else key_value).unbind(1)
        scores = torch.matmul(query * (width // self.heads) ** -0.5, key.transpose(-1, -2)) + mask.to(query.dtype)
        found = torch.matmul(scores.softmax(-1).to(value.dtype), value)
        found = found.transpose(1, 2).reshape(batch, count, width)
        if packing is not None:
            found = found.flatten(0, 1).index_select(0, packing.places)
        return x + self.out(found)

    def by_heads(self, key_value: Tensor) -> Tensor:
        """(S, 2, heads, T, d / heads) from (S, T, 2 d)."""
        batch, places, width = key_value.shape
        return key_value.view(batch, places, 2, self.heads, width // (2 * self.heads)).permute(0, 2, 3, 1, 4)


class RelationLayer(nn.Module):
    """Sums over a box's items, weighted by where they lie from each item: sums, so that items can be counted."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.gates = nn.Embedding(RELATIONS, RELATION_GATES)
        self.value = nn.Linear(width, width)
        self.out = nn.Linear(width, width)

    def forward(self, x: Tensor, inputs: Inputs) -> Tensor:
        """`x` (S, M, d)."""
        value = in_boxes(F.relu(self.value(self.norm(x))), inputs.by_box)  # (P, K, d)
        pairs, items, width = value.shape
        gates = F.embedding(inputs.relations.flatten(0, 1), torch.sigmoid(self.gates.weight))
        gates = gates.permute(0, 3, 1, 2).to(value.dtype)  # (P, G, K, K)
        found = gates @ value.view(pairs, items, RELATION_GATES, -1).transpose(1, 2)
        found = found.transpose(1, 2).reshape(pairs * items, width)
        return x + self.out(found.index_select(0, inputs.by_item.flatten()).view(x.shape))


def in_boxes(x: Tensor, by_box: Tensor) -> Tensor:
    """(P, K, d) the items of each box, zero where there is none, from (S, M, d)."""
    padded = F.pad(x.flatten(0, 1), (0, 0, 0, 1))
    return padded.index_select(0, by_box.flatten()).view(-1, by_box.shape[-1], x.shape[-1])


class ItemLayer(nn.Module):
    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.reading = Attention(width, heads)
        self.relating = RelationLayer(width)
        self.feedforward = Feedforward(width)

    def forward(self, x: Tensor, key_value: Tensor, mask: Tensor, inputs: Inputs) -> Tensor:
        """`x` (S, M, d)."""
        return self.feedforward(self.relating(self.reading(x, key_value, mask), inputs))


def word_mask(words: Tensor) -> Tensor:
    """(S, 1, 1, T) what hides the places without a word, to be added to scores; `words` (S, T)."""
    return torch.zeros(words.shape, device=words.device).masked_fill_(words == 0, -1e4)[:, None, None]


class TextLayer(nn.Module):
    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.attention = Attention(width, heads)
        self.feedforward = Feedforward(width)

    def forward(self, x: Tensor, mask: Tensor) -> Tensor:
        return self.feedforward(self.attention(x, self.attention.key_value(self.attention.norm(x)), mask))


class TextEncoder(nn.Module):
    def __init__(self, vocabulary: int, width: int, heads: int, layers: int, dropout: float) -> None:
        super().__init__()
        self.words = nn.Embedding(vocabulary, width, padding_idx=0)
        self.places = nn.Parameter(0.02 * torch.randn(MAX_WORDS, width))
        self.dropout = nn.Dropout(dropout)
        self.layers = nn.ModuleList(TextLayer(width, heads) for _ in range(layers))
        self.norm = nn.LayerNorm(width)
        nn.init.normal_(self.words.weight, std=0.3)

    def forward(self, words: Tensor) -> Tensor:
        """(S, T) word numbers to (S, T, d)."""
        mask = word_mask(words)
        x = self.dropout(self.words(words) + self.places[: words.shape[1]])
        if torch.is_autocast_enabled(x.device.type):
            x = x.to(torch.get_autocast_dtype(x.device.type))
        for layer in self.layers:
            x = self.dropout(layer(x, mask))
        return self.norm(x)


class CellGeometry(nn.Module):
    """What lies where in a box, cell by cell, and what may be done there; no matter what the statement says."""

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

    def of_items(self, offsets: Tensor) -> Tensor:
        """(..., 25, C) what items do to the cells, from their `offsets` (..., 2, 5)."""
        across, down = self.across(offsets[..., 0, :]), self.down(offsets[..., 1, :])
        return (across[..., :, None, :] * down[..., None, :, :]).flatten(-3, -2)

    def forward(self, sums: Tensor) -> tuple[Tensor, Tensor]:
        """(..., 25, H) what the cells are like, (..., 25, 10) logits of what is valid there, from the sums over items
        (..., 25, C)."""
        with torch.autocast(sums.device.type, enabled=False):
            hidden = F.relu(self.mix(sums + self.cells))
            return hidden, self.legal(hidden)


class ScatterHeads(nn.Module):
    """Arguments for Scatter: a cell's vector, made of where items lie from it, against what a look asks for."""

    footprints: Tensor  # (27,) the footprint of each item type
    offered_footprints: Tensor  # (28,) that, and REMOVE's place after the footprints

    def __init__(self, width: int) -> None:
        super().__init__()
        self.item_types = len(Shape) * len(Colour) * len(Size)
        self.geometry = CellGeometry()
        self.across = nn.Embedding(1 + FOOTPRINT_COUNT * OFFSETS, VALUE_CHANNELS, padding_idx=0)
        self.down = nn.Embedding(1 + FOOTPRINT_COUNT * OFFSETS, VALUE_CHANNELS, padding_idx=0)
        self.value = nn.Linear(width, VALUE_CHANNELS)
        self.mix = nn.Linear(VALUE_CHANNELS + CELL_HIDDEN, CELL_HIDDEN)
        self.box = nn.Linear(width, CELL_HIDDEN)
        self.out = nn.Linear(CELL_HIDDEN, CELL_CHANNELS)
        self.wanted = nn.Linear(width, self.item_types * CELL_CHANNELS)
        self.wanted_remove = nn.Linear(width, CELL_CHANNELS)
        self.look = nn.Linear(width, self.item_types)
        footprints = [shape * len(Size) + size for shape in Shape for _ in Colour for size in Size]
        self.register_buffer("footprints", torch.tensor(footprints), persistent=False)
        self.register_buffer("offered_footprints", torch.tensor([*footprints, FOOTPRINT_COUNT]), persistent=False)

    def cell_vectors(self, items: Tensor, box: Tensor, inputs: Inputs) -> tuple[Tensor, Tensor]:
        """(S, V, 25, C) what the cells are like, (S, V, 25, 10) logits of what is valid there."""
        statements, boxes = inputs.cell_boxes.shape
        across, down = (
            embedding(inputs.offsets[:, axis]) for axis, embedding in enumerate((self.across, self.down))
        )  # (items, 5, C)
        value = self.value(items.flatten(0, 1).index_select(0, inputs.cell_items)).float()[:, None]
        each = ((across * value)[:, :, None] * down[:, None]).flatten(1, 2)  # (items, 25, C)
        each = torch.cat([self.geometry.of_items(inputs.offsets), each], -1)
        cells = each.new_zeros(statements * boxes, CELLS**2, each.shape[-1])
        cells = cells.index_add(0, inputs.cell_places, each).unflatten(0, (statements, boxes))
        places, legal = self.geometry(cells[..., :GEOMETRY_CHANNELS])
        found = torch.cat([cells[..., GEOMETRY_CHANNELS:], places], -1)
        hidden = F.relu(self.mix(found) + self.box(box[:, :boxes])[..., None, :])
        return self.out(hidden), legal

    def joined(self) -> tuple[Tensor, Tensor]:
        """Weights and biases (28 (C + 1), d), (28 (C + 1),) of all that the looks and, after them, REMOVE ask of cells
        in one linear layer: C channels, and what is the same in every cell."""

        def rows(wanted: Tensor, look: Tensor, remove: Tensor) -> Tensor:
            asked = torch.cat([wanted.unflatten(0, (self.item_types, CELL_CHANNELS)), look[:, None]], 1).flatten(0, 1)
            return torch.cat([asked, remove, torch.zeros_like(remove[:1])])

        layers = self.wanted, self.look, self.wanted_remove
        weights, biases = [layer.weight for layer in layers], [layer.bias for layer in layers]
        return rows(*weights), rows(*biases)

    def offered(self, cells: Tensor, legal: Tensor) -> tuple[Tensor, Tensor]:
        """(..., 25, C + 1), (..., 25, 28) what `of_offered` wants to know of cells."""
        return torch.cat([cells, torch.ones_like(cells[..., :1])], -1), legal.index_select(-1, self.offered_footprints)

    def of_offered(
        self, boxes: Tensor, cells: Tensor, legal: Tensor, joined: tuple[Tensor, Tensor]
    ) -> tuple[Tensor, Tensor]:
        """What `forward` gives, in fewer operations, from `joined` and what `offered` gives; may overwrite `legal`."""
        asked = F.linear(boxes, *joined).view(-1, self.item_types + 1, CELL_CHANNELS + 1)
        valid, cells, asked = legal.flatten(0, 2), cells.flatten(0, 2), asked.transpose(1, 2)
        found = valid.baddbmm_(cells, asked) if asked.dtype == valid.dtype else valid + cells @ asked
        found = found.view(legal.shape)
        return found[..., :-1].flatten(2), found[..., -1].flatten(2)

    def forward(self, boxes: Tensor, cells: Tensor, legal: Tensor) -> tuple[Tensor, Tensor]:
        """(S, A, adds), (S, A, removes) logits from `boxes` (S, A, 3, d), `cells` (S, A, 3, 25, C), `legal`."""
        wanted = self.wanted(boxes).unflatten(-1, (self.item_types, CELL_CHANNELS))
        of_footprints = legal.gather(-1, self.footprints.expand(*legal.shape[:-1], -1))
        adds = cells @ wanted.transpose(-1, -2) + self.look(boxes)[..., None, :] + of_footprints
        removes = (cells @ self.wanted_remove(boxes)[..., None]).squeeze(-1) + legal[..., -1]
        return adds.flatten(2), removes.flatten(2)


class TowerHeads(nn.Module):
    """Arguments for Tower: a colour to add, or the top block to remove, of each box."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.out = nn.Linear(width, len(Colour) + 1)

    def forward(self, boxes: Tensor) -> tuple[Tensor, Tensor]:
        found = self.out(boxes)
        return found[..., :-1].flatten(2), found[..., -1]


class ImitationNetwork(nn.Module):
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
        """`appearance`: "tower" or "scatter"; `vocabulary`: how many word numbers there are."""
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
        self.scatter = ScatterHeads(width) if appearance == "scatter" else None
        self.tower = TowerHeads(width) if appearance == "tower" else None

    def forward(self, inputs: Inputs, targets: Tensor) -> Outputs:
        """`targets` (S, A) of the first A scenes of each statement: 1 to make it true, 0 false."""
        read = self.read(inputs.words)
        return self.judged(read, self.boxes_read(inputs, read), inputs.scenes, targets)

    def read(self, words: Tensor) -> StatementEncodings:
        """(S, T) words, read."""
        mask = word_mask(words)
        x = self.text(words)
        layers = (cast("ItemLayer", layer).reading for layer in self.item_layers)
        readers = (*layers, self.box_reading, self.scene_reading)
        return StatementEncodings(tuple(reader.key_value(x) for reader in readers), mask)

    def boxes_read(self, inputs: Inputs, read: StatementEncodings) -> BoxEncodings:
        """The boxes in the light of the words; those whose cells are asked for come first."""
        known = self.item(inputs.features.to(read.key_values[0].dtype))
        x = known + self.colour(inputs.colours).to(known.dtype)
        for layer, key_value in zip(self.item_layers, read.key_values, strict=False):
            x = layer(x, key_value, read.mask, inputs)
        box = in_boxes(F.relu(self.item_out(x)), inputs.by_box).sum(1) + self.empty_box.to(x.dtype)
        box = box.unflatten(0, inputs.by_box.shape[:2])
        box = self.box_feedforward(self.box_reading(box, read.key_values[len(self.item_layers)], read.mask))
        given = self.box_sum(box), self.box_again(box), self.act_box(box)
        if self.scatter is None:
            return BoxEncodings(*given, None, None)
        return BoxEncodings(*given, *self.scatter.cell_vectors(x, box, inputs))

    def judged(self, read: StatementEncodings, boxes: BoxEncodings, scenes: Tensor, targets: Tensor) -> Outputs:
        """What the network says of `scenes` (S, N, 3), made of the boxes; `targets` (S, A) as in `forward`."""
        scene, truth = self.understood(chosen(boxes.sums, scenes), chosen(boxes.again, scenes), read)
        acting = scenes[:, : targets.shape[1]]
        each = self.to_act(scene[:, : targets.shape[1]], chosen(boxes.acts, acting), targets)
        if self.scatter is not None:
            assert boxes.cells is not None
            assert boxes.legal is not None
            heads = self.scatter(each, chosen(boxes.cells, acting), chosen(boxes.legal, acting))
        else:
            assert self.tower is not None
            heads = self.tower(each)
        outputs = self.outputs(truth, each, heads)
        return outputs if boxes.legal is None else outputs._replace(legal=boxes.legal.float())

    def outputs(self, truth: Tensor, each: Tensor, heads: tuple[Tensor, Tensor]) -> Outputs:
        """What is said of (S, N) scenes, from `each` (S, A, 3, d) of their boxes and the logits of ADDs and REMOVEs."""
        whole, (adds, removes) = each.sum(2), heads
        return Outputs(
            truth.float(),
            self.types(whole).float(),
            adds.float(),
            removes.float(),
            self.steps(whole).float(),
            None,
        )

    def understood(self, sums: Tensor, again: Tensor, read: StatementEncodings) -> tuple[Tensor, Tensor]:
        """(S, N, d) scenes and (S, N) the logits of their truth, from what their boxes give: `sums` (S, N, 3, 2 d) and
        `again` (S, N, 3, d)."""
        scene = self.scene_in(F.relu(sums.sum(2)))
        scene = self.scene_feedforward(self.scene_reading(scene, read.key_values[-1], read.mask))
        scene = scene + self.again_sum(F.relu(again + self.scene_to_box(scene)[:, :, None]).sum(2))
        scene = self.dropout(self.scene_again(scene))
        return scene, self.truth(scene).squeeze(-1)

    def to_act(self, scene: Tensor, acts: Tensor, targets: Tensor) -> Tensor:
        """(S, A, 3, d) the boxes of each scene (S, A, d) under its target, from what they give: `acts` (S, A, 3, d)."""
        seen = scene + self.target(targets).to(scene.dtype)
        return self.act_feedforward(acts + self.act_scene(seen)[:, :, None])


def chosen(vectors: Tensor, scenes: Tensor) -> Tensor:
    """(S, N, 3, ...) the vectors of each scene's boxes, from (S, U, ...) those of all boxes."""
    statements, boxes = vectors.shape[:2]
    first = torch.arange(statements, device=scenes.device)[:, None, None] * boxes
    flat = (scenes + first).flatten()
    return vectors.flatten(0, 1).index_select(0, flat).unflatten(0, scenes.shape)


assert BOX_COUNT == 3
