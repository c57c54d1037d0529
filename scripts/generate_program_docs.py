"""Writes docs/programs.md from the code: `python scripts/generate_program_docs.py [--check]`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from lilgym_mp.programs import costs, lifting, syntax
from lilgym_mp.programs.views import ENUMS, BoxView
from lilgym_mp.programs.words import GROUPS, WORDS

TARGET = Path(__file__).resolve().parent.parent / "docs" / "programs.md"

INTRODUCTION = """# The program language

A program says what a statement means. It is one expression, a small part of Python, that is true or false of
a scene. This page is written by `scripts/generate_program_docs.py` from the code; change it there.

```python
from lilgym_mp.programs import compile_program

program = compile_program("exist(filter_obj(all_items, is_blue))")
program(scene)  # True or False
program.evaluate(scene)  # the same, but raises ProgramRuntimeError where the program has no value
program.errors  # a Counter: how often, and why, it had no value (then it counts as False)
```

`lilgym-mp program check "..."` says what is wrong with a program, or which words it uses.

## What a scene is made of

`all_boxes` is the list of the three boxes, left to right; `all_items` the list of all items, box by box.
A box can stand wherever a list of items is wanted: it means its items, and is false where it has none. Items and boxes
are themselves and nothing else: two items that look the same at the same place of two boxes are different, and count
twice.

Members of a box `b` and of an item `x`:

| | |
| --- | --- |
"""

COORDINATES = """
Coordinates are pixels in the item's own box, of side 100: left = x, right = x + size, and, measured upwards,
top = 100 - y, bottom = 100 - (y + size), for an item whose picture starts x pixels from the left and y from the
top. So "above" is larger.

Values:

"""

SYNTAX = """
## What may be written

| | |
| --- | --- |
| whole numbers, `True`, `False` | at most {max_int} |
| calls of the words below | arguments by position or by name: `is_touching_wall(x, side=Side.TOP)` |
| `lambda x: ...` | one parameter; an inner one may hide an outer one of the same name |
| a word without arguments | as a function: `filter_obj(all_items, is_blue)` |
| `and`, `or`, `not` | Python's: they stop at the first operand that decides, and take any value as a truth |
| `==` `!=` `<` `<=` `>` `>=` `in` `not in` | also in chains: `1 < count(s) <= 3` |
| `+` `%` | numbers; `+` also joins two lists |
| `s[0]`, `s[1:]` | positions in a list or of items in a box, counted from 0 |
| `[a, b]`, `{{a, b}}` | lists and sets |

Everything else of Python is refused: other operators, other attributes, comprehensions, strings, assignments,
conditional expressions, starred arguments, names that start with an underscore, comments and line breaks.

`AND`, `OR` and `NOT` differ from `and`, `or` and `not`: they want bools, and evaluate all their arguments.

## The words

In the signatures *collection* is a list, a set or a box; a set is gone through in scene order, boxes from the left
and items as they are listed in the box, so that a program always gives the same value.
"""

LIMITS = """
## Limits

A source has at most {max_length} characters, {max_brackets} nested brackets, {max_depth} nested expressions.
An evaluation takes at most {steps:,} steps of about a tenth of a microsecond: whatever is copied, hashed, compared
or brought into order is charged first, elements of elements included. No collection holds more than {size:,} elements,
collections are nested at most {nesting} deep, functions called at most {calls} deep, and the values that an evaluation
holds at once have at most {held:,} elements at all levels. A program that needs more has no value on that scene.

What this promises for any text, on a processor core of our days: it compiles or is refused in less than 5 seconds and
100 MB, and has its value or `ProgramRuntimeError` in less than 30 seconds and 200 MB, on any scene. The programs made
to break this take up to 7 seconds and 20 MB ([reliability.md](reliability.md)); official ones microseconds.

Evaluation is fast while no box holds more than {box} items; beyond that programs are run in a slower form with the
same values.

## Errors

`compile_program` raises `ProgramError` (a `ValueError`) for a text that is not a program, with `.position` (line,
column), `.piece`, `.reason` and `.source`. `.explain()` shows it:

```
{example}
```

`program.evaluate` raises `ProgramRuntimeError` where a program has no value: `unique` of what is not exactly one,
an argument of the wrong kind, a position out of range, a result that is not a bool, too much work.
`program(scene)` is `False` there, and `program.errors` counts the message, once for each scene.

## Three programs, step by step

*"There is a blue item at the left wall."*

```
exist(filter_obj(all_items, lambda x: AND(is_blue(x), is_touching_wall(x, Side.LEFT))))
```

`filter_obj` keeps the items for which the lambda is true; `exist` asks whether any are left.

*"Exactly two boxes hold at least two black items."*

```
count(filter_obj(all_boxes, lambda b: count(filter_color(b, Color.BLACK)) >= 2)) == 2
```

Boxes are filtered just as items are. `filter_color(b, ...)` goes over the items of the box.

*"In some tower a blue block lies on another block."*

```
exist(filter_obj(all_items, lambda x: x.box.is_tower() and exist(filter_color(get_above(x), Color.BLUE))))
```

In a tower `get_above(x)` is the block that touches `x` from above, or nothing; elsewhere it is everything in the box
that lies higher than `x`.
"""

MEMBERS = {
    "b.all_items_in_box()": BoxView.all_items_in_box.__doc__,
    "b.is_tower()": BoxView.is_tower.__doc__,
    "x.box": "The box of the item.",
    "x.color, x.shape, x.size": "Its attributes.",
}


def document() -> str:
    """The whole page."""
    lines = [f"| `{member}` | {meaning} |" for member, meaning in MEMBERS.items()]
    parts = [INTRODUCTION + "\n".join(lines) + "\n", COORDINATES]
    for name, kind in ENUMS.items():
        parts.append(f"- `{name}`: {', '.join(f'`{name}.{member.name}`' for member in kind)}\n")
    parts.append(SYNTAX.format(max_int=syntax.MAX_INT))
    for group in GROUPS:
        parts.append(f"\n### {group.capitalize()}\n\n| | |\n| --- | --- |\n")
        words = (word for word in WORDS.values() if word.group == group)
        parts.extend(f"| `{word.signature}` | {' '.join(word.meaning.split())} |\n" for word in words)
    parts.append(
        LIMITS.format(
            max_length=syntax.MAX_LENGTH,
            max_brackets=syntax.MAX_BRACKETS,
            max_depth=syntax.MAX_DEPTH,
            steps=costs.STEP_LIMIT,
            size=costs.SIZE_LIMIT,
            nesting=costs.NESTING_LIMIT,
            calls=costs.CALL_LIMIT,
            held=costs.HELD_LIMIT,
            box=lifting.MAX_BOX_ITEMS,
            example=_example_error(),
        )
    )
    return "".join(parts)


def _example_error() -> str:
    try:
        syntax.parse("exist(filter_obj(all_items, is_yelow))")
    except syntax.ProgramError as fault:
        return fault.explain()
    raise AssertionError


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="only say whether the page is up to date")
    if parser.parse_args().check:
        current = TARGET.read_text(encoding="utf-8") == document()
        print("up to date" if current else f"{TARGET.name} is out of date; run this script without --check")
        return 0 if current else 1
    TARGET.write_text(document(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
