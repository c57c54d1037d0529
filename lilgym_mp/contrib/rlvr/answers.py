"""Reads the answers in models' replies. Any text is either understood or not, in bounded time."""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from itertools import chain

from lilgym_mp.scene.actions import STOP
from lilgym_mp.scene.appearances import Appearance
from lilgym_mp.wrappers.replies import (
    THOUGHTS,
    UNREADABLE,
    action_on,
    answer_text,
    enclosed_answers,
    marked_answers,
    unread_reason,
    without_lead_in,
)

MAX_LINES = 500  # candidate lines of a plan

_PREFIX = re.compile(  # markup, a label such as "Final plan:" or "Step 2:", a number or letter and "then"
    r"[\W_]{0,9}(?:(?:(?:my|the|final|complete|full|first|next|last|best|chosen)[ \t]+){0,3}"
    r"(?:(?P<whole>answer|(?:action[ \t])?plan|solution)|(?P<action>action)|step|move"
    r"|[a-z]{1,12}(?=[ \t]?#?\d{1,3}[.):]))s?(?![ \t]?\([^\W\d])(?:[ \t]is)?(?:[ \t]?#?\d{1,3})?[\W_]{1,9})?"
    r"(?:(?:\d{1,3}(?:st|nd|rd|th)?|(?:[a-z]|[ivx]{2,4})(?=[.):]))[\W_]{1,9})?"
    r"(?:(?:first|second|third|then|next|finally|lastly|now|and|please|after that|afterwards)\b[\W_]{1,9}){0,3}",
    re.IGNORECASE,
)
_VERB = r"(?:add|remove|stop)(?![^\W_])"
_BEFORE_VERB = rf"(?=[\W_]{{0,9}}(?:\d{{1,3}}[.):]\s{{0,3}})?{_VERB})"
_LIKE_ACTION = re.compile(rf"(?:\d{{1,3}}x\s)?{_VERB}|[A-Z]\w{{1,20}}\s?\([^()]*\)\W*$", re.IGNORECASE)
_CALL_IN_TEXT = re.compile(r"(?<![^\W_])(?:add|remove|place|put|delete|take)\s?\(", re.IGNORECASE)
_JOIN = r"(?:and|then|finally|next|lastly|afterwards|after that|followed by)\b"
_BETWEEN = re.compile(
    rf";|<br ?/?>|[-=–—]{{1,3}}>|→|⇒|(?:,|(?<=\))[.\s]|\b{_JOIN})(?:[\s,:]{{0,3}}{_JOIN}){{0,3}}{_BEFORE_VERB}",
    re.IGNORECASE,
)  # actions on one line
_VERB_STEMS = """
    add clear delet discard do done drop eras finish halt insert mov no-op noop nothing pass pick plac put remov replac
    skip stack stop swap tak undo wait
"""
_WORDS = r"""
    a an another and at away block blocks blue bottom bottommost box big black cell center centre circle circles col
    column down from green here in inside into it item items large left leftmost medium middle object nothing
    objects of off on one onto out over position red right rightmost row side small square squares stack stop
    the then to top topmost tower triangle triangles turn up white with x y yellow \d{1,3}
"""
_IN_OTHER_WORDS = re.compile(  # no other words than those of actions: "Put a blue block left", "Removing right", "PASS"
    rf"(?:{'|'.join(_VERB_STEMS.split())})(?:(?:pp?|tt?)?ing|e?d|e?s|e)?"
    rf"(?:[^\w\n]{{1,4}}(?:{'|'.join(_WORDS.split())})){{0,16}}[^\w\n]{{0,9}}",
    re.IGNORECASE,
)
_SENTENCE = re.compile(  # begins in small letters, as in "Stop when it is true"
    r"(?:Add|Remove|Stop|add|remove|stop)\s(?=.*\b(?:because|since|so|as|that|which|until|unless|when|once|if|while|it"
    r"|this|is|are|was|will|would|can|could|should|must|needs?|not)\b)"
)
_BARE_NUMBER = re.compile(r"[\W_]{0,9}(?:(?:act|action|step|move)\s?\(?\s?)?\d+[\s)*_`]{0,9}")
_TRUTH = re.compile(r"[^\w?!~¬≠]*(true|false)[^\w?]*", re.IGNORECASE)
_FENCED = re.compile(r"```(?:python|py)?[ \t]*\n(.*?)```", re.IGNORECASE | re.DOTALL)
_PROGRAM_LABEL = re.compile(r"\W*(?:(?:my|the|final)\s+){0,2}(?:answer|program)\W*[:=]", re.IGNORECASE)


class NotUnderstood(ValueError):
    """A reply without a readable answer; the message says why."""


