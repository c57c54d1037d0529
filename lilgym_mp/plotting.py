"""Figures for charts; matplotlib is imported only when the first one is made."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.extras import install

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 100
SVG_SETTINGS: dict[Any, Any] = {"svg.fonttype": "none", "svg.hashsalt": "lilgym_mp"}  # text as text; reproducible ids


def new_figure(width: float, height: float) -> Figure:
    """An empty figure; width and height in pixels. Raises ImportError saying what to install."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError(f"charts need matplotlib: {install('charts')}", name="matplotlib") from error
    return Figure(figsize=(width / DPI, height / DPI), dpi=DPI, layout="constrained")


def save(figure: Figure, path: Path, file_format: str) -> None:
    """Writes the figure as "svg" or "png", reproducibly: without a date."""
    from matplotlib import rc_context

    metadata = {"Date": None} if file_format == "svg" else {}
    with rc_context(SVG_SETTINGS):
        figure.savefig(path, format=file_format, metadata=metadata)
