"""The cost model of program evaluation: every limit and every charge.

One step is about 0.1 microseconds of the reference evaluator. Generated code charges nothing at run time: the code
generator computes an upper bound on what the reference evaluator could charge, and refuses programs that could exceed
a limit.
"""

from __future__ import annotations

STEP_LIMIT = 80_000_000
BOUNDED_STEPS = 250_000  # of `bounded_truths`
SIZE_LIMIT = 100_000  # elements of one collection
HELD_LIMIT = 500_000  # elements, at all levels, of the values held at once
NESTING_LIMIT = 20  # collections within collections
CALL_LIMIT = 50  # depth of function calls

NODE = 1  # evaluating a node of the syntax tree
LAMBDA = 8  # calling a lambda
OPERATION = 8  # applying an operator
CALL = 20  # calling a word
PAIR = 4  # a word comparing one item with another of the box or scene
SORT_ELEMENT = 8  # sorting one element of a set, plus 1 per doubling of the set's size
SUBSET_ELEMENT = 2  # creating one element of a list of k-subsets


def sort_steps(count: int, size: int) -> int:
    """Steps to sort a set of `size` elements, `count` at all levels."""
    return count * (SORT_ELEMENT + size.bit_length())
