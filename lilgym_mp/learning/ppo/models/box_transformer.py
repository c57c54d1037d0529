"""Our network: boxes read from pixels, understood in the light of the statement, and put together to a scene.

Whatever depends on a box alone is calculated once for each distinct box, whatever depends on a statement and a box
once for each such pair, however many states of a batch share them; a state then costs little. Nothing is pretrained.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor, nn

from lilgym_mp.actions import ActionType
from lilgym_mp.appearances import Appearance, Scatter
from lilgym_mp.appearances.numbering import ITEM_TYPES
from lilgym_mp.corpus import Vocabulary
from lilgym_mp.corpus.tokens import UNKNOWN
from lilgym_mp.learning.imitation.network import (
    MAX_WORDS,
    MIN_PADDED_WORDS,
    Attention,
    Feedforward,
    Packing,
    StatementEncodings,
    TextEncoder,
    attention_mask,
)
from lilgym_mp.learning.ppo.factored_policy import box_cells, joint_factorisation
from lilgym_mp.learning.ppo.models.grouping import GroupedRows, group_by_statement
from lilgym_mp.learning.ppo.models.protocol import Model, Prediction
from lilgym_mp.learning.ppo.states import PATCH_BYTES, PATCHES, States, distinct
from lilgym_mp.scene import BOX_COUNT, Colour

CHANNELS = 32  # features of a patch
MIDDLE_GREY, HALF_RANGE = 127.5, 127.5
CHUNK = 256  # states whose cells are calculated at once, so that they stay in the processor's cache
SMALL_GAIN = 0.01  # of the last layers, so that learning starts from a nearly uniform policy
MOST_REMEMBERED = 20_000  # statements; and boxes, of which 8,192 take 30 MB


class Boxes(NamedTuple):
    """U distinct boxes, without any statement."""

    vectors: Tensor  # (U, d)
    patches: Tensor  # (U, 5, 5, C)


class BoxTransformer(Model):
    """Images and words in, nothing pretrained: about 0.85 million parameters."""

    def __init__(
        self,
        appearance: Appearance,
        vocabulary: Vocabulary,
        *,
        width: int = 112,
        heads: int = 4,
        text_layers: int = 2,
        pair_layers: int = 2,
    ) -> None:
        super().__init__()
        self.vocabulary = vocabulary
        self.sizes = {"width": width, "heads": heads, "text_layers": text_layers, "pair_layers": pair_layers}
        self.factorisation = joint_factorisation(appearance)
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
        self.arguments = (
            ScatterArguments(appearance, width) if isinstance(appearance, Scatter) else TowerArguments(width)
        )
        for layer in (self.types, self.truth):
            nn.init.orthogonal_(layer.weight, SMALL_GAIN)
            nn.init.zeros_(layer.bias)
        self._remembered: dict[str, list[Tensor]] = {}
        self._box_rows: dict[int, int] = {}  # of the boxes remembered, by code
        self._box_bank: Boxes | None = None  # their rows, and room for more

    def details(self) -> Mapping[str, Any]:
        return {"words": list(self.vocabulary.words), "sizes": self.sizes}

    def clear_cache(self) -> None:
        self._remembered.clear()
        self._box_rows.clear()
        self._box_bank = None

    def forward(self, states: States) -> Prediction:
        device = self.value.weight.device
        read = self._read(states.statements)
        boxes = self._encoded(states)
        groups = group_by_statement(states)
        of_pairs, pairs_of = (torch.from_numpy(array).to(device) for array in (groups.boxes, groups.pairs_of))
        packing = _packing(groups.pairs, device)
        targets = torch.from_numpy(states.targets).to(device)
        pairs = boxes.vectors.index_select(0, of_pairs)  # (R, d)
        for key_value, reading, feedforward in zip(read.key_values, self.readings, self.feedforwards, strict=False):
            pairs = feedforward(reading(pairs, key_value, read.mask, packing))
        scene = self._scenes(pairs, pairs_of, read, _packing(groups.states, device))  # (N, d)
        judged = self.judge(scene + self.target(targets))
        acting = _chosen(self.act_box(pairs), pairs_of) + self.act_scene(judged)[:, None]
        acting = self.act_feedforward(acting)  # (N, 3, d)
        types = self.types(judged)
        reached = self.truth(scene).squeeze(1) * (2 * targets - 1)
        types = torch.cat([types[:, :1] + reached[:, None], types[:, 1:]], 1)
        adds, removes = self.arguments(acting, boxes.patches, torch.from_numpy(states.boxes_of).to(device))
        return Prediction(
            types.float(), (adds.float(), removes.float()), torch.tanh(self.value(judged).float()).squeeze(1)
        )

    def _scenes(self, pairs: Tensor, pairs_of: Tensor, read: StatementEncodings, packing: Packing) -> Tensor:
        """(N, d) of N scenes, each of three of the pairs (R, d)."""
        parts = _chosen(self.part(pairs), pairs_of)
        whole = self.scene_in(F.relu(parts + self.part_place).sum(1))
        return self.scene_feedforward(self.scene_reading(whole, read.key_values[-1], read.mask, packing))

    def _encoded(self, states: States) -> Boxes:
        """The boxes encoded; without gradients each is encoded once and remembered until `clear_cache`."""
        device = self.value.weight.device
        if torch.is_grad_enabled():
            return self.boxes(*(torch.from_numpy(part).to(device) for part in (states.patches, states.patches_of)))
        if len(self._box_rows) > MOST_REMEMBERED:
            self.clear_cache()
        codes = states.box_codes.tolist()
        new = [place for place, code in enumerate(codes) if code not in self._box_rows]
        if new:
            used, patches_of = distinct(states.patches_of[new], len(states.patches))
            encoded = self.boxes(*(torch.from_numpy(part).to(device) for part in (states.patches[used], patches_of)))
            first, last = len(self._box_rows), len(self._box_rows) + len(new)
            self._box_bank = bank = _roomy(self._box_bank, last, encoded)
            for part, found in zip(bank, encoded, strict=True):
                part[first:last] = found
            self._box_rows.update(zip([codes[place] for place in new], range(first, last), strict=True))
        assert self._box_bank is not None
        rows = torch.tensor([self._box_rows[code] for code in codes], device=device)
        return Boxes(*(part.index_select(0, rows) for part in self._box_bank))

    def _read(self, statements: tuple[str, ...]) -> StatementEncodings:
        """The statements read; without gradients each is read once and remembered until `clear_cache`."""
        if torch.is_grad_enabled():
            return self._read_anew(statements)
        if len(self._remembered) > MOST_REMEMBERED:
            self.clear_cache()
        new = tuple(one for one in statements if one not in self._remembered)
        if new:
            read = self._read_anew(new)
            for row, statement in enumerate(new):
                count = int((read.mask[row, 0, 0] == 0).sum())
                self._remembered[statement] = [key_value[row, :count] for key_value in read.key_values]
        return StatementEncodings.from_cache([self._remembered[one] for one in statements])

    def _read_anew(self, statements: tuple[str, ...]) -> StatementEncodings:
        rows = [self.vocabulary.encode(one, MAX_WORDS) for one in statements]
        words = np.stack(rows)
        words = words[:, : max(MIN_PADDED_WORDS, int((words != 0).sum(1).max()))]
        words[:, 0] = np.maximum(words[:, 0], UNKNOWN)  # a statement without words is an unknown one
        numbers = torch.from_numpy(words).to(self.value.weight.device)
        mask = attention_mask(numbers)
        x = self.text(numbers)
        readers = (*self.readings, self.scene_reading)
        return StatementEncodings(tuple(reader.key_value(x) for reader in readers), mask)  # pyright: ignore[reportCallIssue, reportAttributeAccessIssue]


def _packing(rows: GroupedRows, device: torch.device) -> Packing:
    return Packing(torch.from_numpy(rows.padded).to(device), torch.from_numpy(rows.positions).to(device))


def _chosen(rows: Tensor, places: Tensor) -> Tensor:
    """(N, 3, d) from (R, d) rows and (N, 3) places."""
    return rows.index_select(0, places.flatten()).unflatten(0, places.shape)


def _roomy(bank: Boxes | None, count: int, like: Boxes) -> Boxes:
    """The bank itself where it has room for `count` boxes, else a copy with twice that room."""
    if bank is not None and len(bank.vectors) >= count:
        return bank
    made = Boxes(*(part.new_empty(2 * count, *part.shape[1:]) for part in like))
    if bank is not None:
        for new, old in zip(made, bank, strict=True):
            new[: len(old)] = old
    return made


class BoxEncoder(nn.Module):
    """A box's pixels to a vector, and to one for each of its 5 x 5 patches, distinct ones read once."""

    def __init__(self, width: int, channels: int) -> None:
        super().__init__()
        self.patch = nn.Linear(PATCH_BYTES, channels)
        self.around = nn.Conv2d(channels, channels, 3, padding=1)
        self.whole = nn.Linear(PATCHES**2 * channels, width)
        self.feedforward = Feedforward(width)

    def forward(self, patches: Tensor, patches_of: Tensor) -> Boxes:
        """From Q patches (Q, 300) uint8, and which of these U boxes have (U, 25)."""
        pixels = patches.float().sub_(MIDDLE_GREY).div_(HALF_RANGE)
        read = F.embedding(patches_of.unflatten(1, (PATCHES, PATCHES)), F.relu(self.patch(pixels)))  # (U, 5, 5, C)
        read = read + F.relu(self.around(read.permute(0, 3, 1, 2)).permute(0, 2, 3, 1))
        return Boxes(self.feedforward(self.whole(read.flatten(1))), read)


