"""Language models as agents: conversations over `TextObservation`, transcripts, token counts and progression.

docs/language_models.md explains how to plug in a model.
"""

from lilgym_mp.contrib.llm.agents import Answer, LanguageAgent, ModelError, make_agent
from lilgym_mp.contrib.llm.player import Player, play_all
from lilgym_mp.contrib.llm.summary import (
    Failure,
    Transcript,
    progression,
    success_interval,
    summarise_transcripts,
    wilson_interval,
)
from lilgym_mp.submodules import submodule_getter

__all__ = [
    "Answer",
    "Failure",
    "LanguageAgent",
    "ModelError",
    "Player",
    "Transcript",
    "make_agent",
    "play_all",
    "progression",
    "success_interval",
    "summarise_transcripts",
    "wilson_interval",
]

__getattr__ = submodule_getter(__name__)
