"""What an evaluation is charged, and what it may use: the one home of every limit of a running program.

A step stands for about a tenth of a microsecond of work of the reference form. The fast form charges nothing while it
runs: when it is written, the most that the reference form could be charged is found from the same figures, and a
program that could exceed a limit has no fast form.
"""

from __future__ import annotations

STEP_LIMIT = 75_000_000
SIZE_LIMIT = 100_000  # elements of one collection
HELD_LIMIT = 500_000  # elements, at all levels, of the values held at once
NESTING_LIMIT = 20  # collections within collections
CALL_LIMIT = 50  # calls of functions within calls

NODE = 1  # a part of an expression
LAMBDA = 8  # a call of a lambda
OPERATION = 8  # an operator
CALL = 20  # a call of a word
PAIR = 4  # an item that a word looks at for each of its items
SORTED = 8  # an element of a set that is brought into order; and one for each doubling of the set
MADE = 2  # an element of a list of choices


def sorting(weight: int, size: int) -> int:
    """Steps for bringing into order a set of `size` elements, and `weight` elements at all levels."""
    return weight * (SORTED + size.bit_length())
