"""States by their statements, so that what depends on a statement and a box is calculated once for each such pair."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lilgym_mp.arrays import Int64Array
from lilgym_mp.learning.ppo.states import States
from lilgym_mp.scene import BOX_COUNT


class Arrangement(NamedTuple):
    """N states of S statements: P boxes of each statement at most, and M scenes."""

    pair_boxes: Int64Array  # (S, P) the distinct boxes of each statement, the first of all in vacant places
    pair_counts: Int64Array  # (S,) how many boxes each statement has
    pairs_of: Int64Array  # (N, 3) places of each state's boxes in the S * P
    scenes: Int64Array  # (S, M, 3) the same by statement, 0 in vacant places
    rows: Int64Array  # (N,) where each state is among the S * M


def arrange(states: States) -> Arrangement:
    count, box_count = len(states.statements), len(states.boxes)
    codes = states.statement_of[:, None] * box_count + states.boxes_of
    pairs, places = np.unique(codes, return_inverse=True)
    owners, boxes = np.divmod(pairs, box_count)
    pair_ranks, pair_counts = _ranks(owners, count)
    most_pairs = int(pair_counts.max())
    pair_boxes = np.zeros((count, most_pairs), np.int64)
    pair_boxes[owners, pair_ranks] = boxes
    pairs_of = (owners * most_pairs + pair_ranks)[places.reshape(-1, BOX_COUNT)]
    order = np.argsort(states.statement_of, kind="stable")
    ranks = np.empty(len(order), np.int64)
    ranks[order], counts = _ranks(states.statement_of[order], count)
    most = int(counts.max())
    scenes = np.zeros((count, most, BOX_COUNT), np.int64)
    scenes[states.statement_of, ranks] = pairs_of
    return Arrangement(pair_boxes, pair_counts, pairs_of, scenes, states.statement_of * most + ranks)


def _ranks(owners: Int64Array, count: int) -> tuple[Int64Array, Int64Array]:
    """For sorted owners, how many of the same stand before each; and how many each of `count` owners has."""
    counts = np.bincount(owners, minlength=count)
    starts = counts.cumsum() - counts
    return np.arange(len(owners)) - starts[owners], counts
