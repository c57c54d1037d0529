"""Platt scaling of the planner's success probabilities, fitted on held-out statements."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

NEWTON_STEPS = 50
CLIP = 1e-3  # probabilities are clipped to [CLIP, 1 - CLIP]
PRIOR = 1.0  # precision of the Gaussian prior on the identity, slope 1 and shift 0


class Forecast(NamedTuple):
    """A predicted probability of success, and the outcome."""

    probability: float
    success: bool


@dataclass(frozen=True)
class Calibration:
    """Logistic recalibration of a probability (Platt 1999)."""

    slope: float = 1.0
    shift: float = 0.0

    def __call__(self, probability: float) -> float:
        return 0.0 if probability <= 0 else _logistic(self.slope * _logit(probability) + self.shift)


def fit_calibration(forecasts: Iterable[Forecast]) -> Calibration:
    """The maximum a posteriori calibration; the identity without forecasts."""
    points = [(_logit(probability), float(success)) for probability, success in forecasts]
    logits, successes = np.array(points).reshape(-1, 2).T
    features = np.stack([logits, np.ones_like(logits)])
    prior = fitted = np.array([1.0, 0.0])  # slope and shift
    for _ in range(NEWTON_STEPS):
        predicted = np.array([_logistic(x) for x in fitted @ features])
        gradient = PRIOR * (fitted - prior) + features @ (predicted - successes)
        curvature = PRIOR * np.eye(2) + features * (predicted * (1 - predicted)) @ features.T
        fitted = fitted - np.linalg.solve(curvature, gradient)
    return Calibration(max(0.0, float(fitted[0])), float(fitted[1]))


def _logit(probability: float) -> float:
    clipped = min(1 - CLIP, max(CLIP, probability))
    return math.log(clipped / (1 - clipped))


def _logistic(x: float) -> float:
    return 1 / (1 + math.exp(-max(-30.0, min(30.0, x))))
