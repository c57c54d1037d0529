"""A small encoder-decoder transformer from the words of a statement to the prefix tokens of its program.

The decoder is tree-structured: each position is embedded with its parent token and its argument index.

Module attributes are the keys of saved parameters, so renaming one breaks model files.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from lilgym_mp.learning.common.attention import checked_heads

PAD = 0
ROOT = 0  # parent of the first token
MOST_POSITIONS = 4096
MAX_ARGUMENTS = 8  # embeddings of argument indices; higher indices share the last


@dataclass(frozen=True)
class Sizes:
    """Network dimensions."""

    width: int = 96
    heads: int = 4  # must divide the width
    hidden: int = 288
    layers: int = 2  # in the encoder and in the decoder
    longest_statement: int = 64  # maximum number of words
    longest_program: int = 96  # maximum number of tokens

    def __post_init__(self) -> None:
        """Raises ValueError for more positions than MOST_POSITIONS."""
        for name in ("longest_statement", "longest_program"):
            if getattr(self, name) > MOST_POSITIONS:
                raise ValueError(f"{name} must be at most {MOST_POSITIONS:,}, not {getattr(self, name):,}")


class Slots(NamedTuple):
    """The position of each token in the program tree."""

    parents: Tensor  # (B, length) parent token; ROOT for the first
    arguments: Tensor  # (B, length) argument index under the parent


class CachedAttention(nn.Module):
    """Multi-head attention with keys and values computed separately, so that they can be cached."""

    def __init__(self, sizes: Sizes) -> None:
        super().__init__()
        self.heads = checked_heads(sizes.heads, sizes.width)
        self.query = nn.Linear(sizes.width, sizes.width)
        self.key_value = nn.Linear(sizes.width, 2 * sizes.width)
        self.out = nn.Linear(sizes.width, sizes.width)

    def keys_and_values(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """(B, length, width) to keys and values (B, heads, length, width / heads)."""
        keys, values = self.key_value(x).chunk(2, dim=-1)
        return self._split(keys), self._split(values)

    def forward(
        self, x: Tensor, keys: Tensor, values: Tensor, mask: Tensor | None = None, *, causal: bool = False
    ) -> Tensor:
        """(B, length, width); `mask` (B, 1, 1, keys) is true for keys that may be attended to."""
        mixed = functional.scaled_dot_product_attention(
            self._split(self.query(x)), keys, values, attn_mask=mask, is_causal=causal
        )
        return self.out(mixed.transpose(1, 2).flatten(2))

    def _split(self, x: Tensor) -> Tensor:
        return x.unflatten(2, (self.heads, -1)).transpose(1, 2)


class EncoderLayer(nn.Module):
    """Pre-norm layer over the statement's words: self-attention, then a feed-forward block."""

    def __init__(self, sizes: Sizes, dropout: float) -> None:
        super().__init__()
        self.attention = CachedAttention(sizes)
        self.hidden = _feed_forward(sizes, dropout)
        self.norms = nn.ModuleList(nn.LayerNorm(sizes.width) for _ in range(2))
        self.dropout = nn.Dropout(dropout)

    def forward(self, x: Tensor, mask: Tensor) -> Tensor:
        normed = self.norms[0](x)
        x = x + self.dropout(self.attention(normed, *self.attention.keys_and_values(normed), mask))
        return x + self.dropout(self.hidden(self.norms[1](x)))


class DecoderLayer(nn.Module):
    """Pre-norm layer over program tokens: self-attention, attention to the statement, feed-forward."""

    def __init__(self, sizes: Sizes, dropout: float) -> None:
        super().__init__()
        self.own = CachedAttention(sizes)
        self.statement = CachedAttention(sizes)
        self.hidden = _feed_forward(sizes, dropout)
        self.norms = nn.ModuleList(nn.LayerNorm(sizes.width) for _ in range(3))
        self.dropout = nn.Dropout(dropout)

    def forward(self, x: Tensor, memory: Memory, cache: list[Tensor] | None) -> Tensor:
        """`cache`: keys and values of preceding tokens, extended in place by those of `x`; None: teacher forcing."""
        normed = self.norms[0](x)
        keys, values = self.own.keys_and_values(normed)
        if cache is not None:
            keys, values = (torch.cat([before, new], dim=2) for before, new in zip(cache, (keys, values), strict=True))
            cache[:] = [keys, values]
        x = x + self.dropout(self.own(normed, keys, values, causal=cache is None))
        attended = self.statement(self.norms[1](x), memory.keys, memory.values, memory.mask)
        x = x + self.dropout(attended)
        return x + self.dropout(self.hidden(self.norms[2](x)))


