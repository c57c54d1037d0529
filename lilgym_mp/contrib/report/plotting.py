"""Figures for charts; matplotlib is imported only when the first one is made."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.corpus.extras import install

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 100
SETTINGS: dict[Any, Any] = {
    "svg.fonttype": "none",  # text as text
    "svg.hashsalt": "lilgym_mp",  # reproducible ids
    "pdf.fonttype": 42,  # TrueType, as publishers require
    "hatch.linewidth": 0.6,
}
UNDATED = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}


def new_figure(width: float, height: float) -> Figure:
    """An empty figure; width and height in pixels. Raises ImportError saying what to install."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError(f"charts need matplotlib: {install('charts')}", name="matplotlib") from error
    return Figure(figsize=(width / DPI, height / DPI), dpi=DPI, layout="constrained")


def save(figure: Figure, path: Path, file_format: str) -> None:
    """Writes the figure as "svg", "png" or "pdf", reproducibly: without a date."""
    from matplotlib import rc_context

    with rc_context(SETTINGS):
        figure.savefig(path, format=file_format, metadata=UNDATED.get(file_format))
