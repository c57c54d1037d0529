"""Parses the replies of language models: one action, or none if the reply is unclear.

The answer stands on a line of its own, as `describe` names it, "ADD(LEFT, BLUE)", in words, "add left blue" or
"add_left_blue", or by its number. `reply_text`, `answer_text` and `marked_answers` serve replies of other kinds too.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, cast

from lilgym_mp.scene import Colour, Shape, Size
from lilgym_mp.scene.actions import BOX_NAMES, STOP, ActionError, named
from lilgym_mp.scene.appearances import Appearance
from lilgym_mp.scene.appearances.base import optional


class Reply(NamedTuple):
    """A parsed reply."""

    action: int  # action index
    understood: bool  # False: no action or several, so `action` is the default


# Outcomes of replies that are not the model's answer
CUT = "cut"
FILTERED = "filtered"
REFUSED = "refused"
FAILED = "failed"
NOT_UNDERSTOOD = "not_understood"
NORMAL_ENDS = frozenset(
    ("stop", "stop_sequence", "end_turn", "eos", "eos_token", "tool_calls", "tool_use", "function_call", "complete")
)
_ENDS = {
    **dict.fromkeys(("length", "max_tokens", "max_output_tokens", "model_length"), CUT),
    "model_context_window_exceeded": CUT,
    **dict.fromkeys(("content_filter", "content_filtered", "guardrail_intervened", "sensitive", "safety"), FILTERED),
    **dict.fromkeys(("recitation", "blocklist", "prohibited_content", "spii"), FILTERED),
    "refusal": REFUSED,
}

ASK_AGAIN = "That does not name exactly one action. Write the name of one legal action on a line of its own."

MAX_REPLY = 500_000  # characters; a longer reply is not understood
MAX_ANSWER = 20_000  # the same after the thought, which bounds the time of reading
MAX_LINE = 200  # a longer line names no action
UNREADABLE = -1  # instead of an action: a line that has the form of one, but names none

# Thoughts, which are not read. A name stands for its tags, such as <think>, <seed:think>, <|think|> and [THINK].
THOUGHTS = (
    "think",
    "thinking",
    "thought",
    "thoughts",
    "reasoning",
    "analysis",
    "scratchpad",
    "<|begin_of_thought|>...<|end_of_thought|>",
    "<|START_THINKING|>...<|END_THINKING|>",
    "<|channel|>analysis...<|channel|>final<|message|>",
)
_SPECIAL_TOKEN = re.compile(
    r"<\|[^<>|\n]{1,60}\|>|<｜[^<>\n]{1,60}｜>|</?s>|<(?:bos|eos|pad|unk|eot|(?:start|end)_of_turn)>"
    r"|\[/?(?:INST|BOS|EOS|PAD)\]",
    re.IGNORECASE,
)
_LATEX_FONT = re.compile(r"\\(?:text\w{0,10}|math\w{2,10}|operatorname|mbox|rm|bf|tt|sf|it)\s{0,9}\{([^{}\n]*)\}")
_LATEX_SIGN = re.compile(
    r"\\(?:(?P<escaped>[_{}#%&])|(?P<line>\\|newline\b|n(?![a-z])|n(?=add|remove|stop))"
    r"|(?P<arrow>(?:long)?[rR]ightarrow\b|to\b|implies\b)|(?P<relation>geq?|leq?|neq?|lt|gt)\b"
    r"|[,;:! ()\[\]]|(?:q?quad|left|right)\b)"
)
_RELATIONS = {"ge": ">=", "geq": ">=", "le": "<=", "leq": "<=", "ne": "!=", "neq": "!=", "lt": "<", "gt": ">"}

_DECORATION = " \t\n\r\xa0*_`'\"“”‘’#>$\\{}[]|"  # allowed around an action on its line
_BULLET = re.compile(r"[-–—+•·‣▪→✅☑]\s+|[•·‣▪→✅☑]")
_TAG = re.compile(r"<\s?(?P<end>/?)(?P<name>answer|action)\s?>", re.IGNORECASE)
_BOXED = re.compile(r"\\f?boxe?d?\s{0,9}\{")
_BRACE = re.compile(r"(?<!\\)[{}]")
_LABELLED = re.compile(
    r"^[ \t*_`'\"#>{-]*(?:(?:my|the|final|next|best|chosen)[ \t]+){0,3}(?:answer|action)"
    r"[*_`'\"]*[ \t]*[:=](?P<answer>[^\n]*)",
    re.IGNORECASE | re.MULTILINE,
)
_LEAD_IN = re.compile(
    r"^(?:(?:so|therefore|thus|ok(?:ay)?)[\s,:]+)?(?:i (?:choose|take|pick)|"
    r"(?:(?:my|the|final|next|best|chosen|single)\s+){0,3}(?:answer|action|move|choice|decision)(?:\s+is)?)?\s*[:=]?\s*",
    re.IGNORECASE,
)
_NUMBER = re.compile(r"(?:(?:action|number|no\.?)\s+)*(?P<number>\d+)", re.IGNORECASE)
_NUMBERED = re.compile(r"(?P<number>\d+)\s*[:.)=-]*\s+")
_TOOL = re.compile(r"(?:\w{1,20}\.)?(?:act|step|action)\s?\(\s*(?:action\s*[=:])?(?P<inside>.*)\)", re.IGNORECASE)
_CALL = re.compile(r"(?P<verb>ADD|REMOVE)\s*\((?P<inside>[^()]*)\)|STOP(?:\s*\(\s*\))?", re.IGNORECASE)
_PHRASE = re.compile(r"(?P<verb>add|remove)\b(?P<inside>[\w\s,-]*)", re.IGNORECASE)

_FIELDS = (BOX_NAMES, Shape.__members__, Colour.__members__, Size.__members__)  # in the order of an action's fields
_FILLERS = frozenset(
    word.upper() for word in ("a", "an", "the", "one", "to", "in", "into", "at", "on", "of", "from", "top", "block")
) | frozenset(("ITEM", "OBJECT", "BOX", "TOWER", "CELL", "COLUMN", "ROW", "COL"))


def parse_reply(
    reply: object,
    appearance: Appearance,
    default: int,
    is_shown: Callable[[int], bool] = lambda index: True,
    *,
    thoughts: Sequence[str] = THOUGHTS,
) -> Reply:
    """The action that `reply` chooses; `default`, not understood, if there is none or several.

    `reply`: any content that `reply_text` reads. Text up to the end of a thought is ignored; a reply whose thought does
    not end is not understood. If answers are marked ("Action: ...", "Answer: ...", "<answer>...</answer>",
    "\\boxed{...}"), only they count, otherwise every line that consists of one action; all of them must name the same.
    A number counts only if marked or on the last line, and if the agent was shown it (`is_shown`).
    """
    text = answer_text(reply, thoughts)
    if text is None:
        return Reply(default, understood=False)
    named = _named(text, appearance, is_shown)
    (action,) = named if len(named) == 1 else (None,)
    if action is None or action == UNREADABLE:
        return Reply(default, understood=False)
    return Reply(action, understood=True)


def unusual_end(finish_reason: object) -> str | None:
    """The outcome of a reply that a server ended so: CUT, FILTERED, REFUSED or FAILED; None if it ended normally.

    A server that gives no reason counts as normal.
    """
    name = "" if finish_reason is None else str(finish_reason).strip().lower()
    return None if not name or name in NORMAL_ENDS else _ENDS.get(name, FAILED)


def reply_text(content: object) -> str | None:
    """The text of a reply: a string, a whole number, a message, content parts, or messages, of the assistant's last.

    Parts of other types than text, such as reasoning, have none. None for any other value.
    """
    if isinstance(content, str):
        return content
    if type(content) is int and 0 <= content < 10**9:
        return str(content)
    if isinstance(content, Mapping):
        part = cast("Mapping[str, Any]", content)
        if "role" in part or "content" in part:
            inner = part.get("content")
            return None if isinstance(inner, Mapping) else reply_text(inner)
        text = part.get("text") if part.get("type", "text") in ("text", "output_text") else ""
        return text if isinstance(text, str) else None
    if not isinstance(content, list | tuple):
        return None
    parts = cast("Sequence[Any]", content)
    if parts and all(isinstance(part, Mapping) and "role" in part for part in parts):
        said = [part for part in parts if part["role"] == "assistant"]
        return reply_text(said[-1]) if said else None
    texts = [reply_text(part) for part in parts if isinstance(part, str | Mapping)]
    known = [text for text in texts if text is not None]
    return "".join(known) if len(known) == len(parts) > 0 else None


def answer_text(reply: object, thoughts: Sequence[str] = THOUGHTS) -> str | None:
    """The reply's text after its last thought, without special tokens, and LaTeX as plain text but for \\\\boxed{}.

    None if there is no text, a thought does not end, or the reply is too long.
    """
    text = reply_text(reply)
    after = None if text is None else without_thought(text, thoughts)
    if after is None:
        return None
    plain = _SPECIAL_TOKEN.sub("\n", after)
    if "\\" in plain:
        for _ in range(3):  # fonts within fonts
            plain = _LATEX_FONT.sub(r"\1", plain)
        plain = _LATEX_SIGN.sub(_sign, plain)
    return plain


def _sign(match: re.Match[str]) -> str:
    """The plain text for a sign of LaTeX, or for a line end written as in Python."""
    if match["relation"]:
        return f" {_RELATIONS[match['relation']]} "
    return match["escaped"] or ("\n" if match["line"] else " -> " if match["arrow"] else " ")


def without_thought(reply: str, thoughts: Sequence[str] = THOUGHTS) -> str | None:
    """The reply after its last thought; None if a thought does not end or the reply is too long.

    `thoughts`: names of tags, or "BEGIN...END" for a thought between these texts.
    """
    if len(reply) > MAX_REPLY:
        return None
    end: int | None = 0
    for tag in _thought_tags(tuple(thoughts)).finditer(reply):
        end = tag.end() if tag["end"] else None
    return None if end is None or len(reply) - end > MAX_ANSWER else reply[end:]


def unread_reason(reply: object, thoughts: Sequence[str] = THOUGHTS) -> str:
    """Why `answer_text` is None."""
    text = reply_text(reply)
    if text is None:
        return "the reply has no text"
    if len(text) > MAX_REPLY:
        return f"the reply has {len(text):,} characters; at most {MAX_REPLY:,} are read"
    tags = list(_thought_tags(tuple(thoughts)).finditer(text))
    if tags and not tags[-1]["end"]:
        return "a thought does not end"
    length = len(text) - (tags[-1].end() if tags else 0)
    return f"{length:,} characters outside of thoughts; at most {MAX_ANSWER:,} are read: enclose thoughts in <think>"


@lru_cache(maxsize=16)
def _thought_tags(thoughts: tuple[str, ...]) -> re.Pattern[str]:
    """Matches where a thought begins, or, as group `end`, where it ends."""
    names = [re.escape(name) for name in thoughts if "..." not in name]
    name = rf"(?:\w{{1,20}}:)?(?:{'|'.join(names)})"
    capitals = rf"(?-i:{'|'.join(map(str.upper, names))})"
    pairs = [pair.split("...", 1) for pair in thoughts if "..." in pair]
    begins = [re.escape(begin) for begin, _ in pairs]
    ends = [re.escape(end) for _, end in pairs]
    if names:
        begins += [rf"[<◁]\|?\s?{name}(?:\s[^<>]{{0,80}})?\|?[>▷]", rf"\[{capitals}\]"]
        ends += [rf"[<◁]\|?\s?/\s?{name}\s?\|?[>▷]", rf"[<◁]{name}\s?/[>▷]", rf"\[/{capitals}\]"]
    first = "|".join([r"[<◁\[][\s\w/|]", *(re.escape(text[:2]) for pair in pairs for text in pair)])
    never = r"(?!)"
    return re.compile(rf"(?={first})(?:(?P<end>{'|'.join(ends) or never})|{'|'.join(begins) or never})", re.IGNORECASE)


def marked_answers(text: str) -> list[str]:
    """The parts marked as the answer, without markup: enclosed ones if there are any, otherwise labelled ones."""
    found = enclosed_answers(text) or [match["answer"] for match in _LABELLED.finditer(text)]
    return [answer for answer in (each.strip(_DECORATION) for each in found) if answer]


def enclosed_answers(text: str) -> list[str]:
    """The parts in <answer>, <action> or \\boxed{}, in order; within tags, what is boxed there.

    The end tag may be missing, where generation stops at it, after a tag that begins a line.
    """
    found: list[str] = []
    done = 0
    begin = None
    name = ""
    for tag in _TAG.finditer(text):
        if not tag["end"]:
            begin = tag
            name = tag["name"].lower()
        elif begin is not None and tag["name"].lower() == name:
            found += _boxed(text[done : begin.start()])
            found += _boxed(text[begin.end() : tag.start()]) or [text[begin.end() : tag.start()]]
            done = tag.end()
            begin = None
    if begin is not None and not found and not text[: begin.start()].rpartition("\n")[2].strip(_DECORATION):
        return _boxed(text[begin.end() :]) or [text[begin.end() :]]
    return found + _boxed(text[done:])


def _boxed(text: str) -> list[str]:
    """The contents of \\boxed{}, whose braces may nest; up to the end of the line if they do not close."""
    opened: list[int] = []
    closed: dict[int, int] = {}  # position after an opening brace: that of its closing one
    for brace in _BRACE.finditer(text):
        if brace[0] == "{":
            opened.append(brace.end())
        elif opened:
            closed[opened.pop()] = brace.start()
    found: list[str] = []
    position = 0
    while (match := _BOXED.search(text, position)) is not None:
        line_end = text.find("\n", match.end())
        position = closed.get(match.end(), line_end if line_end >= 0 else len(text))
        found.append(text[match.end() : position])
    return found


def _named(text: str, appearance: Appearance, is_shown: Callable[[int], bool]) -> set[int | None]:
    """The actions that the reply names; None stands for a marked answer that is no action."""
    if marked := marked_answers(text):
        return {action_on(answer, appearance, is_shown) for answer in marked}
    lines = [line for line in text.splitlines() if line.strip(_DECORATION + ".")]
    actions = {action_on(line, appearance) for line in lines[:-1]}
    return {*actions, *(action_on(line, appearance, is_shown) for line in lines[-1:])} - {None}


def without_lead_in(line: str) -> str:
    """The line without a bullet, quotes, "The answer is" and punctuation around it."""
    bare = line.strip(_DECORATION)
    bare = _LEAD_IN.sub("", bare[bullet.end() :] if (bullet := _BULLET.match(bare)) else bare)
    return bare.rstrip(_DECORATION + ".,;!").strip(_DECORATION)


def action_on(line: str, appearance: Appearance, is_shown: Callable[[int], bool] = lambda index: False) -> int | None:
    """The action if the line consists of exactly one; its number alone counts only if it `is_shown`.

    UNREADABLE for a name with arguments that do not exist, or beside another action's number.
    """
    if len(line) > MAX_LINE:
        return None
    bare = without_lead_in(line)
    if tool := _TOOL.fullmatch(bare):
        bare = tool["inside"].strip(_DECORATION)
    if alone := _NUMBER.fullmatch(bare):
        number = int(alone["number"])
        return number if number < appearance.action_count and is_shown(number) else None
    numbered = _NUMBERED.match(bare)
    name = bare[numbered.end() :] if numbered else bare
    if name.startswith("(") and name.endswith(")"):
        name = name[1:-1]
    name = name.replace("_", " ")
    call = _CALL.fullmatch(name)
    match = call or _PHRASE.fullmatch(name)
    action = _encoded(match, appearance) if match else None
    if (call and action is None) or (action is not None and numbered and int(numbered["number"]) != action):
        return UNREADABLE
    return action


def _encoded(match: re.Match[str], appearance: Appearance) -> int | None:
    """The index of the action in a match of _CALL or _PHRASE."""
    if match.re is _CALL and match["verb"] is None:
        return appearance.encode(STOP)
    return _edit(match["verb"], match["inside"], appearance)


@lru_cache(64)  # many replies repeat themselves
def _edit(verb: str, inside: str, appearance: Appearance) -> int | None:
    ignored = optional(appearance, "given_words") or ()
    words = sorted((word for word in _words(inside) if word not in ignored), key=_field)
    try:
        return appearance.encode(named(f"{verb}({', '.join(words)})"))
    except ActionError:
        return None


def _field(word: str) -> int:
    """Where the word belongs among an action's fields: first a column, a row or a box; last what is none of them."""
    matching = (index for index, names in enumerate(_FIELDS) if word in names)
    return 0 if word.isdecimal() else next(matching, len(_FIELDS))


def _words(inside: str) -> Iterator[str]:
    """The words of an action's arguments, without fillers; "row 4, column 3" is put in column-row order."""
    words = re.findall(r"\w+", inside.upper())
    for first, second in (("ROW", "COLUMN"), ("ROW", "COL")):
        if first in words and second in words and words.index(first) < words.index(second):
            row, column = (words.index(name) + 1 for name in (first, second))
            if row < len(words) and column < len(words):
                words[row], words[column] = words[column], words[row]
    return (word for word in words if word not in _FILLERS)
