"""A language model in one seat of the proposer-verifier game."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from multiprocessing.pool import ThreadPool

import numpy as np

from lilgym_mp.contrib.llm.agents import Message, ModelError
from lilgym_mp.contrib.llm.asking import Asking
from lilgym_mp.contrib.llm.game_text import Said, ask_again, legal_choices, read_reply, rules_of, text_of_turn
from lilgym_mp.contrib.llm.summary import Turn
from lilgym_mp.envs.proposer_verifier.partners import BatchPartner, BatchTurn
from lilgym_mp.envs.proposer_verifier.protocols import Role
from lilgym_mp.envs.rules import Outcome
from lilgym_mp.scene.arrays import Int64Array
from lilgym_mp.wrappers.replies import FAILED
from lilgym_mp.wrappers.text import content_of, picture

INVALID = str(Outcome.INVALID_ACTION)
OnTurns = Callable[[str, Sequence[Turn]], None]  # called with a task and the turns of one action


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
        self._asking = asking
        self._role = role
        self._scene = scene
        self._lists_legal = legal_actions
        self._words = words
        self._notes = {} if notes is None else notes
        self._concurrency = concurrency
        self._on_turns = on_turns
        self._recalled = {task: list(turns) for task, turns in (recalled or {}).items()}
        self.messages: dict[str, list[Message]] = {}  # by task
        self.turns: defaultdict[str, list[Turn]] = defaultdict(list)
        self.errors: dict[str, str] = {}  # of failed calls

    def __repr__(self) -> str:
        return f"LanguagePartner({self._asking.agent!r}, {self._role.name.lower()})"

    def batch(self, turn: BatchTurn) -> Int64Array:
        """(k,) actions; any legal one in games that end."""
        actions = turn.action_mask.argmax(1)
        count = len(actions)
        with ThreadPool(max(1, min(self._concurrency, count))) as pool:
            for row, answer in enumerate(pool.imap(partial(self._ask, turn), range(count))):
                if isinstance(answer, str):
                    turn.endings[int(turn.indices[row])] = answer
                else:
                    self._notes[int(turn.episodes[row])] = answer.note
                    actions[row] = turn.game.encode_action(self._role, answer.choice, answer.message)
        return actions

    def _ask(self, turn: BatchTurn, row: int) -> Said | str:
        """What the model says in the game of a row, or the outcome of a game that ends."""
        game = turn.game
        role = self._role
        index = int(turn.indices[row])
        mdp = turn.games.mdp(index)
        task = mdp.task.id
        note = ""
        legal = np.zeros(0, np.bool_)
        if role is Role.PROPOSER:
            note = self._notes.get(int(turn.episodes[row]), "")
            legal = legal_choices(turn, row)
        listed = legal if self._lists_legal and len(legal) else None
        text = text_of_turn(turn, index, scene=self._scene, legal=listed, note=note)
        sees = self._scene != "list" and game.views[role].scene != "none"
        system = {"role": "system", "content": rules_of(game, role, self._words)}
        messages = self.messages.setdefault(task, [system])
        messages.append({"role": "user", "content": content_of(text, [picture(mdp.scene)] if sees else [])})

        def read(reply: str) -> tuple[str, Said] | None:
            said = read_reply(reply, game, role, legal, words=self._words, thoughts=self._asking.thoughts)
            return said and (game.describe(role, game.encode_action(role, said.choice, said.message)), said)

        asked: list[Turn] = []
        recalled = self._recalled.get(task, [])
        before = len(recalled)
        try:
            said = self._asking.choose(messages, asked, read, again=ask_again(game, role), recalled=recalled)
        except ModelError as error:
            self.errors[task] = str(error)
            return FAILED
        finally:
            self.turns[task] += asked
            self._on_turns(task, asked[before - len(recalled) :])
        if said is None:
            return str(asked[-1].problem)
        return INVALID if role is Role.PROPOSER and not legal[said.choice] else said
