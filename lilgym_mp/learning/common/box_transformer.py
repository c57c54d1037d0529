"""The model `ours`: boxes encoded from pixels, conditioned on the statement by attention, and summed to a scene.

Box encodings are computed once per distinct box, conditioned encodings once per distinct statement-box pair, however
many states of a batch share them. Nothing is pretrained.

Module attributes are the keys of saved parameters, so renaming one breaks model files.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import prod
from typing import Any, NamedTuple

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor, nn

from lilgym_mp.corpus import Vocabulary
from lilgym_mp.corpus.tokens import UNKNOWN
from lilgym_mp.learning.common.attention import (
    MAX_WORDS,
    MIN_PADDED_WORDS,
    Attention,
    Feedforward,
    Packing,
    StatementEncodings,
    TextEncoder,
    attention_mask,
)
from lilgym_mp.learning.common.factored_policy import joint_factorisation
from lilgym_mp.learning.common.model import Model, Prediction
from lilgym_mp.learning.common.states import PATCH_BYTES, PATCHES, States, distinct
from lilgym_mp.scene import BOX_COUNT, Colour
from lilgym_mp.scene.actions import ActionType
from lilgym_mp.scene.appearances import Appearance
from lilgym_mp.scene.appearances.places import Boxes, Cells, places_of
from lilgym_mp.scene.appearances.scatter.actions import ITEM_TYPES
from lilgym_mp.scene.arrays import AnyMapping, Int64Array, Strings

CHANNELS = 32  # channels of a patch
MIDDLE_GREY = 127.5
HALF_RANGE = 127.5
CHUNK = 256  # states per pass through the cell head, to stay in the CPU cache
SMALL_GAIN = 0.01  # gain of the last layers, so that training starts from a nearly uniform policy
MAX_CACHED = 20_000  # statements, and boxes; 8,192 boxes take 30 MB


class EncodedBoxes(NamedTuple):
    """U distinct boxes, independent of statements."""

    vectors: Tensor  # (U, d)
    patches: Tensor  # (U, 5, 5, C)


class EncodedStates(NamedTuple):
    """N states of R distinct statement-box pairs and U distinct boxes."""

    scenes: Tensor  # (N, d) independent of the target
    targets: Tensor  # (N,)
    pairs: Tensor  # (R, d)
    pairs_of: Tensor  # (N, 3)
    patches: Tensor  # (U, 5, 5, C)
    boxes_of: Tensor  # (N, 3)

    def rows(self, rows: Tensor) -> EncodedStates:
        """Some of the states, possibly repeated."""
        return self._replace(
            scenes=self.scenes.index_select(0, rows),
            targets=self.targets[rows],
            pairs_of=self.pairs_of[rows],
            boxes_of=self.boxes_of[rows],
        )


class BoxTransformer(Model):
    """Trained from scratch on images and words; about 0.85 million parameters."""

    def __init__(
        self,
        appearance: Appearance,
        vocabulary: Vocabulary,
        *,
        width: int = 112,
        heads: int = 4,
        text_layers: int = 2,
        pair_layers: int = 2,
        separators: bool = False,
    ) -> None:
        """`separators`: also take actions on Scatter's separators."""
        super().__init__()
        self.vocabulary = vocabulary
        self.sizes = {"width": width, "heads": heads, "text_layers": text_layers, "pair_layers": pair_layers}
        self.factorisation = joint_factorisation(appearance, separators=separators)
        places = places_of(appearance.grid)
        place_count = self.factorisation.heads[1].size
        self.restriction = "no actions on separators" if place_count < prod(places.counts) else ""
        self.text = TextEncoder(len(vocabulary), width, heads, text_layers, dropout=0.0)
        self.boxes = BoxEncoder(width, CHANNELS)
        self.readings = nn.ModuleList(Attention(width, heads) for _ in range(pair_layers))
        self.feedforwards = nn.ModuleList(Feedforward(width) for _ in range(pair_layers))
        self.part = nn.Linear(width, width)
        self.part_place = nn.Parameter(0.02 * torch.randn(BOX_COUNT, width))
        self.scene_in = nn.Linear(width, width)
        self.scene_reading = Attention(width, heads)
        self.scene_feedforward = Feedforward(width)
        self.truth = nn.Linear(width, 1)
        self.target = nn.Embedding(2, width)
        self.judge = Feedforward(width)
        self.types = nn.Linear(width, len(ActionType))
        self.value = nn.Linear(width, 1)
        self.act_box = nn.Linear(width, width)
        self.act_scene = nn.Linear(width, width)
        self.act_feedforward = Feedforward(width)
        self.arguments = ARGUMENTS[type(places)](places, width, place_count)
        for layer in (self.types, self.truth):
            nn.init.orthogonal_(layer.weight, SMALL_GAIN)
            nn.init.zeros_(layer.bias)
        self._cached_statements: dict[str, list[Tensor]] = {}
        self._cached_boxes: dict[int, tuple[Tensor, Tensor]] = {}  # by hash: vector and patches

    def details(self) -> AnyMapping:
        return {"words": list(self.vocabulary.words), "sizes": self.sizes}

    def clear_cache(self) -> None:
        self._cached_statements.clear()
        self._cached_boxes.clear()

    def forward(self, states: States) -> Prediction:
        encoded = self.encode(states)
        return self.decide(encoded, self.target(encoded.targets))

    def encode(self, states: States) -> EncodedStates:
        """Encodes states as far as the target does not matter."""
        device = self.value.weight.device
        statements = self._encode_statements(states.statements)
        boxes = self._encode_boxes(states)
        count = len(states.statements)
        box_count = len(states.box_hashes)
        codes, pair_of = np.unique(states.statement_of[:, None] * box_count + states.boxes_of, return_inverse=True)
        owners, box_of = np.divmod(codes, box_count)  # (R,) statement and box of each distinct pair
        packing = _packing(owners, count, device)
        pairs_of = torch.from_numpy(pair_of.reshape(-1, BOX_COUNT)).to(device)
        pairs = boxes.vectors.index_select(0, torch.from_numpy(box_of).to(device))  # (R, d)
        layers = zip(statements.key_values, self.readings, self.feedforwards, strict=False)
        for key_value, attention, feedforward in layers:
            pairs = feedforward(attention(pairs, key_value, statements.mask, packing))
        scenes = self._encode_scenes(pairs, pairs_of, statements, _packing(states.statement_of, count, device))
        boxes_of, targets = (torch.from_numpy(array).to(device) for array in (states.boxes_of, states.targets))
        return EncodedStates(scenes, targets, pairs, pairs_of, boxes.patches, boxes_of)

    def decide(self, encoded: EncodedStates, condition: Tensor) -> Prediction:
        """Logits and values of N states; `condition` (N, d) embeds the target and whatever else is known."""
        conditioned = self.judge(encoded.scenes + condition)
        features = self.box_features(encoded, conditioned)
        types = self.types(conditioned)
        types = torch.cat([types[:, :1] + self.reached(encoded)[:, None], types[:, 1:]], 1)
        adds, removes = self.arguments(features, encoded.patches, encoded.boxes_of)
        return Prediction(
            types.float(), (adds.float(), removes.float()), torch.tanh(self.value(conditioned).float()).squeeze(1)
        )

    def box_features(self, encoded: EncodedStates, conditioned: Tensor) -> Tensor:
        """(N, 3, d) of each box, given the whole state (N, d)."""
        features = _gather(self.act_box(encoded.pairs), encoded.pairs_of) + self.act_scene(conditioned)[:, None]
        return self.act_feedforward(features)

    def reached(self, encoded: EncodedStates) -> Tensor:
        """(N,) logits of the target being reached, a part of STOP's: the statement's truth does not see the target."""
        return self.truth(encoded.scenes).squeeze(1) * (2 * encoded.targets - 1)

    def _encode_scenes(
        self, pairs: Tensor, pairs_of: Tensor, statements: StatementEncodings, packing: Packing
    ) -> Tensor:
        """(N, d) scene vectors from statement-box pairs (R, d) and each scene's three pairs (N, 3)."""
        parts = _gather(self.part(pairs), pairs_of)
        whole = self.scene_in(F.relu(parts + self.part_place).sum(1))
        return self.scene_feedforward(self.scene_reading(whole, statements.key_values[-1], statements.mask, packing))

    def _encode_boxes(self, states: States) -> EncodedBoxes:
        """The boxes encoded; without gradients, encodings are cached until `clear_cache`."""
        device = self.value.weight.device
        if torch.is_grad_enabled():
            return self.boxes(*(torch.from_numpy(part).to(device) for part in (states.patches, states.patches_of)))
        if len(self._cached_boxes) > MAX_CACHED:
            self.clear_cache()
        hashes = states.box_hashes.tolist()
        new = [position for position, box_hash in enumerate(hashes) if box_hash not in self._cached_boxes]
        if new:
            used, patches_of = distinct(states.patches_of[new], len(states.patches))
            encoded = self.boxes(*(torch.from_numpy(part).to(device) for part in (states.patches[used], patches_of)))
            rows = zip(encoded.vectors, encoded.patches, strict=True)
            self._cached_boxes.update(zip([hashes[position] for position in new], rows, strict=True))
        columns = zip(*[self._cached_boxes[box_hash] for box_hash in hashes], strict=True)
        return EncodedBoxes(*map(torch.stack, columns))

    def _encode_statements(self, statements: Strings) -> StatementEncodings:
        """The statements encoded; without gradients, encodings are cached until `clear_cache`."""
        if torch.is_grad_enabled():
            return self._compute_statements(statements)
        if len(self._cached_statements) > MAX_CACHED:
            self.clear_cache()
        new = tuple(one for one in statements if one not in self._cached_statements)
        if new:
            encodings = self._compute_statements(new)
            for row, statement in enumerate(new):
                count = int((encodings.mask[row, 0, 0] == 0).sum())
                self._cached_statements[statement] = [key_value[row, :count] for key_value in encodings.key_values]
        return StatementEncodings.from_cache([self._cached_statements[one] for one in statements])

    def _compute_statements(self, statements: Strings) -> StatementEncodings:
        rows = [self.vocabulary.encode(one, MAX_WORDS) for one in statements]
        words = np.stack(rows)
        words = words[:, : max(MIN_PADDED_WORDS, int((words != 0).sum(1).max()))]
        words[:, 0] = np.maximum(words[:, 0], UNKNOWN)  # an empty statement becomes one unknown word
        indices = torch.from_numpy(words).to(self.value.weight.device)
        mask = attention_mask(indices)
        x = self.text(indices)
        attentions = (*self.readings, self.scene_reading)
        return StatementEncodings(tuple(attention.key_value(x) for attention in attentions), mask)  # pyright: ignore[reportCallIssue, reportAttributeAccessIssue]


