"""Language models as agents: conversations over `TextObservation`, what they cost, and how far they get.

docs/language_models.md tells how to bring a model.
"""

from lilgym_mp.llm.agents import AGENTS, Answer, ExpertAgent, HTTPAgent, LanguageAgent, RandomAgent, make_agent
from lilgym_mp.llm.balrog import BalrogEnv
from lilgym_mp.llm.player import Episode, Player
from lilgym_mp.llm.summary import Summary, progression, summarise, wilson_interval

__all__ = [
    "AGENTS",
    "Answer",
    "BalrogEnv",
    "Episode",
    "ExpertAgent",
    "HTTPAgent",
    "LanguageAgent",
    "Player",
    "RandomAgent",
    "Summary",
    "make_agent",
    "progression",
    "summarise",
    "wilson_interval",
]
