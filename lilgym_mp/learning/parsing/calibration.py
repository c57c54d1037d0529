"""How sure the planner may be: its probabilities against what happens, on statements that were not learnt from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

STEPS = 50  # of Newton's method
CLIPPED = 1e-3  # how near to 0 or 1 a probability may come
PRIOR = 1.0  # weight of the belief that probabilities are right as they are


class Forecast(NamedTuple):
    """A probability of success that was stated, and whether it came true."""

    probability: float
    success: bool


@dataclass(frozen=True)
class Calibration:
    """A logistic curve from probabilities as they are added up to probabilities as they come true (Platt 1999)."""

    slope: float = 1.0
    shift: float = 0.0

    def __call__(self, probability: float) -> float:
        return 0.0 if probability <= 0 else _logistic(self.slope * _logit(probability) + self.shift)


def fit_calibration(forecasts: Iterable[Forecast]) -> Calibration:
    """The likeliest curve for the forecasts; without any, probabilities as they are."""
    points = [(_logit(probability), float(success)) for probability, success in forecasts]
    slope, shift = 1.0, 0.0
    for _ in range(STEPS):
        gradient = [PRIOR * (slope - 1), PRIOR * shift]
        curvature = [PRIOR, 0.0, PRIOR]
        for x, success in points:
            found = _logistic(slope * x + shift)
            weight = found * (1 - found)
            gradient = [gradient[0] + (found - success) * x, gradient[1] + found - success]
            curvature = [curvature[0] + weight * x * x, curvature[1] + weight * x, curvature[2] + weight]
        determinant = curvature[0] * curvature[2] - curvature[1] ** 2
        slope -= (curvature[2] * gradient[0] - curvature[1] * gradient[1]) / determinant
        shift -= (curvature[0] * gradient[1] - curvature[1] * gradient[0]) / determinant
    return Calibration(max(0.0, slope), shift)


class Bin(NamedTuple):
    """Forecasts of about the same probability."""

    forecasts: int
    stated: float  # mean
    came_true: float  # share


def reliability(forecasts: Sequence[Forecast], edges: Sequence[float] = (0.5, 0.7, 0.8, 0.9, 0.95)) -> list[Bin]:
    """What a reliability diagram shows: by range of the stated probability, how often it came true."""
    bins: list[Bin] = []
    for low, high in zip((0.0, *edges), (*edges, math.inf), strict=True):
        inside = [forecast for forecast in forecasts if low <= forecast.probability < high]
        if inside:
            stated = sum(forecast.probability for forecast in inside) / len(inside)
            bins.append(Bin(len(inside), stated, sum(forecast.success for forecast in inside) / len(inside)))
    return bins


def _logit(probability: float) -> float:
    clipped = min(1 - CLIPPED, max(CLIPPED, probability))
    return math.log(clipped / (1 - clipped))


def _logistic(x: float) -> float:
    return 1 / (1 + math.exp(-max(-30.0, min(30.0, x))))
