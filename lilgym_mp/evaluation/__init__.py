"""Evaluation of policies on the tasks of a split, and tables, recordings and films of the results. Without torch."""

from lilgym_mp.evaluation.policies import Observations, Policy, random_legal, random_unmasked
from lilgym_mp.evaluation.runs import Episode, Summary, evaluate, summarise
from lilgym_mp.evaluation.settings import CONFIGURATIONS, Settings

__all__ = [
    "CONFIGURATIONS",
    "Episode",
    "Observations",
    "Policy",
    "Settings",
    "Summary",
    "evaluate",
    "random_legal",
    "random_unmasked",
    "summarise",
]
