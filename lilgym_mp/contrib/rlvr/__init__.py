"""Tasks for training language models with verifiable rewards: endless prompts, and exact scores for replies.

`rows` generates tasks as JSON-ready rows of three kinds: plan, truth and program. `row.prompt` is the text for
the model, `messages_of(row, scene)` the same with a picture, `score(reply, row)` the reward; `Conversation` plays a
plan task over several turns. docs/language_models.md shows how to train with them.
"""

from lilgym_mp.contrib.rlvr.generation import rows
from lilgym_mp.contrib.rlvr.rows import KINDS, Row, RowError, expert_reply, images_of, messages_of
from lilgym_mp.contrib.rlvr.scoring import Conversation, score
from lilgym_mp.submodules import submodule_getter

__all__ = [
    "KINDS",
    "Conversation",
    "Row",
    "RowError",
    "expert_reply",
    "images_of",
    "messages_of",
    "rows",
    "score",
]

__getattr__ = submodule_getter(__name__)
