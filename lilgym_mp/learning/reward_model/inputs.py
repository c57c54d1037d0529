"""Statements and scenes as tensors, each statement under one of the exchanges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from lilgym_mp.corpus.tokens import UNKNOWN, Vocabulary
from lilgym_mp.learning.common.words import MIN_PADDED_WORDS, StatementTokenizer, pad_rows
from lilgym_mp.learning.reward_model.features import BoxTable, exchanges, standard_exchanges
from lilgym_mp.learning.reward_model.network import BoxFeatures
from lilgym_mp.scene.arrays import Int64Array

MOST_BOXES = 100_000
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

    def renewed_table(self) -> BoxTable:
        """Its table, or a new one if there are many boxes in it; for scenes that are not kept."""
        if len(self.table) > MOST_BOXES:
            self.table = BoxTable(self.table.appearance)
        return self.table

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

    def boxes(self, indices: Int64Array) -> BoxFeatures:
        """Features of the boxes (S, U)."""
        items, looks = self.table.features(indices)
        features = self.table.item_features
        rows = np.arange(len(items))[:, None, None]
        occurs = np.zeros((len(items), len(features)), np.bool_)
        occurs[rows, items] = occurs[:, :1] = True
        members = (occurs.cumsum(1) - 1)[rows, items]
        features = features[pad_rows([row.nonzero()[0] for row in occurs])]
        arrays = features.astype(np.float32), members, looks.astype(np.float32)
        return BoxFeatures(*(torch.from_numpy(array).to(self.device) for array in arrays))

    def scenes(self, scenes: Int64Array) -> tuple[BoxFeatures, Tensor]:
        """The features of the distinct boxes of (S, N, 3) scenes, and the scenes as indices into them."""
        if self.table.appearance == "tower":
            indices, local = np.arange(len(self.table))[None], scenes
        else:
            distinct = [np.unique(row, return_inverse=True) for row in scenes]
            indices = pad_rows([boxes for boxes, _ in distinct])
            local = np.stack([inverse.reshape(scenes.shape[1:]) for _, inverse in distinct])
        return self.boxes(indices), torch.from_numpy(np.ascontiguousarray(local)).to(self.device)
