"""Evaluation of policies on the tasks of a split, and tables, recordings and films of the results. Without torch.

`Settings` is the name here of `lilgym_mp.envs.config.EnvConfig`, for which the package itself has no other.
"""

from typing import TYPE_CHECKING, Any

from lilgym_mp.envs.config import EnvConfig as Settings
from lilgym_mp.envs.registration import CONFIGURATIONS
from lilgym_mp.evaluation.episodes import Episode
from lilgym_mp.evaluation.policies import Observations, Policy, random_legal, random_unmasked
from lilgym_mp.evaluation.runs import evaluate
from lilgym_mp.submodules import submodule_getter

if TYPE_CHECKING:
    from lilgym_mp.evaluation.results import Summary, summarise, training_statements
    from lilgym_mp.evaluation.wrapped import evaluate_wrapped

__all__ = [
    "CONFIGURATIONS",
    "Episode",
    "Observations",
    "Policy",
    "Settings",
    "Summary",
    "evaluate",
    "evaluate_wrapped",
    "random_legal",
    "random_unmasked",
    "summarise",
    "training_statements",
]


def __getattr__(name: str) -> Any:
    if name == "evaluate_wrapped":
        from lilgym_mp.evaluation.wrapped import evaluate_wrapped

        return evaluate_wrapped
    if name not in ("Summary", "summarise", "training_statements"):
        return submodule_getter(__name__)(name)
    from lilgym_mp.evaluation import results

    return getattr(results, name)
