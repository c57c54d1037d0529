"""Texts of others, such as servers and files, made safe for a terminal."""

from __future__ import annotations


def printable(text: str) -> str:
    """`text` with everything that could move a terminal's cursor, colour or title, but line ends, written out."""
    return "".join(c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode("ascii") for c in text)