class Memory(NamedTuple):
    """The encoded statement as one decoder layer's cross-attention keys and values."""

    keys: Tensor  # (B, heads, words, width / heads)
    values: Tensor
    mask: Tensor  # (B, 1, 1, words) true for words, false for padding

    def expanded(self, count: int) -> Memory:
        """One statement's memory repeated for `count` hypotheses."""
        return self._replace(keys=self.keys.expand(count, -1, -1, -1), values=self.values.expand(count, -1, -1, -1))


def _feed_forward(sizes: Sizes, dropout: float) -> nn.Module:
    return nn.Sequential(
        nn.Linear(sizes.width, sizes.hidden), nn.GELU(), nn.Dropout(dropout), nn.Linear(sizes.hidden, sizes.width)
    )


class ParserNetwork(nn.Module):
    """Word indices to logits of program tokens; index 0 is padding in both."""

    def __init__(
        self, word_count: int, token_count: int, sizes: Sizes, dropout: float = 0.0, encoder: nn.Module | None = None
    ) -> None:
        """`word_count`, `token_count`: padding included. `encoder`: an external one from (B, words) indices to
        (B, words, width), used in place of the built-in one."""
        super().__init__()
        self.sizes = sizes
        width = sizes.width
        self.text = encoder
        if encoder is None:
            self.words = nn.Embedding(word_count, width, padding_idx=PAD)
            self.word_places = nn.Parameter(0.02 * torch.randn(sizes.longest_statement, width))
            self.encoder = nn.ModuleList(EncoderLayer(sizes, dropout) for _ in range(sizes.layers))
            self.encoder_norm = nn.LayerNorm(width)
        self.tokens = nn.Embedding(token_count, width)
        self.parents = nn.Embedding(token_count, width)
        self.parts = nn.Embedding(MAX_ARGUMENTS, width)
        self.token_places = nn.Parameter(0.02 * torch.randn(sizes.longest_program, width))
        self.decoder = nn.ModuleList(DecoderLayer(sizes, dropout) for _ in range(sizes.layers))
        self.decoder_norm = nn.LayerNorm(width)
        self.logits = nn.Linear(width, token_count)
        self.dropout = nn.Dropout(dropout)
        own = () if encoder else (self.words,)
        for embedding in (*own, self.tokens, self.parents, self.parts):
            nn.init.normal_(embedding.weight, std=0.05)

    def encode(self, words: Tensor) -> list[Memory]:
        """(B, words) indices to the memory of each decoder layer."""
        mask = (words != PAD)[:, None, None]
        x = self._encoded(words, mask) if self.text is None else self.text(words)
        layers = (cast("DecoderLayer", layer) for layer in self.decoder)
        return [Memory(*layer.statement.keys_and_values(x), mask) for layer in layers]

    def _encoded(self, words: Tensor, mask: Tensor) -> Tensor:
        x = self.dropout(self.words(words) + self.word_places[: words.shape[1]])
        for layer in self.encoder:
            x = layer(x, mask)
        return self.encoder_norm(x)

    def forward(self, words: Tensor, tokens: Tensor, slots: Slots) -> Tensor:
        """Logits (B, length, tokens) under teacher forcing; `tokens` and `slots` are (B, length)."""
        before = functional.pad(tokens, (1, -1), value=ROOT)
        return self.decode(self.encode(words), before, slots, first=0, caches=None)

    def decode(
        self, memories: list[Memory], before: Tensor, slots: Slots, *, first: int, caches: list[list[Tensor]] | None
    ) -> Tensor:
        """Logits (B, length, tokens) of the tokens in `slots`, each given the token `before` it.

        `first`: the position of the first of them.
        """
        positions = self.token_places[first : first + before.shape[1]]
        arguments = self.parts(slots.arguments.clamp(max=MAX_ARGUMENTS - 1))
        x = self.dropout(self.tokens(before) + self.parents(slots.parents) + arguments + positions)
        for index, (layer, memory) in enumerate(zip(self.decoder, memories, strict=True)):
            x = layer(x, memory, None if caches is None else caches[index])
        return self.logits(self.decoder_norm(x))
