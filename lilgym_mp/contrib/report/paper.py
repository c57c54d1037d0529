"""Published results of Wu et al. (ACL 2023) for comparison. Accuracies in per cent on dev and test."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

from lilgym_mp.contrib.report.aggregation import MeanStd

SOURCE = "Wu et al., ACL 2023"
RUNS = 3
PLACES = 2  # decimals of its accuracies


PLAYED = ("TowerScratch", "TowerFlipIt", "ScatterScratch", "ScatterFlipIt")

# Tables 2 and 4: mean and standard deviation on dev and on test in each of PLAYED. Trained from rewards only; evaluated
# with sampled actions, no mask, no stop forcing.
_ACCURACIES = """
PPO C3+BERT     | 72.80 9.92 | 68.72 6.60 | 28.11 6.03 | 27.84 4.50 | 59.00 5.42 | 68.17 2.89  | 0.00 0.00  | 0.06 0.10
PPO C10+BERT    | 80.16 1.77 | 73.66 3.04 | 30.13 8.22 | 28.75 7.42 | 43.68 7.18 | 50.97 12.95 | 0.00 0.00  | 0.00 0.00
PPO ViLT        | 81.19 2.90 | 76.23 5.58 | 53.25 4.28 | 55.19 4.92 | 40.23 6.99 | 47.74 11.47 | 13.31 6.88 | 16.81 7.43
PPO+SF C3+BERT  | 81.80 0.94 | 76.54 1.85 | 32.59 3.14 | 29.55 4.74 | 72.03 3.32 | 74.41 3.25  | 17.04 1.82 | 18.16 3.07
PPO+SF C10+BERT | 77.91 2.21 | 75.62 1.41 | 37.38 2.02 | 35.70 2.08 | 73.18 2.65 | 77.85 1.62  | 8.52 2.72  | 10.55 2.45
PPO+SF ViLT     | 84.05 3.25 | 81.48 1.93 | 65.68 9.17 | 65.51 8.43 | 67.43 1.35 | 73.98 0.30  | 28.01 5.32 | 30.06 4.51
PPO FLAVA       | 75.46      | 65.43      | 62.72      | 58.79      | 12.64      | 15.48       | 1.28       | 0.68
PPO+SF FLAVA    | 84.05      | 76.24      | 58.88      | 58.21      | 17.24      | 27.10       | 7.35       | 6.94
"""


def _accuracy(cell: str) -> MeanStd:
    mean, *deviation = map(float, cell.split())
    return MeanStd(mean, deviation[0] if deviation else None, RUNS if deviation else 1, printed_places=PLACES)


# By model, and by configuration and split.
ACCURACIES: Mapping[str, Mapping[tuple[str, str], MeanStd]] = {
    model.strip(): dict(zip(product(PLAYED, ("dev", "test")), map(_accuracy, cells), strict=True))
    for model, *cells in (line.split("|") for line in _ACCURACIES.strip().splitlines())
}

# Section D.2: of 50 errors by model and configuration, the invalid actions and the shares of these by reason
# (separator, empty, does not fit, on top), and the wrong STOPs and the shares of these by kind (direct, early,
# erroneous). In per cent; None: not reported.
Shares = tuple[int, tuple[int | None, ...]]
ERRORS = {
    ("C3+BERT", "ScatterScratch"): ((58, (100, 0, 0, 0)), (42, (18, 82, None))),
    ("ViLT", "ScatterScratch"): ((82, (78, 14, 5, 3)), (18, (50, None, 50))),
    ("C3+BERT", "ScatterFlipIt"): ((58, (24, 63, 10, 3)), (42, (90, None, 10))),
    ("ViLT", "ScatterFlipIt"): ((64, (75, 19, 0, 6)), (36, (None, 100, None))),
}
