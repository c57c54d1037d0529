"""Writes a report: every item as files, and one HTML page with all of them. The directory is replaced atomically."""

from __future__ import annotations

import os
import re
import shutil
from base64 import b64encode
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from lilgym_mp.contrib.report.behaviour import behaviour_items
from lilgym_mp.contrib.report.difficulty import comparison_items, difficulty_items
from lilgym_mp.contrib.report.examples import example_items, failure_items
from lilgym_mp.contrib.report.items import Chart, Item, MissingItem
from lilgym_mp.contrib.report.language import Tags, language_items, read_tags
from lilgym_mp.contrib.report.learning_curves import learning_items
from lilgym_mp.contrib.report.markdown_report import check_document, write_document
from lilgym_mp.contrib.report.plotting import save
from lilgym_mp.contrib.report.report_data import ReportData, load_report_data
from lilgym_mp.contrib.report.results import results_items
from lilgym_mp.corpus.extras import install
from lilgym_mp.evaluation.files import OutputError, writable_directory

PAGE_FILE = "index.html"
PAGE_TEMPLATE = "page.html"
GENERATOR = '<meta name="generator" content="lilgym_mp report">'  # identifies an existing page as a report
FIGURES, TABLES = "figures", "tables"


def chapters(data: ReportData, tags: Tags | None) -> Iterator[tuple[str, list[Item]]]:
    """Headings with their items."""
    yield "Results", list(results_items(data))
    yield "Learning", list(learning_items(data))
    yield "Comparison of agents", list(comparison_items(data))
    yield "Behaviour", list(behaviour_items(data))
    yield "Language", list(language_items(data, tags))
    yield "Difficulty and stopping", list(difficulty_items(data))
    yield "Tasks and programs", list(example_items(data))
    yield "Failures", list(failure_items(data))


def make_report(
    paths: Sequence[Path],
    directory: Path,
    *,
    tags: Path | None = None,
    runs: Sequence[Path] = (),
    document: Path | None = None,
    command: str = "make_report",
) -> Path:
    """Writes a report on all recordings in the paths; returns the path of its page. Same input, same bytes.

    `tags`: a file with hand-made tags of phenomena; `runs`: further training runs for the learning curves; `document`:
    also write a Markdown page, which names `command` as its origin.
    An earlier report in the directory is replaced. Raises ReportError or EpisodesError for unusable recordings,
    OutputError if the directory holds anything else, ImportError naming what to install.
    """
    template = _template()
    check_directory(directory)
    if document is not None:
        check_document(document)
    found = load_report_data(paths, runs)
    made = list(chapters(found, None if tags is None else read_tags(tags)))
    page = replace_directory(directory, lambda unfinished: _write(unfinished, found, made, template))
    if document is not None:
        write_document(document, found, made, command)
    return page


def check_directory(directory: Path) -> None:
    """Raises OutputError unless the directory is new, empty or holds an earlier report."""
    if directory.suffix.lower() in (".html", ".htm"):
        raise OutputError(f"{directory}: a report is a directory with its page, {PAGE_FILE}; name a directory")
    writable_directory(directory.absolute().parent)
    if directory.is_dir() and any(directory.iterdir()):
        page = directory / PAGE_FILE
        if not page.is_file() or GENERATOR not in page.read_text(encoding="utf-8", errors="replace")[:1000]:
            raise OutputError(f"{directory} holds something other than a report; choose a new directory")
    if directory.exists() and not directory.is_dir():
        raise OutputError(f"cannot write a report to {directory}: it is a file; name a directory")


def replace_directory(directory: Path, write: Callable[[Path], object]) -> Path:
    """Calls `write` on a temporary sibling directory, then swaps it in; returns the path of the page."""
    target = directory.absolute()
    temporary, old = (target.with_name(f".{target.name}.{os.getpid()}.{part}") for part in ("tmp", "old"))
    try:
        temporary.mkdir()
        write(temporary)
        if target.exists():
            target.rename(old)
        temporary.rename(target)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        shutil.rmtree(old, ignore_errors=True)
    return directory / PAGE_FILE


def _template() -> Any:
    try:
        from jinja2 import Environment, StrictUndefined
        from markupsafe import Markup, escape
    except ImportError as fault:
        raise ImportError(f"reports need jinja2: {install('report')}", name="jinja2") from fault
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.filters["code"] = lambda text: Markup(re.sub("`(.*?)`", r"<code>\1</code>", str(escape(text))))
    template = files("lilgym_mp.contrib.report") / PAGE_TEMPLATE
    return environment.from_string(template.read_text(encoding="utf-8"))


def _write(directory: Path, data: ReportData, made: Sequence[tuple[str, Sequence[Item]]], template: Any) -> None:
    for name in (FIGURES, TABLES):
        (directory / name).mkdir()
    chapter_contexts = [(heading, [_write_item(directory, item) for item in items]) for heading, items in made]
    settings = data.header.settings
    counts = f"Agents: {len(data.agents)}, recordings: {sum(len(entry.runs) for entry in data.entries)}"
    page = template.render(
        title=f"lilGym results, {settings.corpus} corpus",
        subtitle=f"{counts}; configurations {', '.join(data.configurations)}; splits {', '.join(data.splits)};"
        f" rules {settings.rules}.",
        chapters=chapter_contexts,
    )
    (directory / PAGE_FILE).write_text(page, encoding="utf-8")


def _write_item(directory: Path, item: Item) -> Mapping[str, Any]:
    """Writes the item's files; returns its template context."""
    common = {"name": item.name, "item": item.item, "title": item.title, "note": item.note}
    if isinstance(item, MissingItem):
        return {**common, "kind": "missing", "files": ()}
    if isinstance(item, Chart):
        return {**common, **_write_chart(directory, item)}
    paths: dict[str, str] = {}
    for name, suffix, text in (
        ("CSV", "csv", item.csv()),
        ("Markdown", "md", item.markdown()),
        ("LaTeX", "tex", item.latex()),
    ):
        paths[name] = f"{TABLES}/{item.name}.{suffix}"
        (directory / paths[name]).write_text(text, encoding="utf-8")
    is_text = [any(isinstance(cell, str) for cell in column) for column in zip(*item.rows, strict=True)]
    shown = {"columns": item.columns, "text": is_text or [False] * len(item.columns), "rows": item.texts()}
    return {**common, "kind": "table", "files": tuple(paths.items()), **shown}


def _write_chart(directory: Path, item: Chart) -> Mapping[str, Any]:
    paths = {name: f"{FIGURES}/{item.name}.{name.lower()}" for name in ("SVG", "PNG", "PDF")}
    for file_format, path in paths.items():
        save(item.figure, directory / path, file_format.lower())
    file_format, media_type = ("PNG", "image/png") if item.raster else ("SVG", "image/svg+xml")
    content = b64encode((directory / paths[file_format]).read_bytes()).decode()
    return {
        "kind": "chart",
        "source": f"data:{media_type};base64,{content}",
        "half": item.figure.get_figwidth() < 7,
        "raster": item.raster,
        "files": tuple(paths.items()),
    }
