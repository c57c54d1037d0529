"""States grouped by statement, so that what depends on a statement-box pair is computed once per distinct pair."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lilgym_mp.arrays import Int64Array
from lilgym_mp.learning.ppo.states import States
from lilgym_mp.scene import BOX_COUNT


class GroupedRows(NamedTuple):
    """R rows grouped by S statements and padded to P rows per statement."""

    counts: Int64Array  # (S,) rows of each statement
    padded: Int64Array  # (S, P) row indices of each statement in order; 0 is padding
    positions: Int64Array  # (R,) index of each row among the S * P


class StatementGroups(NamedTuple):
    """N states of S statements, and their R distinct statement-box pairs."""

    boxes: Int64Array  # (R,) box of each pair
    pairs: GroupedRows
    pairs_of: Int64Array  # (N, 3) pair indices of each state
    states: GroupedRows


def group_by_statement(states: States) -> StatementGroups:
    count, box_count = len(states.statements), len(states.box_hashes)
    codes = states.statement_of[:, None] * box_count + states.boxes_of
    pairs, pairs_of = np.unique(codes, return_inverse=True)
    owners, boxes = np.divmod(pairs, box_count)
    return StatementGroups(
        boxes,
        _grouped(owners, count),
        pairs_of.reshape(-1, BOX_COUNT),
        _grouped(states.statement_of, count),
    )


def _grouped(statement_of: Int64Array, count: int) -> GroupedRows:
    order = np.argsort(statement_of, kind="stable")
    counts = np.bincount(statement_of, minlength=count)
    firsts, most = counts.cumsum() - counts, int(counts.max())
    owners = statement_of[order]
    positions = np.empty(len(order), np.int64)
    positions[order] = owners * most + np.arange(len(order)) - firsts[owners]
    padded = np.zeros(count * most, np.int64)
    padded[positions] = np.arange(len(order))
    return GroupedRows(counts, padded.reshape(count, most), positions)
