"""Stress test of the program language: adversarial programs against its limits.

Each attack runs in its own process with limited CPU time and memory.
"""

import multiprocessing
import resource
import sys
from itertools import islice
from time import process_time

from lilgym_mp.programs import Program, ProgramError
from lilgym_mp.scene import Colour, Item, Scene, Shape, Size
from tests.stress.program_truth import value

SECONDS = 40  # CPU time per attack
MEGABYTES = 300  # on top of the initial process size
ITEMS = 72  # the most that generated code accepts


def nested(levels, step, leaf, first):
    """`leaf` inside `levels` lambdas with parameters v1, v2, ...; each is bound to `step` of the previous one."""
    source = leaf
    for level in range(levels, 0, -1):
        source = f"All([{step.format(f'v{level - 1}')}], lambda v{level}: {source})"
    return f"All([{first}], lambda v0: {source})"


def loops(variables, leaf):
    """`leaf` inside nested loops over all items."""
    return "".join(f"All(all_items, lambda {name}: " for name in variables) + leaf + ")" * len(variables)


def repeated(levels, outer, leaf):
    source = leaf
    for level in range(levels):
        source = outer.format(f"b{level}", source)
    return source


SHARED = "[{0}, {0}]"
DOUBLED = "{0} + {0}"
PAIRS, TRIPLES = "combinations(all_items, 2)", "combinations(all_items, 3)"
ATTACKS = {
    **{
        f"shared lists, {leaf}": nested(25, SHARED, leaf.format("v25"), "1")
        for leaf in ("equal({0}, 1)", "{0} == {0}", "all_same({0})", "min([{0}, {0}]) == 1", "{0} in {0}")
    },
    "choices of all but one, as lists": nested(13, DOUBLED, "exist(select(24575, v13))", "all_boxes"),
    "choices of all but one, as tuples": nested(13, DOUBLED, "exist(combinations(v13, 24575))", "all_boxes"),
    "parts of a union": nested(14, DOUBLED, f"exist(union_all([{', '.join(['v14'] * 300)}]))", "all_items"),
    "sorting pairs": loops("abc", f"exist(set({PAIRS}))"),
    "sorting seven boxes": loops("abcd", f"exist(set(combinations({' + '.join(['all_boxes'] * 6)}, 7)))"),
    "hashing choices of choices": "exist(set(combinations(combinations(all_boxes + all_boxes, 3), 2)))",
    "loops": loops("abcdef", "True"),
    "loops of a long condition": loops("abcd", " and ".join(["True"] * 500)),
    "loops of tests": loops("abcd", "is_top(d) == is_top(a)"),
    "loops of relations": loops("abc", "count(get_img_all_above(all_items)) >= 0"),
    "loops of equalities": loops("abc", "equal(set(all_items), all_items)"),
    "loops of counts": loops("abc", "count(query_color(all_items)) > 0"),
    "loops of displays": loops("abc", "exist({" + ", ".join(["a", "b", "c"] * 300) + "})"),
    "loops of lists": loops("abc", "exist((all_items + all_items)[0:])"),
    "loops of unions": loops("ab", f"exist(intersect_all([{', '.join(['all_items'] * 300)}]))"),
    "loops of membership": f"All({PAIRS}, lambda a: All({PAIRS}, lambda b: a in {PAIRS}))",
    "pairs of triples": f"All({TRIPLES}, lambda a: All({TRIPLES}, lambda b: a == b))",
    "many lists held": "exist([" + ", ".join([TRIPLES] * 150) + "])",
    "many sets held": "exist([" + ", ".join([f"set({PAIRS})"] * 120) + "])",
    "arguments held": f"equal({TRIPLES}, " * 20 + "1" + ")" * 20,
    "values of a function held": f"all_same_attribute({TRIPLES}, lambda q: {TRIPLES})",
    "keys": f"min({TRIPLES}, key=lambda q: {TRIPLES}) == 1",
    "a function of itself": "All([lambda f: All([f], f)], lambda g: All([g], g))",
    "lists of lists of lists": "exist(select(2, select(2, select(2, select(2, all_boxes + all_boxes)))))",
    "text that trebles": repeated(14, "All(filter_obj([all_boxes[0]], lambda {0}: {1}), lambda c: 1 == 1)", "1 == 1"),
    "text of three boxes": repeated(19, "All(all_boxes, lambda {0}: {1} and exist({0}))", "True"),
    "text of filters": repeated(14, "Any(filter_obj(all_boxes, lambda {0}: {1} and exist({0})), exist)", "1 == 1"),
    "text of tuples": f"exist(combinations([{', '.join(['all_boxes[0]'] * 200)}], 2))",
}


def crowded_scene(count):
    """A scene of `count` small items, which may overlap."""
    items = [Item(3 * (n % 30), 3 * (n // 30 % 30), Shape(n % 3), Colour(n // 3 % 3), Size.SMALL) for n in range(count)]
    return Scene.of(items[::3], items[1::3], items[2::3])


def attack(source, items=ITEMS):
    """Time, memory and outcome of compiling and evaluating `source`."""
    before, begun = _peak(), process_time()
    try:
        program = Program(source)
    except ProgramError as fault:
        result = str(fault)
        compiled = process_time()
    else:
        compiled = process_time()
        result = value(program, crowded_scene(items))
    ended = process_time()
    return {
        "compile_seconds": compiled - begun,
        "seconds": ended - compiled,
        "megabytes": _peak() - before,
        "outcome": result,
    }


def _peak():
    """Peak memory of this process in megabytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def run_limited(work, *args, seconds=SECONDS, megabytes=MEGABYTES):
    """The result of `work` in its own process, or a text saying how the process ended."""
    context = multiprocessing.get_context("fork")
    answers, child_end = context.Pipe(duplex=False)
    process = context.Process(target=_run_limited_child, args=(child_end, seconds, megabytes, work, args))
    process.start()
    child_end.close()
    try:
        answer = answers.recv()
    except EOFError:
        answer = "no answer"
    process.join()
    answers.close()
    return answer if process.exitcode == 0 else f"{answer} (exit code {process.exitcode})"


def _run_limited_child(answers, seconds, megabytes, work, args):
    with open("/proc/self/statm", encoding="ascii") as file:
        used = int(file.read().split()[0]) * resource.getpagesize()
    limit = used + megabytes * 1_000_000
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    try:
        answers.send(work(*args))
    except BaseException as fault:
        answers.send(f"{type(fault).__name__}: {fault}")
        sys.exit(1)


def measure(count, seed):
    """Time, memory and outcome of the first `count` attacks."""
    found = {name: run_limited(attack, source) for name, source in islice(ATTACKS.items(), count)}
    return found, [f"{name}: {result}" for name, result in found.items() if isinstance(result, str)]
