"""Statements and scenes as tensors, each statement under one of the exchanges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from lilgym_mp.arrays import Int64Array
from lilgym_mp.corpus.tokens import UNKNOWN, Vocabulary
from lilgym_mp.learning.imitation.batches import StatementTokenizer, pad_rows
from lilgym_mp.learning.imitation.network import MIN_PADDED_WORDS
from lilgym_mp.learning.reward_model.features import BoxTable, exchanges, standard_exchanges

Rng = np.random.Generator
Columns = tuple[Tensor, Tensor, Tensor]  # words (S, T), item columns (S, F), box columns (S, G)


class InputReader:
    """Encodes statements with a vocabulary, and boxes of one appearance."""

    def __init__(self, vocabulary: Vocabulary, table: BoxTable, device: torch.device) -> None:
        self.table, self.device, self.vocabulary = table, device, vocabulary
        self._tokenizer = StatementTokenizer(vocabulary)
        self._kinds: dict[str, list[int]] = {}
        kinds = exchanges(table.appearance)
        self._words = np.tile(np.arange(len(vocabulary)), (len(kinds), 1))
        for row, kind in zip(self._words, kinds, strict=True):
            for old, new in kind.words().items():
                old_id, new_id = vocabulary.token_id(old), vocabulary.token_id(new)
                if UNKNOWN not in (old_id, new_id):
                    row[old_id] = new_id
        columns = [kind.columns(table.appearance) for kind in kinds]
        self._item_columns = np.stack([items for items, _ in columns])
        self._box_columns = np.stack([boxes for _, boxes in columns])

    def kinds(self, statement: str) -> list[int]:
        """The `standard_exchanges` of the statement."""
        found = self._kinds.get(statement)
        if found is None:
            words = self.vocabulary.decode(self._tokenizer.encode(statement).tolist())
            found = self._kinds[statement] = standard_exchanges(words, self.table.appearance)
        return found

    def statements(
        self, statements: Sequence[str], kinds: Sequence[int], unknown_words: float = 0.0, rng: Rng | None = None
    ) -> Columns:
        """The statements, each under the exchange of index `kinds[i]`; a fraction of the words becomes unknown."""
        rows = [
            self._words[kind][self._tokenizer.encode(statement)]
            for statement, kind in zip(statements, kinds, strict=True)
        ]
        if rng is not None and unknown_words:
            rows = [np.where(rng.random(len(row)) < unknown_words, UNKNOWN, row) for row in rows]
        arrays = pad_rows(rows, MIN_PADDED_WORDS), self._item_columns[list(kinds)], self._box_columns[list(kinds)]
        words, items, boxes = (torch.from_numpy(array).to(self.device) for array in arrays)
        return words, items, boxes

    def boxes(self, indices: Int64Array) -> tuple[Tensor, Tensor, Tensor]:
        """Features of the boxes (S, U): items (S, U, I, F), boxes (S, U, G), and which items there are (S, U, I)."""
        items, looks, present = (
            torch.from_numpy(array).to(self.device, torch.float32) for array in self.table.features(indices)
        )
        return items, looks, present

    def scenes(self, scenes: Int64Array) -> tuple[tuple[Tensor, Tensor, Tensor], Tensor]:
        """The features of the distinct boxes of (S, N, 3) scenes, and the scenes as indices into them."""
        if self.table.appearance == "tower":
            indices, local = np.arange(len(self.table))[None], scenes
        else:
            distinct = [np.unique(row, return_inverse=True) for row in scenes]
            indices = pad_rows([boxes for boxes, _ in distinct])
            local = np.stack([inverse.reshape(scenes.shape[1:]) for _, inverse in distinct])
        return self.boxes(indices), torch.from_numpy(np.ascontiguousarray(local)).to(self.device)
