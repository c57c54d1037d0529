"""Progress over a known number of things: a bar on a terminal that has tqdm, a line now and then elsewhere."""

from __future__ import annotations

import sys
from typing import Any

LINES = 10  # printed from beginning to end, where there is no bar


class Progress:
    """Counts up to `total` on stderr. A context manager."""

    def __init__(self, total: int, unit: str) -> None:
        self._total = total
        self._unit = unit
        self._done = 0
        self._bar = _bar(total, unit)

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *fault: object) -> None:
        if self._bar is not None:
            self._bar.close()

    def advance(self) -> None:
        self._done += 1
        if self._bar is not None:
            self._bar.update()
        elif self._done * LINES // self._total > (self._done - 1) * LINES // self._total:
            print(f"{self._done:,} of {self._total:,} {self._unit}", file=sys.stderr, flush=True)


def _bar(total: int, unit: str) -> Any:
    if not sys.stderr.isatty():
        return None
    try:
        from tqdm import tqdm
    except ImportError:
        return None
    return tqdm(total=total, unit=f" {unit}", dynamic_ncols=True)
