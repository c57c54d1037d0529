"""The proposer-verifier game in words: the rules and views of each role, and the parsing of replies."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from lilgym_mp.envs.proposer_verifier.game import SILENCE, Game
from lilgym_mp.envs.proposer_verifier.partners import BatchTurn
from lilgym_mp.envs.proposer_verifier.protocols import NO_CHOICE, STOP_ACTION, Role
from lilgym_mp.envs.proposer_verifier.rewards import Intent
from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.appearances.places import places_of
from lilgym_mp.scene.arrays import BoolArray
from lilgym_mp.wrappers.replies import action_on, answer_text, marked_answers, parse_reply, without_lead_in
from lilgym_mp.wrappers.text import ANSWER_RULES, SCALE, answer_line, is_shown, legal_lines, reward_line, shown_lines

CLAIM = "STOP, the claim that the statement is as wanted"
AGAIN = "That does not name exactly one choice, or has a message that does not exist. {form}"
_LABELLED = re.compile(r"^[ \t*_`'\"#>-]*(message|note)[*_`'\"]*[ \t]*[:=](.*)$", re.IGNORECASE | re.MULTILINE)


class Said(NamedTuple):
    """What a reply says in the game."""

    choice: int
    message: int = SILENCE
    note: str = ""  # own words, for the other agent


def rules_of(game: Game, role: Role, words: int) -> str:
    """The rules for one agent. `words`: of a note in the verifier's own words, 0 for none."""
    appearance = game.dynamics.appearance
    view = game.views[role]
    return "\n".join(
        [
            f"A proposer and a verifier work on a picture of three boxes. You are the {role.name.lower()}. The aim"
            " is to make a statement about the picture true or false, as wanted, and then to stop."
            + ("" if view.statement != "none" else " Only the verifier knows the statement: follow what it tells you."),
            game.protocol.summary,
            *([reward_line(game.dynamics)] if game.settings.rewards == "common" else []),
            SCALE,
            *places_of(appearance.grid).explain(),
            *appearance.explain(game.dynamics.rules.placement),
            _form(game, role),
            *_message_rules(game, role, words),
        ]
    )


def _form(game: Game, role: Role) -> str:
    if role is Role.VERIFIER:
        return f"Answer with {' or '.join(game.protocol.answers)}, on a line of its own."
    example = describe(game.dynamics.appearance.example)
    stop = f"Propose {CLAIM}." if game.protocol.proposer_may_stop else "You cannot STOP; the verifier does."
    return " ".join((answer_line(game.dynamics.appearance), ANSWER_RULES.format(example=example), stop))


def _message_rules(game: Game, role: Role, words: int) -> Iterator[str]:
    size = game.message_sizes[role]
    if names_actions(game, role):
        yield (
            "Tell the proposer what to do next, on another line, as"
            f" Message: {describe(game.dynamics.appearance.example)} or Message: STOP."
        )
    elif size:
        yield f"You may add a line Message: N, with a number from 1 to {size} that is sent to the other agent."
    if words and role is Role.VERIFIER:
        yield f"You may add a line Note: with at most {words} words of your own for the proposer."


def names_actions(game: Game, role: Role) -> bool:
    """Whether messages are actions, as in games that must be talked through (`game_partners.Guide`)."""
    return game.message_sizes[role] == game.dynamics.appearance.action_count


def message_name(game: Game, role: Role, message: int) -> str:
    """A message in words."""
    if message == SILENCE or not names_actions(game, role):
        return str(message) if message else "none"
    return describe(game.dynamics.appearance.decode(message % game.message_sizes[role]))


