"""States by their statements, so that what depends on a statement and a box is calculated once for each such pair."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lilgym_mp.arrays import Int64Array
from lilgym_mp.learning.ppo.states import States
from lilgym_mp.scene import BOX_COUNT


class GroupedRows(NamedTuple):
    """R rows, each of one of S statements, as a table of the statements with P places each."""

    counts: Int64Array  # (S,) rows of each statement
    padded: Int64Array  # (S, P) the rows of each statement in order, 0 in vacant places
    places: Int64Array  # (R,) where each row is among the S * P


class StatementGroups(NamedTuple):
    """N states of S statements, and R pairs of a statement and a box."""

    boxes: Int64Array  # (R,) of each pair
    pairs: GroupedRows
    pairs_of: Int64Array  # (N, 3) each state's pairs
    states: GroupedRows


def group_by_statement(states: States) -> StatementGroups:
    count, box_count = len(states.statements), len(states.box_codes)
    codes = states.statement_of[:, None] * box_count + states.boxes_of
    pairs, pairs_of = np.unique(codes, return_inverse=True)
    owners, boxes = np.divmod(pairs, box_count)
    return StatementGroups(
        boxes,
        _by_statement(owners, count),
        pairs_of.reshape(-1, BOX_COUNT),
        _by_statement(states.statement_of, count),
    )


def _by_statement(statement_of: Int64Array, count: int) -> GroupedRows:
    order = np.argsort(statement_of, kind="stable")
    counts = np.bincount(statement_of, minlength=count)
    firsts, most = counts.cumsum() - counts, int(counts.max())
    owners = statement_of[order]
    places = np.empty(len(order), np.int64)
    places[order] = owners * most + np.arange(len(order)) - firsts[owners]
    padded = np.zeros(count * most, np.int64)
    padded[places] = np.arange(len(order))
    return GroupedRows(counts, padded.reshape(count, most), places)
