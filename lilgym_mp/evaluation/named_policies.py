"""Named policies for evaluation: a name, and a policy for each configuration."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from lilgym_mp.choices import choose
from lilgym_mp.evaluation.policies import ExpertPolicy, Policy, RandomType, random_legal, random_unmasked
from lilgym_mp.evaluation.settings import CONFIGURATIONS, Settings

NO_SUPERVISION = "none"


@dataclass(frozen=True)
class NamedPolicy:
    """A policy for each configuration, with its name in tables and files."""

    name: str
    policy: Callable[[Settings], Policy]
    supervision: str = NO_SUPERVISION  # training data, for result tables
    configurations: tuple[str, ...] = tuple(CONFIGURATIONS)  # configurations that it can play
    mask: bool | None = None  # whether illegal actions are masked; None: if the policy's `needs_masks` is true
    details: Mapping[str, Any] = field(default_factory=dict[str, Any])  # further details needed to reproduce it


def _same(policy: Policy) -> Callable[[Settings], Policy]:
    """A factory that ignores the configuration."""
    return lambda settings: policy


_SAMPLED = {"actions": "sampled"}

# By name on the command line.
BUILT_IN_POLICIES: Mapping[str, NamedPolicy] = {
    "expert": NamedPolicy("expert", ExpertPolicy.of, "knows the rules, the scene and the program", mask=False),
    "random-legal": NamedPolicy("random legal", _same(random_legal), details=_SAMPLED),
    "random-unmasked": NamedPolicy("random unmasked", _same(random_unmasked), mask=False, details=_SAMPLED),
    "random-type": NamedPolicy("random type", RandomType.of, details=_SAMPLED),
}
BASELINES = (BUILT_IN_POLICIES["random-legal"], BUILT_IN_POLICIES["random-unmasked"])


def built_in_policy(name: str) -> NamedPolicy:
    """Raises ValueError naming the choices."""
    return choose("policy", name, BUILT_IN_POLICIES)