def text_of_turn(turn: BatchTurn, index: int, *, scene: str, legal: BoolArray | None, note: str) -> str:
    """What an agent sees of game `index`. `legal`: the mask of the actions to list; `note`: the other agent's."""
    games = turn.games
    game = turn.game
    role = turn.role
    view = game.views[role]
    mdp = games.mdp(index)
    appearance = game.dynamics.appearance
    lines = [f"Statement: {mdp.task.statement}"] if view.statement != "none" else []
    if view.target:
        lines.append(f"The statement is to be {str(mdp.task.target).lower()}.")
    lines.append(f"Rounds left: {game.dynamics.horizon - mdp.steps}.")
    if view.scene != "none":
        lines += shown_lines(mdp.scene, appearance, scene, rules=False)
    for attribute, shown, text in (
        ("proposals", view.proposal and game.turn_based and role is Role.VERIFIER, "The proposer proposes"),
        ("refused", view.refused and game.has_refusals and role is Role.PROPOSER, "The verifier refused"),
    ):
        action = int(getattr(games, attribute)[index])
        if shown and action != NO_CHOICE:
            lines.append(f"{text} {CLAIM if action == STOP_ACTION else describe(appearance.decode(action))}.")
    if role is Role.PROPOSER and game.draws_intent:
        lines.append(f"Your part: {Intent(int(games.intents[index])).name.lower()}.")
    if game.message_sizes[role.other]:
        message = message_name(game, role.other, int(games.messages[role.other, index]))
        lines.append(f"Message of the {role.other.name.lower()}: {message}")
    if note:
        lines.append(f"Note of the {role.other.name.lower()}: {note}")
    lines += legal_lines(appearance, legal) if legal is not None else ()
    if role is Role.VERIFIER:
        lines.append(_form(game, role))
    return "\n".join(lines)


def ask_again(game: Game, role: Role) -> str:
    """Asks for another reply."""
    return AGAIN.format(form=_form(game, role))


def read_reply(
    reply: object, game: Game, role: Role, legal: BoolArray, *, words: int = 0, thoughts: Sequence[str]
) -> Said | None:
    """What a reply says; None unless it names one choice, and no message or one that exists.

    `legal`: the proposer's, for its actions' numbers. The note ends after `words` words.
    """
    text = answer_text(reply, thoughts)
    if text is None:
        return None
    said: dict[str, list[str]] = {"message": [], "note": []}
    for label, value in _LABELLED.findall(text):
        said[label.lower()].append(value.strip(" \t*_`'\""))
    rest = _LABELLED.sub("", text)
    choice = _choice(rest, game, role, legal, thoughts)
    messages = {_message(each, game, role) for each in said["message"]} if game.message_sizes[role] else set[int]()
    if choice is None or len(messages) > 1 or None in messages:
        return None
    note = " ".join(" ".join(said["note"]).split()[:words])
    return Said(choice, next((each for each in messages if each is not None), SILENCE), note)


def _choice(text: str, game: Game, role: Role, legal: BoolArray, thoughts: Sequence[str]) -> int | None:
    if role is Role.PROPOSER:
        appearance = game.dynamics.appearance
        parsed = parse_reply(
            text, appearance, NO_CHOICE, partial(is_shown, appearance, lambda: legal), thoughts=thoughts
        )
        return parsed.action if parsed.understood else None
    names: Mapping[str, int] = {name: index for index, name in enumerate(game.protocol.answers)}
    marked = marked_answers(text)
    found = {names.get(without_lead_in(line).lower()) for line in marked or text.splitlines()}
    if not marked:
        found -= {None}
    return found.pop() if len(found) == 1 else None


def _message(text: str, game: Game, role: Role) -> int | None:
    """The number of a message in words; None if there is no such message."""
    size = game.message_sizes[role]
    if text.rstrip(".").lower() in ("", "none", "0"):
        return SILENCE
    if names_actions(game, role):
        action = action_on(text, game.dynamics.appearance, lambda index: True)
        return None if action is None or action < 0 else action or size
    number = int(text.rstrip(".")) if text.rstrip(".").isdecimal() else 0
    return number if 0 < number <= size else None


def legal_choices(turn: BatchTurn, row: int) -> BoolArray:
    """(choices,) the actions that are legal for the proposer in the game of a row of the turn."""
    count = turn.game.dynamics.appearance.action_count
    size = turn.game.message_sizes[turn.role] + 1
    return np.asarray(turn.action_mask[row, : count * size : size] > 0)
