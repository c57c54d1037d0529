"""Platt scaling of the planner's success probabilities, fitted on held-out statements."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
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


class Bin(NamedTuple):
    """Forecasts with similar probabilities."""

    forecasts: int
    mean_probability: float
    success_rate: float


def reliability(forecasts: Sequence[Forecast], edges: Sequence[float] = (0.5, 0.7, 0.8, 0.9, 0.95)) -> list[Bin]:
    """Data of a reliability diagram: success rate by predicted probability; empty bins are left out."""
    bins: list[Bin] = []
    for low, high in zip((0.0, *edges), (*edges, math.inf), strict=True):
        inside = [forecast for forecast in forecasts if low <= forecast.probability < high]
        if inside:
            mean = sum(forecast.probability for forecast in inside) / len(inside)
            bins.append(Bin(len(inside), mean, sum(forecast.success for forecast in inside) / len(inside)))
    return bins


def _logit(probability: float) -> float:
    clipped = min(1 - CLIP, max(CLIP, probability))
    return math.log(clipped / (1 - clipped))


def _logistic(x: float) -> float:
    return 1 / (1 + math.exp(-max(-30.0, min(30.0, x))))