def _packing(owners: Int64Array, statements: int, device: torch.device) -> Packing:
    """Rows (R,) grouped by the statements that own them, in order, and padded to as many rows of each."""
    rows = np.arange(len(owners))
    order = np.argsort(owners, kind="stable")
    counts = np.bincount(owners, minlength=statements)
    firsts = counts.cumsum() - counts
    most = int(counts.max())
    positions = np.empty(len(order), np.int64)
    positions[order] = owners[order] * most + rows - firsts[owners[order]]
    padded = np.zeros(statements * most, np.int64)
    padded[positions] = rows
    grouped = torch.from_numpy(padded.reshape(statements, most))
    return Packing(grouped.to(device), torch.from_numpy(positions).to(device))


def _gather(rows: Tensor, indices: Tensor) -> Tensor:
    """(N, 3, d) from (R, d) rows and (N, 3) indices."""
    return rows.index_select(0, indices.flatten()).unflatten(0, indices.shape)


class BoxEncoder(nn.Module):
    """Encodes each distinct patch, then each box as a vector and 5 x 5 patch features."""

    def __init__(self, width: int, channels: int) -> None:
        super().__init__()
        self.patch = nn.Linear(PATCH_BYTES, channels)
        self.around = nn.Conv2d(channels, channels, 3, padding=1)
        self.whole = nn.Linear(PATCHES**2 * channels, width)
        self.feedforward = Feedforward(width)

    def forward(self, patches: Tensor, patches_of: Tensor) -> EncodedBoxes:
        """Encodes U boxes, given as distinct patches (Q, 300) uint8 and patch indices (U, 25)."""
        pixels = patches.float().sub_(MIDDLE_GREY).div_(HALF_RANGE)
        encoded = F.embedding(patches_of.unflatten(1, (PATCHES, PATCHES)), F.relu(self.patch(pixels)))  # (U, 5, 5, C)
        encoded = encoded + F.relu(self.around(encoded.permute(0, 3, 1, 2)).permute(0, 2, 3, 1))
        return EncodedBoxes(self.feedforward(self.whole(encoded.flatten(1))), encoded)


