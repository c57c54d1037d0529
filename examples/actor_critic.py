"""A small actor-critic over images, statements and targets, fast on a CPU.

Each box of the half-size image is cut into patches and encoded with shared weights; the encoded statement and target
modulate the visual features (FiLM, Perez et al. 2018); a shared trunk feeds the policy and value heads.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from lilgym_mp.appearances import Appearance, Grid
from lilgym_mp.appearances.numbering import ITEM_TYPES
from lilgym_mp.corpus.tokens import PAD
from lilgym_mp.scene import BOX_COUNT, BOX_PITCH, BOX_SIDE, IMAGE_WIDTH, SEPARATOR_WIDTH

SHRINK = 2  # native pixels per pixel of the half-size image, along each side
BOX_PIXELS = BOX_SIDE // SHRINK
BOX_STRIDE = BOX_PITCH // SHRINK
PATCH_PIXELS = 10
PATCHES = BOX_PIXELS // PATCH_PIXELS  # along each side of a box
MAX_INTENSITY = 255.0
MAX_ACTIONS = 50_000
SMALL_GAIN = 0.01  # gain of the policy's last layer, so that learning starts from a nearly uniform policy


@dataclass(frozen=True)
class Widths:
    """Feature dimensions."""

    word: int = 32
    statement: int = 64
    patch: int = 16
    box: int = 64
    trunk: int = 128


class Prediction(NamedTuple):
    logits: Tensor  # (B, actions)
    values: Tensor  # (B,) in -1 .. 1


class StatementEncoder(nn.Module):
    """Word indices and target to a vector: a width-3 convolution with max and mean pooling."""

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


class FiLM(nn.Module):
    """Feature-wise scale and shift predicted from a condition (FiLM)."""

    def __init__(self, features: int, condition: int) -> None:
        super().__init__()
        self.scale_and_shift = nn.Linear(condition, 2 * features)

    def forward(self, features: Tensor, condition: Tensor) -> Tensor:
        """(B, ..., features) and (B, condition) to (B, ..., features)."""
        extra = features.dim() - condition.dim()
        scale, shift = self.scale_and_shift(condition)[(slice(None), *[None] * extra)].chunk(2, dim=-1)
        return features * (1 + scale) + shift


class BoxEncoder(nn.Module):
    """Encodes the three boxes of half-size images with shared weights."""

    def __init__(self, widths: Widths) -> None:
        super().__init__()
        self.patch = nn.Linear(PATCH_PIXELS**2 * 3, widths.patch)
        self.place = nn.Parameter(torch.zeros(PATCHES**2, widths.patch))
        self.modulate_patches = FiLM(widths.patch, widths.statement)
        self.box = nn.Linear(PATCHES**2 * widths.patch, widths.box)
        self.modulate_boxes = FiLM(widths.box, widths.statement)

    def forward(self, images: Tensor, statement: Tensor) -> tuple[Tensor, Tensor]:
        """(B, 50, 190, 3) uint8 and (B, statement) to patches (B, 3, 25, patch) and boxes (B, 3, box)."""
        patches = self.patch(patches_of(images)) + self.place
        patches = functional.relu(self.modulate_patches(patches, statement))
        boxes = self.modulate_boxes(self.box(patches.flatten(2)), statement)
        return patches, functional.relu(boxes)


def patches_of(images: Tensor) -> Tensor:
    """(B, 50, 190, 3) uint8 to (B, 3 boxes, 25 patches, 300) in 0 .. 1; patches in row-major order."""
    count = len(images)
    boxes = images.unfold(2, BOX_PIXELS, BOX_STRIDE)  # (B, 50, 3 boxes, 3 colours, 50)
    cut = boxes.reshape(count, PATCHES, PATCH_PIXELS, BOX_COUNT, 3, PATCHES, PATCH_PIXELS)
    cut = cut.permute(0, 3, 1, 5, 2, 6, 4)
    patches = torch.empty(cut.shape, device=images.device)
    patches.copy_(cut)
    return patches.view(count, BOX_COUNT, PATCHES**2, -1).div_(MAX_INTENSITY)


class Trunk(nn.Module):
    """Boxes and statement to the features shared by the policy and value heads."""

    def __init__(self, widths: Widths) -> None:
        super().__init__()
        self.boxes = nn.Linear(BOX_COUNT * widths.box, widths.trunk)
        self.modulate = FiLM(widths.trunk, widths.statement)
        self.joined = nn.Linear(widths.trunk + widths.statement, widths.trunk)

    def forward(self, boxes: Tensor, statement: Tensor) -> Tensor:
        """(B, 3, box) and (B, statement) to (B, trunk)."""
        visual = functional.relu(self.modulate(self.boxes(boxes.flatten(1)), statement))
        return functional.relu(self.joined(torch.cat([visual, statement], dim=1)))


class ListHead(nn.Module):
    """One linear layer to the logits of a short list of actions (Tower)."""

    def __init__(self, action_count: int, widths: Widths) -> None:
        super().__init__()
        self.logits = nn.Linear(widths.trunk, action_count)
        nn.init.orthogonal_(self.logits.weight, SMALL_GAIN)

    def forward(self, trunk: Tensor, patches: Tensor) -> Tensor:
        return self.logits(trunk)


class GridHead(nn.Module):
    """Logits of STOP and of each cell's edits, from the cell's patch features and the trunk (Scatter)."""

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
        local = patches.view(count * BOX_COUNT, PATCHES, PATCHES, -1).permute(0, 3, 1, 2)
        local = functional.interpolate(local, size=(self.rows, self.box_columns), mode="nearest")
        local = local.permute(0, 2, 3, 1).view(count, BOX_COUNT, self.rows, self.box_columns, -1)
        whole = (self.whole(trunk)[:, None, None, None] + self.place).expand_as(local)
        cells = functional.relu(self.cell(torch.cat([local, whole], dim=-1)))
        edits = self.edits(cells) + self.any_cell(trunk)[:, None, None, None]  # (B, 3, rows, columns, item types + 1)
        # Action order: ADDs by image column, then row, then item type; then REMOVEs by column and row.
        edits = functional.pad(edits, (0, 0, 0, self.separator_columns)).transpose(2, 3).flatten(1, 2)
        edits = edits[:, : -self.separator_columns]
        return torch.cat([self.stop(trunk), edits[..., :-1].flatten(1), edits[..., -1].flatten(1)], dim=1)


class ActorCritic(nn.Module):
    """Action logits and value from half-size images, word indices and targets."""

    def __init__(self, appearance: Appearance, vocabulary_size: int, widths: Widths | None = None) -> None:
        """Raises ValueError as `check` does."""
        super().__init__()
        self.check(appearance)
        widths = widths or Widths()
        self.statement = StatementEncoder(vocabulary_size, widths)
        self.boxes = BoxEncoder(widths)
        self.trunk = Trunk(widths)
        self.policy = _head(appearance, widths)
        self.value = nn.Linear(widths.trunk, 1)

    @staticmethod
    def check(appearance: Appearance) -> None:
        """Raises ValueError for an appearance with too many actions for a flat categorical policy."""
        count = appearance.action_count
        if count > MAX_ACTIONS:
            raise ValueError(
                f"{count:,} actions are too many for a flat policy, which takes at most {MAX_ACTIONS:,};"
                " choose a coarser grid"
            )

    def forward(self, images: Tensor, words: Tensor, targets: Tensor) -> Prediction:
        """(B, 50, 190, 3) uint8, (B, length) int64 and (B,) int64."""
        statement = self.statement(words, targets)
        patches, boxes = self.boxes(images, statement)
        trunk = self.trunk(boxes, statement)
        return Prediction(self.policy(trunk, patches), torch.tanh(self.value(trunk)).squeeze(1))


def _head(appearance: Appearance, widths: Widths) -> nn.Module:
    if appearance.grid is not None:
        return GridHead(appearance.grid, len(ITEM_TYPES), widths)
    return ListHead(appearance.action_count, widths)
