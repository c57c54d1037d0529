"""Writes a report: every item as files, and one HTML page with all of them. The directory is replaced atomically."""

from __future__ import annotations

import os
import re
import shutil
from base64 import b64encode
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from lilgym_mp.contrib.report import behaviour, games, learning_curves, results
from lilgym_mp.contrib.report.charts import save
from lilgym_mp.contrib.report.items import Chart, Item, Table
from lilgym_mp.contrib.report.report_data import ReportData, load_report_data
from lilgym_mp.evaluation.files import OutputError, writable_directory
from lilgym_mp.scene.arrays import AnyMapping

CHAPTERS: Mapping[str, Sequence[Callable[[ReportData], Iterable[Item]]]] = {
    "Results": (results.table_2, results.figure_3, results.by_target, results.basis),
    "Learning": (learning_curves.dev_curves,),
    "Comparison of agents": (results.paired_tests,),
    "Behaviour": (behaviour.figures_6_and_9, behaviour.figure_10, behaviour.errors),
    "Language": (results.by_phenomenon, results.by_novelty),
    "Difficulty and stopping": (results.by_edits, behaviour.calibration),
    "Failures": (behaviour.failures,),
}
PAGE_FILE = "index.html"
GENERATOR = '<meta name="generator" content="lilgym_mp report">'  # identifies an existing page as a report
FIGURES = "figures"
TABLES = "tables"


def chapters(data: ReportData) -> dict[str, list[Item]]:
    """The items by heading; without recordings, those of games alone."""
    chosen = CHAPTERS if data.entries else {}
    made = {heading: [item for make in sections for item in make(data)] for heading, sections in chosen.items()}
    return {**made, "Two agents": list(games.pairs(data.games))} if data.games else made


def make_report(paths: Sequence[Path], directory: Path) -> Path:
    """Writes a report on all recordings in the paths; returns the path of its page. Same input, same bytes.

    An earlier report in the directory is replaced. Raises ReportError or EpisodesError for unusable recordings,
    OutputError if the directory holds anything else.
    """
    template = _template()
    check_output(directory)
    data = load_report_data(paths)
    made = chapters(data)
    target = directory.absolute()
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        temporary.mkdir()
        _write(temporary, data, made, template)
        shutil.rmtree(target, ignore_errors=True)
        temporary.rename(target)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return directory / PAGE_FILE


def check_output(directory: Path) -> None:
    """Raises OutputError unless the directory is new, empty, or made by an earlier report."""
    if directory.suffix.lower() in (".html", ".htm"):
        raise OutputError(f"{directory}: a report is a directory with its page, {PAGE_FILE}; name a directory")
    writable_directory(directory.absolute().parent)
    if directory.exists() and not directory.is_dir():
        raise OutputError(f"cannot write a report to {directory}: it is a file; name a directory")
    page = directory / PAGE_FILE
    is_report = page.is_file() and GENERATOR in page.read_text(encoding="utf-8", errors="replace")[:1000]
    made = (PAGE_FILE, FIGURES, TABLES) if is_report else ()
    others = [path.name for path in directory.iterdir() if path.name not in made] if directory.is_dir() else []
    if others:
        raise OutputError(f"{directory} holds something other than a report, {min(others)}; choose a new directory")


def _template() -> Any:
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup, escape

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.filters["code"] = lambda text: Markup(re.sub("`(.*?)`", r"<code>\1</code>", str(escape(text))))
    template = files("lilgym_mp.contrib.report") / "page.html"
    return environment.from_string(template.read_text(encoding="utf-8"))


def _write(directory: Path, data: ReportData, made: Mapping[str, Sequence[Item]], template: Any) -> None:
    for name in (FIGURES, TABLES):
        (directory / name).mkdir()
    corpus = "two agents"
    summary = ""
    subtitle = f"Pairs of agents: {len(data.games)}."
    if data.entries:
        settings = data.header.settings
        summary = " ".join(results.summary(data))
        corpus = f"{settings.corpus} corpus"
        counts = f"Agents: {len(data.agents)}, recordings: {sum(len(entry.runs) for entry in data.entries)}"
        places = f"configurations {', '.join(data.configurations)}; splits {', '.join(data.splits)}"
        subtitle = f"{counts}; {places}; rules {settings.rules}."
    page = template.render(
        title=f"lilGym results, {corpus}",
        subtitle=subtitle,
        summary=summary,
        chapters=[(heading, [_write_item(directory, item) for item in items]) for heading, items in made.items()],
    )
    (directory / PAGE_FILE).write_text(page, encoding="utf-8")


def _write_item(directory: Path, item: Item) -> AnyMapping:
    """Writes the item's files; returns its template context."""
    common = {"name": item.name, "item": item.item, "title": item.title, "note": item.note, "links": item.links}
    if isinstance(item, Chart):
        shown, media_type = ("PNG", "image/png") if item.raster else ("SVG", "image/svg+xml")
        paths = {name: f"{FIGURES}/{item.name}.{name.lower()}" for name in ("SVG", "PNG", "PDF")}
        for name, path in paths.items():
            save(item.figure, directory / path, name.lower())
        content = b64encode((directory / paths[shown]).read_bytes()).decode()
        looks = {"half": item.figure.get_figwidth() < 7, "raster": item.raster}
        source = f"data:{media_type};base64,{content}"
        return {**common, **looks, "kind": "chart", "source": source, "files": tuple(paths.items())}
    if not isinstance(item, Table):
        return {**common, "kind": "missing", "files": ()}
    texts = {"CSV": ("csv", item.csv()), "LaTeX": ("tex", item.latex())}
    paths = {name: f"{TABLES}/{item.name}.{suffix}" for name, (suffix, _) in texts.items()}
    for name, path in paths.items():
        (directory / path).write_text(texts[name][1], encoding="utf-8")
    is_text = [any(isinstance(cell, str) for cell in column) for column in zip(*item.rows, strict=True)]
    shown = {"columns": item.columns, "text": is_text or [False] * len(item.columns), "rows": item.texts()}
    return {**common, **shown, "kind": "table", "files": tuple(paths.items())}
