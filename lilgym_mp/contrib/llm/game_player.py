"""A language model in one seat of the proposer-verifier game."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.pool import ThreadPool
from typing import NamedTuple

import numpy as np

from lilgym_mp.contrib.llm.agents import Message, ModelError
from lilgym_mp.contrib.llm.asking import Asking
from lilgym_mp.contrib.llm.game_text import Said, ask_again, legal_choices, read_reply, rules_of, text_of_turn
from lilgym_mp.contrib.llm.summary import Turn
from lilgym_mp.envs.proposer_verifier.partners import BatchPartner, BatchTurn
from lilgym_mp.envs.proposer_verifier.protocols import Role
from lilgym_mp.envs.rules import Outcome
from lilgym_mp.scene.arrays import BoolArray, Int64Array
from lilgym_mp.wrappers.replies import FAILED
from lilgym_mp.wrappers.text import content_of, picture

INVALID = str(Outcome.INVALID_ACTION)
OnTurns = Callable[[str, Sequence[Turn]], None]  # called with a task and the turns of one action


class _Request(NamedTuple):
    """One game in which the model is to move."""

    index: int
    episode: int
    task: str
    legal: BoolArray


class LanguagePartner(BatchPartner):
    """A language model that plays one seat of all games of `play_games`; a new one is made for each.

    A reply without a choice, as `Asking` has it, ends the game with that outcome; so does an illegal action, and a call
    that fails for good, with the outcome FAILED. `notes`: by episode, shared by the models of both seats; `words`: of
    a note, 0 for none. `concurrency`: games asked about at the same time. `recalled`: turns of an earlier run by task,
    used up before the model is asked. `on_turns`: called from threads.
    """

    def __init__(
        self,
        asking: Asking,
        role: Role,
        *,
        scene: str = "list",
        legal_actions: bool = True,
        words: int = 0,
        notes: dict[int, str] | None = None,
        concurrency: int = 1,
        recalled: Mapping[str, Sequence[Turn]] | None = None,
        on_turns: OnTurns = lambda task, turns: None,
    ) -> None:
        self._asking, self._role = asking, role
        self._scene, self._lists_legal, self._words = scene, legal_actions, words
        self._notes = {} if notes is None else notes
        self._concurrency, self._on_turns = concurrency, on_turns
        self._recalled = {task: list(turns) for task, turns in (recalled or {}).items()}
        self.messages: dict[str, list[Message]] = {}  # by task
        self.turns: defaultdict[str, list[Turn]] = defaultdict(list)
        self.errors: dict[str, str] = {}  # of failed calls

    def __repr__(self) -> str:
        return f"LanguagePartner({self._asking.agent!r}, {self._role.name.lower()})"

    def batch(self, turn: BatchTurn) -> Int64Array:
        """(k,) actions; any legal one in games that end."""
        requests = [self._request(turn, row) for row in range(len(turn.indices))]
        game = turn.game
        with ThreadPool(max(1, min(self._concurrency, len(requests)))) as pool:
            answers = pool.map(lambda request: self._ask(turn, request), requests)
        actions = np.zeros(len(requests), np.int64)
        for row, (request, answer) in enumerate(zip(requests, answers, strict=True)):
            if isinstance(answer, str):
                turn.endings[request.index] = answer
                actions[row] = turn.action_mask[row].argmax()
            else:
                self._notes[request.episode] = answer.note
                actions[row] = game.encode_action(self._role, answer.choice, answer.message)
        return actions

    def _request(self, turn: BatchTurn, row: int) -> _Request:
        index, episode = int(turn.indices[row]), int(turn.episodes[row])
        mdp = turn.games.mdp(index)
        task = mdp.task.id
        legal = legal_choices(turn, row) if self._role is Role.PROPOSER else np.zeros(0, np.bool_)
        system = {"role": "system", "content": rules_of(turn.game, self._role, self._words)}
        note = self._notes.get(episode, "") if self._role is Role.PROPOSER else ""
        listed = legal if self._lists_legal and len(legal) else None
        text = text_of_turn(turn, index, scene=self._scene, legal=listed, note=note)
        sees = self._scene != "list" and turn.game.views[self._role].scene != "none"
        content = content_of(text, [picture(mdp.scene)] if sees else [])
        self.messages.setdefault(task, [system]).append({"role": "user", "content": content})
        return _Request(index, episode, task, legal)

    def _ask(self, turn: BatchTurn, request: _Request) -> Said | str:
        """What the model says, or the outcome of a game that ends."""
        game, role, task, legal = turn.game, self._role, request.task, request.legal

        def read(reply: str) -> tuple[str, Said] | None:
            said = read_reply(reply, game, role, legal, words=self._words, thoughts=self._asking.thoughts)
            if said is None:
                return None
            return game.describe(role, game.encode_action(role, said.choice, said.message)), said

        asked: list[Turn] = []
        recalled = self._recalled.get(task, [])
        before = len(recalled)
        try:
            said = self._asking.choose(self.messages[task], asked, read, again=ask_again(game, role), recalled=recalled)
        except ModelError as error:
            self.errors[task] = str(error)
            return FAILED
        finally:
            self.turns[task] += asked
            self._on_turns(task, asked[before - len(recalled) :])
        if said is None:
            return str(asked[-1].problem)
        if role is Role.PROPOSER and not legal[said.choice]:
            return INVALID
        return said
