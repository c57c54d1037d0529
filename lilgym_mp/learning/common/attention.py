"""Attention to the words of a statement, and its encoder; shared by the networks of several learners.

Module attributes are the keys of saved parameters, so renaming one breaks model files.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor, nn
from torch.nn.utils.rnn import pad_sequence

MAX_WORDS = 64  # longer statements are truncated
MIN_PADDED_WORDS = 16  # padded length of a batch of statements: softmax is slow over fewer


class StatementEncodings(NamedTuple):
    """Keys and values of S statements for the layers that attend to words."""

    key_values: tuple[Tensor, ...]  # (S, T, 2 d) per layer
    mask: Tensor  # (S, 1, 1, T) additive attention mask of the padding

    @classmethod
    def from_cache(cls, statements: Sequence[Sequence[Tensor]]) -> StatementEncodings:
        """From cached statements: the key-values of each, without padding."""
        padded = [pad_sequence(list(parts), batch_first=True) for parts in zip(*statements, strict=True)]
        missing = max(0, MIN_PADDED_WORDS - padded[0].shape[1])
        key_values = tuple(F.pad(key_value, (0, 0, 0, missing)) for key_value in padded)
        lengths = torch.tensor([len(parts[0]) for parts in statements], device=key_values[0].device)
        positions = torch.arange(key_values[0].shape[1], device=lengths.device)
        return cls(key_values, attention_mask(positions[None] < lengths[:, None]))


class Packing(NamedTuple):
    """Mapping between R packed rows and their (S, N) padded form, so that linear layers skip the padding."""

    padded: Tensor  # (S, N) row index; 0 is padding
    positions: Tensor  # (R,) index of each row among the S * N


class Feedforward(nn.Module):
    """Pre-norm residual block: d to 2d to d, with ReLU between."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.up = nn.Linear(width, 2 * width)
        self.down = nn.Linear(2 * width, width)

    def forward(self, x: Tensor) -> Tensor:
        return x + self.down(F.relu(self.up(self.norm(x))))


def checked_heads(heads: int, width: int) -> int:
    """`heads`. Raises ValueError unless it divides the width."""
    if heads < 1 or width % heads:
        raise ValueError(f"heads must divide the width, {width}, not be {heads}")
    return heads


class Attention(nn.Module):
    """Pre-norm multi-head cross-attention to words."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = checked_heads(heads, width)
        self.norm = nn.LayerNorm(width)
        self.query = nn.Linear(width, width)
        self.key_value = nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)

    def forward(self, x: Tensor, key_value: Tensor, mask: Tensor, packing: Packing | None = None) -> Tensor:
        """`x` (S, N, d), or (R, d) with `packing`; `key_value` (S, T, 2 d) from `self.key_value`; `mask` as in
        `StatementEncodings`."""
        query = self.query(self.norm(x))
        if packing is not None:
            query = query.index_select(0, packing.padded.flatten()).unflatten(0, packing.padded.shape)
        batch, count, width = query.shape
        query = query.view(batch, count, self.heads, -1).transpose(1, 2)
        key, value = key_value.unflatten(2, (2, self.heads, -1)).permute(2, 0, 3, 1, 4)
        scores = torch.matmul(query * (width // self.heads) ** -0.5, key.transpose(-1, -2)) + mask.to(query.dtype)
        mixed = torch.matmul(scores.softmax(-1).to(value.dtype), value)
        mixed = mixed.transpose(1, 2).reshape(batch, count, width)
        if packing is not None:
            mixed = mixed.flatten(0, 1).index_select(0, packing.positions)
        return x + self.out(mixed)


def attention_mask(words: Tensor) -> Tensor:
    """(S, 1, 1, T) additive mask that hides padding; `words` (S, T), 0 is padding."""
    return torch.zeros(words.shape, device=words.device).masked_fill_(words == 0, -1e4)[:, None, None]


def among_all(indices: Tensor, rows: int) -> Tensor:
    """Indices (S, ...) of the `rows` rows of each of S statements, as indices of all S * rows together."""
    first = torch.arange(len(indices), device=indices.device) * rows
    return indices + first.view(-1, *[1] * (indices.ndim - 1))


class TextLayer(nn.Module):
    """Self-attention over words, then a feed-forward block."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.attention = Attention(width, heads)
        self.feedforward = Feedforward(width)

    def forward(self, x: Tensor, mask: Tensor) -> Tensor:
        return self.feedforward(self.attention(x, self.attention.key_value(self.attention.norm(x)), mask))


class TextEncoder(nn.Module):
    """Word and position embeddings, then layers of self-attention."""

    def __init__(self, vocabulary: int, width: int, heads: int, layers: int, dropout: float) -> None:
        super().__init__()
        self.words = nn.Embedding(vocabulary, width, padding_idx=0)
        self.places = nn.Parameter(0.02 * torch.randn(MAX_WORDS, width))
        self.dropout = nn.Dropout(dropout)
        self.layers = nn.ModuleList(TextLayer(width, heads) for _ in range(layers))
        self.norm = nn.LayerNorm(width)
        nn.init.normal_(self.words.weight, std=0.3)

    def forward(self, words: Tensor) -> Tensor:
        """(S, T) word indices to (S, T, d)."""
        mask = attention_mask(words)
        x = self.dropout(self.words(words) + self.places[: words.shape[1]])
        if torch.is_autocast_enabled(x.device.type):
            x = x.to(torch.get_autocast_dtype(x.device.type))
        for layer in self.layers:
            x = self.dropout(layer(x, mask))
        return self.norm(x)
