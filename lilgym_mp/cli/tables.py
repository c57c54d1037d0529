"""Tables of plain text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Lines with aligned columns: numbers to the right with a comma every three digits, texts to the left."""
    cells = [[_cell(value) for value in row] for row in rows]
    right = [bool(cells) and all(row[place][1] for row in cells) for place in range(len(header))]
    texts = [list(header), *([text for text, _ in row] for row in cells)]
    widths = [max(len(row[place]) for row in texts) for place in range(len(header))]
    lines = [
        "  ".join(
            text.rjust(width) if to_right else text.ljust(width)
            for text, width, to_right in zip(row, widths, right, strict=True)
        ).rstrip()
        for row in texts
    ]
    return "\n".join([lines[0], "  ".join("-" * width for width in widths), *lines[1:]])


def _cell(value: object) -> tuple[str, bool]:
    """A value's text, and whether it is a number or stands for a lacking one."""
    if value is None:
        return "-", True
    if isinstance(value, float):
        return f"{value:,.1f}", True
    if isinstance(value, int):
        return f"{value:,}", True
    return str(value), False
