"""A small network for images, statements and targets, quick on a processor without an accelerator.

Each box of the half-size image is cut into patches and read with the same weights; the statement and the target
modulate what is seen (FiLM, Perez et al. 2018); one trunk joins both for the policy and the value.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from lilgym_mp.appearances import Appearance, Grid, Scatter
from lilgym_mp.appearances.numbering import ITEM_TYPES
from lilgym_mp.corpus.tokens import PAD
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, IMAGE_WIDTH, SEPARATOR_WIDTH

SHRINK = 2  # native pixels a side of one pixel of the half-size image
BOX_PIXELS = BOX_SIDE // SHRINK
BOX_STRIDE = BOX_PITCH // SHRINK
PATCH_PIXELS = 10
PATCHES = BOX_PIXELS // PATCH_PIXELS  # along each side of a box
BRIGHTEST = 255.0
MOST_ACTIONS = 50_000
SMALL_GAIN = 0.01  # of the policy's last layer, so that learning starts from a nearly uniform policy


@dataclass(frozen=True)
class Widths:
    """Features in each part of the network."""

    word: int = 32
    statement: int = 64
    patch: int = 16
    box: int = 64
    trunk: int = 128


class Prediction(NamedTuple):
    logits: Tensor  # (B, actions)
    values: Tensor  # (B,) in -1 .. 1


class StatementReader(nn.Module):
    """Word numbers and target to a vector: windows of three words, the strongest and the mean of each feature."""

    def __init__(self, vocabulary_size: int, widths: Widths) -> None:
        super().__init__()
        self.words = nn.Embedding(vocabulary_size, widths.word, padding_idx=PAD)
        self.window = nn.Conv1d(widths.word, widths.statement, kernel_size=3, padding=1)
        self.target = nn.Embedding(2, widths.statement)
        self.joined = nn.Linear(2 * widths.statement, widths.statement)

    def forward(self, words: Tensor, target: Tensor) -> Tensor:
        """(B, length) int64 and (B,) int64 to (B, statement)."""
        windows = functional.relu(self.window(self.words(words).transpose(1, 2)))  # (B, statement, length)
        windows = windows * (words != PAD).unsqueeze(1)
        length = (words != PAD).sum(1, keepdim=True).clamp(min=1)
        pooled = torch.cat([windows.amax(2), windows.sum(2) / length], dim=1)
        return functional.relu(self.joined(pooled) + self.target(target))


class Modulation(nn.Module):
    """Scales and shifts features as a condition says (FiLM)."""

    def __init__(self, features: int, condition: int) -> None:
        super().__init__()
        self.scale_and_shift = nn.Linear(condition, 2 * features)

    def forward(self, features: Tensor, condition: Tensor) -> Tensor:
        """(B, ..., features) and (B, condition) to (B, ..., features)."""
        extra = features.dim() - condition.dim()
        scale, shift = self.scale_and_shift(condition)[(slice(None), *[None] * extra)].chunk(2, dim=-1)
        return features * (1 + scale) + shift


class BoxReader(nn.Module):
    """The three boxes of half-size images, with the same weights for each."""

    def __init__(self, widths: Widths) -> None:
        super().__init__()
        self.patch = nn.Linear(PATCH_PIXELS**2 * 3, widths.patch)
        self.place = nn.Parameter(torch.zeros(PATCHES**2, widths.patch))
        self.modulate_patches = Modulation(widths.patch, widths.statement)
        self.box = nn.Linear(PATCHES**2 * widths.patch, widths.box)
        self.modulate_boxes = Modulation(widths.box, widths.statement)

    def forward(self, images: Tensor, statement: Tensor) -> tuple[Tensor, Tensor]:
        """(B, 50, 190, 3) uint8 and (B, statement) to patches (B, 3, 25, patch) and boxes (B, 3, box)."""
        patches = self.patch(patches_of(images)) + self.place
        patches = functional.relu(self.modulate_patches(patches, statement))
        boxes = self.modulate_boxes(self.box(patches.flatten(2)), statement)
        return patches, functional.relu(boxes)


def patches_of(images: Tensor) -> Tensor:
    """(B, 50, 190, 3) uint8 to (B, 3 boxes, 25 patches, 300) in 0 .. 1; patches row by row."""
    count = len(images)
    boxes = images.unfold(2, BOX_PIXELS, BOX_STRIDE)  # (B, 50, 3 boxes, 3 colours, 50)
    cut = boxes.reshape(count, PATCHES, PATCH_PIXELS, BOX_COUNT, 3, PATCHES, PATCH_PIXELS)
    cut = cut.permute(0, 3, 1, 5, 2, 6, 4)
    patches = torch.empty(cut.shape, device=images.device)
    patches.copy_(cut)
    return patches.view(count, BOX_COUNT, PATCHES**2, -1).div_(BRIGHTEST)


class Trunk(nn.Module):
    """Boxes and statement to the features that the policy and the value look at."""

    def __init__(self, widths: Widths) -> None:
        super().__init__()
        self.boxes = nn.Linear(BOX_COUNT * widths.box, widths.trunk)
        self.modulate = Modulation(widths.trunk, widths.statement)
        self.joined = nn.Linear(widths.trunk + widths.statement, widths.trunk)

    def forward(self, boxes: Tensor, statement: Tensor) -> Tensor:
        """(B, 3, box) and (B, statement) to (B, trunk)."""
        seen = functional.relu(self.modulate(self.boxes(boxes.flatten(1)), statement))
        return functional.relu(self.joined(torch.cat([seen, statement], dim=1)))


class ListHead(nn.Module):
    """A logit for each of a short list of actions."""

    def __init__(self, action_count: int, widths: Widths) -> None:
        super().__init__()
        self.logits = nn.Linear(widths.trunk, action_count)
        nn.init.orthogonal_(self.logits.weight, SMALL_GAIN)

    def forward(self, trunk: Tensor, patches: Tensor) -> Tensor:
        return self.logits(trunk)


class GridHead(nn.Module):
    """A logit for STOP, and for what can be done in each cell, from what is seen there and from the whole."""

    def __init__(self, grid: Grid, item_types: int, widths: Widths) -> None:
        super().__init__()
        columns, self.rows = grid
        cell_width = IMAGE_WIDTH // columns
        self.box_columns, self.separator_columns = BOX_SIDE // cell_width, SEPARATOR_WIDTH // cell_width
        self.stop = nn.Linear(widths.trunk, 1)
        self.whole = nn.Linear(widths.trunk, widths.patch)
        self.place = nn.Parameter(torch.zeros(BOX_COUNT, self.rows, self.box_columns, widths.patch))
        self.cell = nn.Linear(2 * widths.patch, 2 * widths.patch)
        self.edits = nn.Linear(2 * widths.patch, item_types + 1)  # ADD each item type, REMOVE
        self.any_cell = nn.Linear(widths.trunk, item_types + 1)
        for layer in (self.stop, self.edits, self.any_cell):
            nn.init.orthogonal_(layer.weight, SMALL_GAIN)

    def forward(self, trunk: Tensor, patches: Tensor) -> Tensor:
        count = len(trunk)
        seen = patches.view(count * BOX_COUNT, PATCHES, PATCHES, -1).permute(0, 3, 1, 2)
        seen = functional.interpolate(seen, size=(self.rows, self.box_columns), mode="nearest")
        seen = seen.permute(0, 2, 3, 1).view(count, BOX_COUNT, self.rows, self.box_columns, -1)
        whole = (self.whole(trunk)[:, None, None, None] + self.place).expand_as(seen)
        cells = functional.relu(self.cell(torch.cat([seen, whole], dim=-1)))
        edits = self.edits(cells) + self.any_cell(trunk)[:, None, None, None]  # (B, 3, rows, columns, item types + 1)
        # Actions are ordered by column of the whole image, then row, then item type; all REMOVEs follow the ADDs.
        edits = functional.pad(edits, (0, 0, 0, self.separator_columns)).transpose(2, 3).flatten(1, 2)
        edits = edits[:, : -self.separator_columns]
        return torch.cat([self.stop(trunk), edits[..., :-1].flatten(1), edits[..., -1].flatten(1)], dim=1)


class ActorCritic(nn.Module):
    """Logits of all actions, and the value, of half-size images, word numbers and targets."""

    def __init__(self, appearance: Appearance, vocabulary_size: int, widths: Widths | None = None) -> None:
        """Raises ValueError as `check` does."""
        super().__init__()
        self.check(appearance)
        widths = widths or Widths()
        self.statement = StatementReader(vocabulary_size, widths)
        self.boxes = BoxReader(widths)
        self.trunk = Trunk(widths)
        self.policy = _head(appearance, widths)
        self.value = nn.Linear(widths.trunk, 1)

    @staticmethod
    def check(appearance: Appearance) -> None:
        """Raises ValueError for an appearance with more actions than a policy can list."""
        count = appearance.action_count
        if count > MOST_ACTIONS:
            raise ValueError(
                f"{count:,} actions are too many for a policy that lists them, at most {MOST_ACTIONS:,};"
                " choose a coarser grid"
            )

    def forward(self, images: Tensor, words: Tensor, targets: Tensor) -> Prediction:
        """(B, 50, 190, 3) uint8, (B, length) int64 and (B,) int64."""
        statement = self.statement(words, targets)
        patches, boxes = self.boxes(images, statement)
        trunk = self.trunk(boxes, statement)
        return Prediction(self.policy(trunk, patches), torch.tanh(self.value(trunk)).squeeze(1))


def _head(appearance: Appearance, widths: Widths) -> nn.Module:
    if isinstance(appearance, Scatter):
        return GridHead(appearance.grid, len(ITEM_TYPES), widths)
    return ListHead(appearance.action_count, widths)