def read_plan(reply: object, appearance: Appearance, *, thoughts: Sequence[str] = THOUGHTS) -> list[int]:
    """The indices of the actions on lines that consist of actions, in order.

    Only marked parts count, if there are any: what is enclosed, or what follows the first "Answer:" or "Plan:". Raises
    NotUnderstood, also if a line looks like an action and cannot be read, since the plan would lack it.
    """
    text = html.unescape(_answer_text(reply, thoughts))
    plans = [_plan(_lines(part), appearance) for part in enclosed_answers(text)]
    if not plans:
        lines = _lines(text)
        labelled = next((index for index, line in enumerate(lines) if _prefix(line)["whole"]), 0)
        plans = [_plan(lines[labelled:], appearance) or _plan(lines[:labelled], appearance)]
    stop = appearance.encode(STOP)
    if plans[0][-1:] == [stop] and all(plan == plans[0] for plan in plans):
        plans = plans[:1]  # a plan that is stated several times
    joined = list(chain.from_iterable(plans))
    if not joined:
        raise NotUnderstood("no line is an action")
    if stop in joined[:-1]:
        raise NotUnderstood("actions follow STOP")
    return joined


def _lines(text: str) -> list[str]:
    """The lines with a word or number."""
    return [line for line in text.splitlines() if re.search(r"\w", line)]


def _plan(lines: Sequence[str], appearance: Appearance) -> list[int]:
    plan: list[int] = []
    candidates = 0
    is_labelled = False
    for line in lines:
        prefix = _prefix(line)
        rest = line[prefix.end() :]
        labels = prefix["action"] is not None and bool(rest) and (":" in prefix[0] or "=" in prefix[0])
        bare = line.lstrip(" \t*_`'\"->#")
        is_like_action = _LIKE_ACTION.match(rest) or any(map(_IN_OTHER_WORDS.fullmatch, (rest, bare)))
        if not (labels or is_like_action or _BARE_NUMBER.fullmatch(line)):
            if _CALL_IN_TEXT.search(line):
                raise NotUnderstood(f"{line.strip()!r:.80} has an action within text; the plan would lack it")
            continue
        candidates += 1
        if candidates > MAX_LINES:
            raise NotUnderstood(f"more than {MAX_LINES} lines begin like actions")
        if labels and plan and not is_labelled:
            raise NotUnderstood('actions stand before the first "Action:"')
        is_labelled = is_labelled or labels
        actions = [_action(part, appearance) for part in _BETWEEN.split(rest, MAX_LINES) if part.strip(" \t.,*_`'\"")]
        if None not in actions and actions:
            plan += [action for action in actions if action is not None]
        elif labels or not _SENTENCE.match(rest):
            raise NotUnderstood(f"{line.strip()!r:.80} looks like an action and names none")
    return plan


def _prefix(line: str) -> re.Match[str]:
    match = _PREFIX.match(line)
    assert match is not None, "every part of it is optional"
    return match


def _action(part: str, appearance: Appearance) -> int | None:
    name = part[_prefix(part).end() :].rstrip(" \t.,*_`'\"")
    action = action_on(name[:-1] if name.count(")") > name.count("(") else name, appearance)
    return None if action == UNREADABLE else action


def read_truth(reply: object, *, thoughts: Sequence[str] = THOUGHTS) -> bool:
    """True or false. Raises NotUnderstood."""
    text = _answer_text(reply, thoughts)
    marked = marked_answers(text)
    found = {_TRUTH.fullmatch(without_lead_in(line)) for line in marked or text.splitlines()}
    if marked and None in found:
        raise NotUnderstood("a marked answer is neither true nor false")
    values = {match[1].lower() for match in found if match is not None}
    if len(values) != 1:
        raise NotUnderstood("true and false are both answers" if values else "no line is true or false")
    return values == {"true"}


def read_program(reply: object, *, thoughts: Sequence[str] = THOUGHTS) -> str:
    """The marked program, or else the last line, without markup. Raises NotUnderstood."""
    text = _answer_text(reply, thoughts)
    enclosed = enclosed_answers(text) or _FENCED.findall(text)[-1:]
    lines = [line for line in text.splitlines() if line.strip(" \t`*$")]
    labelled = [line for line in lines if (label := _PROGRAM_LABEL.match(line)) and line[label.end() :].strip(" `*")]
    found = {_program(part) for part in enclosed or labelled or lines[-1:]} - {""}
    if len(found) != 1:
        raise NotUnderstood("there are several programs" if found else "there is no program")
    return found.pop()[:10_000]


def _program(text: str) -> str:
    """The program in a marked part, whose lines are joined, without comments, markup and label."""
    code = re.sub(r"(?m)#.*|^[ \t]*```.*", "", html.unescape(text))
    bare = " ".join(code.split()).strip("`*$ ")
    label = _PROGRAM_LABEL.match(bare)
    return (bare[label.end() :] if label else bare).strip("`*$ ").rstrip("`*$ .;")


def _answer_text(reply: object, thoughts: Sequence[str]) -> str:
    text = answer_text(reply, thoughts)
    if text is None:
        raise NotUnderstood(unread_reason(reply, thoughts))
    return text
