"""Who can be evaluated: something with a name that gives a policy for each configuration it plays."""

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
    """A policy, or one for each configuration, with its name in tables and files."""

    name: str
    policy: Callable[[Settings], Policy]
    supervision: str = NO_SUPERVISION  # what it learnt from
    configurations: tuple[str, ...] = tuple(CONFIGURATIONS)  # that it can play
    mask: bool | None = None  # whether illegal actions are kept from it; None: where its policy asks for masks
    details: Mapping[str, Any] = field(default_factory=dict[str, Any])  # what else is needed to get it again


def _same(policy: Policy) -> Callable[[Settings], Policy]:
    """The same policy whatever the configuration."""
    return lambda settings: policy


_DRAWS = {"actions": "sampled"}

# By name on the command line; see `policies` for what each does.
BUILT_IN: Mapping[str, NamedPolicy] = {
    "expert": NamedPolicy("expert", ExpertPolicy.of, "knows the rules, the scene and the program", mask=False),
    "random-legal": NamedPolicy("random legal", _same(random_legal), details=_DRAWS),
    "random-unmasked": NamedPolicy("random unmasked", _same(random_unmasked), mask=False, details=_DRAWS),
    "random-type": NamedPolicy("random type", RandomType.of, details=_DRAWS),
}
BASELINES = (BUILT_IN["random-legal"], BUILT_IN["random-unmasked"])


def built_in(name: str) -> NamedPolicy:
    """Raises ValueError naming the choices."""
    return choose("policy", name, BUILT_IN)
