"""Generates docs/programs.md from the code: `python scripts/generate_program_docs.py [--check]`."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from lilgym_mp.envs.fast import box_functions
from lilgym_mp.programs import costs, syntax
from lilgym_mp.programs.values import ENUMS, BoxView
from lilgym_mp.programs.words import GROUPS, WORDS, Word

TARGET = Path(__file__).resolve().parent.parent / "docs" / "programs.md"

INTRODUCTION = """# The program language

A program is the meaning of a statement: one expression in a small subset of Python that is true or false of a scene.

```python
from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Scene

program = compile_program("exist(filter_obj(all_items, is_blue))")
scene = Scene.empty()
program(scene)  # True or False
program.evaluate(scene)  # the same, but raises ProgramRuntimeError where the program has no value
program.errors  # Counter of the error messages; program(scene) is False on an error
```

`lilgym-mp explain --program "..."` explains what is wrong with a program, or lists the words it uses.

## Scenes

`all_boxes` is the list of the three boxes, left to right; `all_items` the list of all items, box by box.
A box can be used as the list of its items, and is falsy when empty. Items and boxes are compared by identity: equal
items in two boxes are different, and count twice.

Members of a box `b` and of an item `x`:

| member | value |
|---|---|
"""

COORDINATES = """
Coordinates are pixels in the item's own box, whose side is 100. For an item whose top-left corner is x pixels from the
left and y pixels from the top: left = x, right = x + size, top = 100 - y, bottom = 100 - (y + size). Heights are
measured upwards, so higher items have larger values.

Values:

"""

SYNTAX = """
## Syntax

| syntax | meaning |
|---|---|
| non-negative integers, `True`, `False` | at most {max_int} |
| calls of the words below | positional or keyword arguments: `is_touching_wall(x, side=Side.TOP)` |
| `lambda x: ...` | one parameter; an inner one may shadow an outer one |
| a word without arguments | as a function: `filter_obj(all_items, is_blue)` |
| `and`, `or`, `not` | as in Python, unlike `AND`, `OR`, `NOT`: they short-circuit and take any truthy or falsy value |
| `==` `!=` `<` `<=` `>` `>=` `in` `not in` | may be chained: `1 < count(s) <= 3` |
| `+` `%` | numbers; `+` also concatenates two lists |
| `s[0]`, `s[1:]` | index or slice of a list, or of the items of a box |
| `[a, b]`, `{{a, b}}` | lists and sets |

All other Python is rejected: other operators, other attributes, comprehensions, strings, assignments,
conditional expressions, starred arguments, names that start with an underscore, comments and line breaks.

## Words

Where a row describes several words, slashes separate them and the terms in which they differ, in the same order. In
signatures *collection* is a list, a set or a box, and *items* one item or a collection of items; words without `->`
give a bool. Sets are iterated in scene order (boxes left to right, items in the order of their box), so programs are
deterministic.
"""

LIMITS = """
## Limits

The source has at most {max_length} characters; brackets nest at most {max_brackets} deep, expressions {max_depth} deep.
An evaluation has a budget of {steps:,} steps of about 0.1 microseconds. A collection has at most {size:,} elements,
collections nest at most {nesting} deep, function calls at most {calls} deep, and the values held at once have at most
{held:,} elements at all levels. A program that exceeds a limit has no value on that scene.

On one current core, any text compiles or is rejected within 5 seconds and 100 MB, and gives its value or a
`ProgramRuntimeError` within 30 seconds and 200 MB, on any scene; official programs take microseconds.

For untrusted programs, such as a language model's, set a lower limit: `program.evaluate(scene, step_limit=100_000)`
raises `StepLimitError` (a `ProgramRuntimeError`) after about 10 milliseconds. `bounded_truths(source, scenes)` of
`lilgym_mp.programs.bounded` gives a program's truth in each scene, `None` where it has no value; it raises
`ProgramError` for an invalid one and `StepLimitError` after {bounded:,} steps on all scenes together.

## Errors

`compile_program` raises `ProgramError` (a `ValueError`) for an invalid program, with `.position` (line, column),
`.piece` (the offending text), `.reason` and `.source`. `.explain()` formats it:

```
{example}
```

`program.evaluate` raises `ProgramRuntimeError` when a program has no value on the scene: `unique` of a collection that
does not have exactly one element, an argument of the wrong type, an index out of range, a result that is not a bool, or
an exceeded limit. `program(scene)` is then `False`, and `program.errors` counts the message once per scene.

## Three examples

*"There is a blue item at the left wall."*

```
exist(filter_obj(all_items, lambda x: AND(is_blue(x), is_touching_wall(x, Side.LEFT))))
```

`filter_obj` keeps the items for which the lambda is true; `exist` tests whether any remain.

*"Exactly two boxes hold at least two black items."*

```
count(filter_obj(all_boxes, lambda b: count(filter_color(b, Color.BLACK)) >= 2)) == 2
```

Boxes are filtered like items. `filter_color(b, ...)` filters the items of the box.

*"In some tower a blue block lies on another block."*

```
exist(filter_obj(all_items, lambda x: x.box.is_tower() and exist(filter_color(get_above(x), Color.BLUE))))
```

In a tower, `get_above(x)` contains at most the block resting on `x`; elsewhere, everything in the box above `x`.
"""

MEMBERS = {
    "b.all_items_in_box()": BoxView.all_items_in_box.__doc__,
    "b.is_tower()": BoxView.is_tower.__doc__,
    "x.box": "The box of the item.",
    "x.color, x.shape, x.size": "Its attributes.",
}


def document() -> str:
    """The whole page."""
    lines = [f"| `{member}` | {description} |" for member, description in MEMBERS.items()]
    parts = [INTRODUCTION + "\n".join(lines) + "\n", COORDINATES]
    for name, enum in ENUMS.items():
        parts.append(f"- `{name}`: {', '.join(f'`{name}.{member.name}`' for member in enum)}\n")
    parts.append(SYNTAX.format(max_int=syntax.MAX_INT))
    for group in GROUPS:
        parts.append(f"\n### {group.capitalize()}\n\n| word | meaning |\n|---|---|\n")
        parts.extend(_rows(word for word in WORDS.values() if word.group == group))
    parts.append(
        LIMITS.format(
            max_length=syntax.MAX_LENGTH,
            max_brackets=syntax.MAX_BRACKETS,
            max_depth=syntax.MAX_DEPTH,
            steps=costs.STEP_LIMIT,
            bounded=costs.BOUNDED_STEPS,
            size=costs.SIZE_LIMIT,
            nesting=costs.NESTING_LIMIT,
            calls=costs.CALL_LIMIT,
            held=costs.HELD_LIMIT,
            box=box_functions.MAX_BOX_ITEMS,
            example=_example_error(),
        )
    )
    return "".join(parts)


def _rows(words: Iterable[Word]) -> Iterator[str]:
    """The rows of a group's table; consecutive words whose rows differ in few terms share one."""
    shared: list[list[str]] = []
    for word in words:
        signature = word.signature.replace("item or collection of items", "items").removesuffix(" -> bool")
        terms = re.findall(r"\w+|\W+", f"| `{signature}` | {' '.join(word.meaning.split())} |\n")
        if shared and not _alike(shared[0], terms):
            yield _joined(shared)
            shared = []
        shared.append(terms)
    yield _joined(shared)


def _alike(row: list[str], other: list[str]) -> bool:
    different = [pair for pair in zip(row, other, strict=False) if pair[0] != pair[1]]
    words_only = all(term[0].isalpha() for pair in different for term in pair)
    return len(row) == len(other) and words_only and len(different) <= len(row) / 4


def _joined(rows: list[list[str]]) -> str:
    return "".join("/".join(dict.fromkeys(terms)) for terms in zip(*rows, strict=True))


def _example_error() -> str:
    try:
        syntax.parse("exist(filter_obj(all_items, is_yelow))")
    except syntax.ProgramError as fault:
        return fault.explain()
    raise AssertionError


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="only check whether the page is up to date")
    if parser.parse_args().check:
        current = TARGET.read_text(encoding="utf-8") == document()
        print("up to date" if current else f"{TARGET.name} is out of date; run this script without --check")
        return 0 if current else 1
    TARGET.write_text(document(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
