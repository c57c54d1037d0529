"""Tasks for training language models with verifiable rewards: endless prompts, and exact scores for replies.

`rows` generates tasks as JSON-ready rows of three kinds: plan, truth and program. `row.prompt` is the text for
the model, `messages_of(row, scene)` the same with a picture, `score(reply, row)` the reward; `Conversation` plays a
plan task over several turns. `solutions` are the baselines. docs/language_models.md shows how to train with
them.
"""

from lilgym_mp.contrib.rlvr.generation import rows
from lilgym_mp.contrib.rlvr.rows import KINDS, Row, RowError, images_of, messages_of
from lilgym_mp.contrib.rlvr.scoring import REWARDS, Conversation, Score, Turn, score
from lilgym_mp.contrib.rlvr.solutions import BASELINES, expert_reply, random_reply

__all__ = [
    "BASELINES",
    "KINDS",
    "REWARDS",
    "Conversation",
    "Row",
    "RowError",
    "Score",
    "Turn",
    "expert_reply",
    "images_of",
    "messages_of",
    "random_reply",
    "rows",
    "score",
]
