"""Which program texts are accepted, and the errors for rejected ones."""

import pickle

from hypothesis import given
from hypothesis import strategies as st

from lilgym_mp.programs import ProgramError, compile_program
from lilgym_mp.programs.syntax import MAX_DEPTH, MAX_LENGTH
from lilgym_mp.programs.words import WORDS
from tests.stress.program_language import repeated

REFUSED = {
    "": "empty",
    " \t": "empty",
    "x": "unknown name",
    "exist(filter_obj(all_items, is_yelow))": "did you mean is_yellow",
    "exit(all_items)": "unknown function",
    "print(1)": "unknown function",
    "__import__(1)": "underscore",
    "all_items.__class__": "underscore",
    "all_items[0].box.scene": "unknown member",
    "Color.YELLOW.value": "unknown member",
    "Color.GREEN": "choose from YELLOW, BLACK, BLUE",
    "Color": "needs a member",
    "Colour.BLUE": "did you mean Color",
    "exist()": "missing a required argument: 's'",
    "exist(all_items, 1)": "too many",
    "exist(s=1, s=1)": "given twice",
    "exist(1, s=1)": "multiple values for argument 's'",
    "exist(all_items, t=1)": "unexpected keyword argument 't'",
    "min(all_boxes, count)": "too many",
    "all_boxes[0].is_tower(1)": "takes no arguments",
    "all_items[0].box()": "without ()",
    "all_items()": "not a function",
    "(lambda x: x)(1)": "only words",
    "all_boxes[0](1)": "only words",
    "All(all_items, lambda f: f(1))": "not a function",
    "lambda: 1": "exactly one parameter",
    "lambda x=1: 1": "exactly one parameter",
    "lambda count: 1": "is a word of the language",
    "[x for x in all_items]": "'for' is not part",
    "1 if 1 else 2": "'if' is not part",
    "None": "'None' is not part",
    '"a"': "strings",
    "(x := 1)": "assignments",
    "x = 1": "not a Python expression",
    "exist(*all_items)": "only operators",
    "2 ** 3": "only operators",
    "+1": "only operators",
    "1.5": "only integers",
    "1e3": "must be followed by",
    "007": "cannot start with 0",
    "1000001": "at most 1000000",
    "9" * 4_999: "at most 1000000",
    "(1, 2)": "tuples",
    "{}": "dictionaries",
    "all_items[0, 1]": "one index",
    "all_items[0:1, 1]": "one index",
    "exist(all_items": "never closed",
    "exist)": "never opened",
    "exist(]": "never opened",
    "1 2": "not a Python expression",
    "1\n== 1": "one line",
    "exist(all_items)\n": "one line",
    "1 # one": "comments",
    "a\0b": "null",
    "é": "ASCII",
    "\udc80": "ASCII",
    "(" * 10_000: "at most 5000 characters",
    "x" * 1_000_000: "at most 5000 characters",
    "(" * 2_000 + ")" * 2_000: "brackets are nested",
    "not " * 1_200 + "True": "nested",
    "lambda x: " * 490 + "1": "nested",
    "1 < " + "not " * 70 + "1": "not a Python expression",
}


def refusal(text):
    """The ProgramError of a text, or None for a valid program; other exceptions propagate."""
    try:
        compile_program(text)
    except ProgramError as fault:
        return fault
    return None


def test_refused_sources__are_program_errors_that_name_the_rule():
    for source, rule in REFUSED.items():
        fault = refusal(source)
        assert rule in fault.reason, source[:80]
        assert fault.source == source


ACCEPTED = (
    "True",
    "  exist(all_items)\t",
    "exist(s=all_items)",
    "1 < 2 <= 3 != 4 == 4",
    "not 1 in [1] and 2 not in {3} or True",
    "count(all_boxes[0:2]) % 2 + 1 == 1",
    "All(all_items, lambda x: exist(filter_obj(x.box, lambda x: is_top(x))))",
    "count(min(all_boxes, key=count)) == 0",
    "is_touching_wall(all_items[0], side=Side.TOP)",
    "all_items[0].color == Color.BLUE or all_items[0].shape == Shape.CIRCLE or all_items[0].size == Size.BIG",
    "exist(filter_obj(all_boxes, lambda b: b.is_tower))",
)


def test_accepted_sources__compile():
    assert tuple(compile_program(source).source for source in ACCEPTED) == ACCEPTED


def test_program_error__explain_puts_carets_under_the_piece():
    _, line, caret, where = refusal("count(all_itms) == 1").explain().split("\n")
    assert line[caret.index("^") : caret.rindex("^") + 1] == "all_itms"
    assert where == "line 1, column 7"


def test_program_error__explain_clips_long_sources_and_escapes_control_characters():
    for source in ("x" * 1_000_000, "count(" + "é\0\udc80" * 1_000, "1\n" * 1_000, "True" + " or True" * 500 + " or x"):
        fault = refusal(source)
        assert all(len(line) < 200 for line in fault.explain().split("\n"))
        assert len(str(fault)) < 300
        assert fault.explain().isascii()


def test_program_error__survives_pickling():
    fault = refusal("cuont(all_items)")
    copy = pickle.loads(pickle.dumps(fault))
    assert (copy.position, copy.reason, str(copy)) == (fault.position, fault.reason, str(fault))


PIECES = ("exist", "(", ")", "all_items", ",", "lambda", " ", "x", ":", "1", "==", "not", "[", "]", ".", "Color", "=")


@given(st.lists(st.sampled_from((*PIECES, "{", "}", "box", "*", "\\", "'", "in", "%", "BLUE")), max_size=25))
def test_any_sequence_of_tokens__compiles_or_is_a_program_error(pieces):
    fault = refusal(" ".join(pieces))
    assert fault is None or 0 <= fault.offset <= len(fault.source)


def test_limits__leave_room_for_long_and_deep_programs():
    assert compile_program("True" + " and True" * 500)
    assert compile_program(repeated(MAX_DEPTH - 4, "NOT({1})", "exist(all_items)"))
    assert len("True" + " and True" * 500) < MAX_LENGTH


def test_every_word__has_a_description_and_can_be_called():
    assert len([word for word in WORDS.values() if word.group != "built-ins"]) >= 73  # the release's
    for word in WORDS.values():
        assert word.meaning, word.name
        compile_program(f"exist({word.name})")