class BoxArguments(nn.Module):
    """Argument head for edits of boxes, as in Tower: ADD of each colour, and REMOVE, for each box."""

    def __init__(self, places: Boxes, width: int, boxes: int) -> None:
        super().__init__()
        self.out = nn.Linear(width, len(Colour) + 1)
        nn.init.orthogonal_(self.out.weight, SMALL_GAIN)

    def forward(self, features: Tensor, patches: Tensor, boxes_of: Tensor) -> tuple[Tensor, Tensor]:
        """(N, 3 * 3) ADD and (N, 3) REMOVE logits from `features` (N, 3, d)."""
        logits = self.out(features)
        return logits[..., :-1].flatten(1), logits[..., -1]


class CellArguments(nn.Module):
    """Argument head for edits of cells, as in Scatter: ADD of each item type, and REMOVE, for each cell."""

    CELL = 32

    def __init__(self, places: Cells, width: int, cells: int) -> None:
        """`cells`: of the three boxes, or also of the separators."""
        super().__init__()
        self.rows, self.columns = places.box_shape
        self.seen = nn.Linear(CHANNELS, self.CELL)
        self.place = nn.Parameter(0.02 * torch.randn(self.rows * self.columns, self.CELL))
        self.box = nn.Linear(width, self.CELL)
        self.cell = nn.Linear(self.CELL, self.CELL)
        self.add = nn.Linear(self.CELL, len(ITEM_TYPES))
        self.wanted = nn.Linear(width, len(ITEM_TYPES))
        self.remove = nn.Linear(self.CELL, 1)
        self.cell_of_box = nn.Linear(width, self.CELL)
        self.on_separators = cells - BOX_COUNT * self.rows * self.columns
        self.separators = nn.Linear(width, self.on_separators * (1 + len(ITEM_TYPES))) if self.on_separators else None
        for layer in (self.add, self.wanted, self.remove):
            nn.init.orthogonal_(layer.weight, SMALL_GAIN)

    def forward(self, features: Tensor, patches: Tensor, boxes_of: Tensor) -> tuple[Tensor, Tensor]:
        """(N, 3 * cells * 27) ADD and (N, 3 * cells) REMOVE logits, and if wanted those on separators after them.

        From each state's box features given statement and target (N, 3, d), patch features of U distinct boxes
        (U, 5, 5, C), and the box indices of the states (N, 3).
        """
        local = self.seen(patches)
        if (self.rows, self.columns) != (PATCHES, PATCHES):
            local = F.interpolate(local.permute(0, 3, 1, 2), size=(self.rows, self.columns), mode="nearest")
            local = local.permute(0, 2, 3, 1)
        local = local.flatten(1, 2) + self.place
        chunks = zip(features.split(CHUNK), boxes_of.split(CHUNK), strict=True)
        parts = [self._chunk_logits(local, *chunk) for chunk in chunks]
        adds, removes = (torch.cat(logits) for logits in zip(*parts, strict=True))
        if self.separators is None:
            return adds, removes
        more = self.separators(features.mean(1)).tensor_split((self.on_separators,), 1)
        return torch.cat([adds, more[1]], 1), torch.cat([removes, more[0]], 1)

    def _chunk_logits(self, local: Tensor, features: Tensor, boxes_of: Tensor) -> tuple[Tensor, Tensor]:
        """The logits of some states; `local` (U, cells, 32)."""
        cells = local.index_select(0, boxes_of.flatten()).unflatten(0, boxes_of.shape)
        hidden = F.relu(cells + self.box(features)[:, :, None])
        hidden = F.relu(self.cell(hidden)) * self.cell_of_box(features)[:, :, None]  # (N, 3, cells, 32)
        adds = self.add(hidden) + self.wanted(features)[:, :, None]
        return adds.flatten(1), self.remove(hidden).flatten(1)


# By what edits name
ARGUMENTS: Mapping[type, Callable[[Any, int, int], nn.Module]] = {Boxes: BoxArguments, Cells: CellArguments}