class TowerArguments(nn.Module):
    """A colour to add to each box, or the top block to remove."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.out = nn.Linear(width, len(Colour) + 1)
        nn.init.orthogonal_(self.out.weight, SMALL_GAIN)

    def forward(self, acting: Tensor, patches: Tensor, boxes_of: Tensor) -> tuple[Tensor, Tensor]:
        """(N, 3 * 3) of ADD and (N, 3) of REMOVE from (N, 3, d)."""
        found = self.out(acting)
        return found[..., :-1].flatten(1), found[..., -1]


class ScatterArguments(nn.Module):
    """A cell and a look to add there, or a cell to remove from."""

    CELL = 32

    def __init__(self, appearance: Scatter, width: int) -> None:
        super().__init__()
        self.rows, self.columns, _ = box_cells(appearance)
        self.seen = nn.Linear(CHANNELS, self.CELL)
        self.place = nn.Parameter(0.02 * torch.randn(self.rows * self.columns, self.CELL))
        self.box = nn.Linear(width, self.CELL)
        self.cell = nn.Linear(self.CELL, self.CELL)
        self.add = nn.Linear(self.CELL, len(ITEM_TYPES))
        self.wanted = nn.Linear(width, len(ITEM_TYPES))
        self.remove = nn.Linear(self.CELL, 1)
        self.cell_of_box = nn.Linear(width, self.CELL)
        for layer in (self.add, self.wanted, self.remove):
            nn.init.orthogonal_(layer.weight, SMALL_GAIN)

    def forward(self, acting: Tensor, patches: Tensor, boxes_of: Tensor) -> tuple[Tensor, Tensor]:
        """(N, 3 * cells * 27) of ADD and (N, 3 * cells) of REMOVE.

        From the states' boxes in the light of statement and target (N, 3, d), the patches of U distinct boxes
        (U, 5, 5, C), and which of these the states have (N, 3).
        """
        seen = self.seen(patches)
        if (self.rows, self.columns) != (PATCHES, PATCHES):
            seen = F.interpolate(seen.permute(0, 3, 1, 2), size=(self.rows, self.columns), mode="nearest")
            seen = seen.permute(0, 2, 3, 1)
        seen = seen.flatten(1, 2) + self.place
        parts = [self._of_states(seen, *part) for part in zip(acting.split(CHUNK), boxes_of.split(CHUNK), strict=True)]
        adds, removes = zip(*parts, strict=True)
        return torch.cat(adds), torch.cat(removes)

    def _of_states(self, seen: Tensor, acting: Tensor, boxes_of: Tensor) -> tuple[Tensor, Tensor]:
        """ADD and REMOVE of some states; `seen` (U, cells, 32)."""
        of_boxes = seen.index_select(0, boxes_of.flatten()).unflatten(0, boxes_of.shape)
        hidden = F.relu(of_boxes + self.box(acting)[:, :, None])
        hidden = F.relu(self.cell(hidden)) * self.cell_of_box(acting)[:, :, None]  # (N, 3, cells, 32)
        adds = self.add(hidden) + self.wanted(acting)[:, :, None]
        return adds.flatten(1), self.remove(hidden).flatten(1)
