"""Language models as agents: conversations over `TextObservation`, transcripts, token counts and progression.

docs/language_models.md explains how to plug in a model.
"""

from lilgym_mp.contrib.llm.agents import Answer, LanguageAgent, ModelError, make_agent
from lilgym_mp.contrib.llm.player import Player, play_all
from lilgym_mp.contrib.llm.summary import Episode, Failure, progression, success_interval, summarise, wilson_interval
from lilgym_mp.submodules import submodule_getter

__all__ = [
    "Answer",
    "Episode",
    "Failure",
    "LanguageAgent",
    "ModelError",
    "Player",
    "make_agent",
    "play_all",
    "progression",
    "success_interval",
    "summarise",
    "wilson_interval",
]

__getattr__ = submodule_getter(__name__)
