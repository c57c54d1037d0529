"""The report on disk: every item as files, and one page that holds them all. It is written whole or not at all."""

from __future__ import annotations

import os
import shutil
from base64 import b64encode
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from lilgym_mp.evaluation.files import OutputError, writable_directory
from lilgym_mp.extras import install
from lilgym_mp.plotting import save
from lilgym_mp.report.behaviour import behaviour
from lilgym_mp.report.difficulty import comparisons, difficulty
from lilgym_mp.report.examples import failures, pictures
from lilgym_mp.report.items import Chart, Item, Lacking, Table, shown
from lilgym_mp.report.language import Tags, language, read_tags
from lilgym_mp.report.learning_curves import learning
from lilgym_mp.report.markdown_report import check_document, write_document
from lilgym_mp.report.report_data import Gathered, gather
from lilgym_mp.report.results import results

PAGE = "index.html"
PAGE_TEMPLATE = "page.html"
GENERATOR = '<meta name="generator" content="lilgym_mp report">'  # by which a report is known to be one
FIGURES, TABLES = "figures", "tables"


def chapters(found: Gathered, tags: Tags | None) -> Iterator[tuple[str, list[Item]]]:
    """Every item of the report, under headings."""
    yield "Results", list(results(found))
    yield "Learning", list(learning(found))
    yield "Comparison of agents", list(comparisons(found))
    yield "Behaviour", list(behaviour(found))
    yield "Language", list(language(found, tags))
    yield "Difficulty and stopping", list(difficulty(found))
    yield "Tasks and programs", list(pictures(found))
    yield "Failures", list(failures(found))


def make_report(
    places: Sequence[Path],
    directory: Path,
    *,
    tags: Path | None = None,
    runs: Sequence[Path] = (),
    document: Path | None = None,
    command: str = "make_report",
) -> Path:
    """Writes the report on everything recorded in the places; gives its page. Equal recordings give equal bytes.

    `tags`: a file of hand-made phenomena; `runs`: training runs whose curves are drawn beside those in the places;
    `document`: a Markdown page to write too, which names `command` as what made it.
    An earlier report in the directory is replaced. Raises ReportError, EpisodesError for what cannot be reported on,
    OutputError for a directory that holds something else, ImportError naming what to install.
    """
    template = _template()
    check_directory(directory)
    if document is not None:
        check_document(document)
    found = gather(places, runs)
    made = list(chapters(found, None if tags is None else read_tags(tags)))
    page = replace_directory(directory, lambda unfinished: _write(unfinished, found, made, template))
    if document is not None:
        write_document(document, found, made, command)
    return page


def check_directory(directory: Path) -> None:
    """Raises OutputError unless a report can be written there: it is new, empty or holds an earlier report."""
    writable_directory(directory.absolute().parent)
    if directory.is_dir() and any(directory.iterdir()) and not _is_report(directory / PAGE):
        raise OutputError(f"{directory} holds something other than a report; choose a new directory")
    if directory.exists() and not directory.is_dir():
        raise OutputError(f"cannot write a report to {directory}: it is a file; name a directory")


def _is_report(page: Path) -> bool:
    return page.is_file() and GENERATOR in page.read_text(encoding="utf-8", errors="replace")[:1000]


def replace_directory(directory: Path, write: Callable[[Path], object]) -> Path:
    """Lets `write` fill a directory beside this one, which then takes its place; gives the page."""
    place = directory.absolute()
    unfinished, old = (place.with_name(f".{place.name}.{os.getpid()}.{part}") for part in ("tmp", "old"))
    try:
        unfinished.mkdir()
        write(unfinished)
        if place.exists():
            place.rename(old)
        unfinished.rename(place)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
        shutil.rmtree(old, ignore_errors=True)
    return directory / PAGE


def _template() -> Any:
    try:
        from jinja2 import Environment, StrictUndefined
    except ImportError as fault:
        raise ImportError(f"reports need jinja2: {install('report')}", name="jinja2") from fault
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    return environment.from_string(files("lilgym_mp.report").joinpath(PAGE_TEMPLATE).read_text(encoding="utf-8"))


def _write(directory: Path, found: Gathered, made: Sequence[tuple[str, Sequence[Item]]], template: Any) -> None:
    for name in (FIGURES, TABLES):
        (directory / name).mkdir()
    shown_chapters = [(heading, [_written(directory, item) for item in items]) for heading, items in made]
    settings = found.header.settings
    counts = f"{len(found.agents)} agents, {sum(len(entry.runs) for entry in found.entries)} recordings"
    page = template.render(
        title=f"lilGym results, {settings.corpus} corpus",
        subtitle=f"{counts}; configurations {', '.join(found.configurations)}; splits {', '.join(found.splits)};"
        f" rules {settings.rules}.",
        chapters=shown_chapters,
    )
    (directory / PAGE).write_text(page, encoding="utf-8")


def _written(directory: Path, item: Item) -> Mapping[str, Any]:
    """What the page shows of an item whose files have been written."""
    common = {"name": item.name, "item": item.item, "title": item.title, "note": item.note}
    if isinstance(item, Lacking):
        return {**common, "kind": "lacking", "files": ()}
    if isinstance(item, Table):
        return {**common, **_written_table(directory, item)}
    return {**common, **_written_chart(directory, item)}


def _written_table(directory: Path, item: Table) -> Mapping[str, Any]:
    places = {"CSV": f"{TABLES}/{item.name}.csv", "Markdown": f"{TABLES}/{item.name}.md"}
    (directory / places["CSV"]).write_text(item.csv(), encoding="utf-8")
    (directory / places["Markdown"]).write_text(item.markdown(), encoding="utf-8")
    is_text = [any(isinstance(row[place], str) for row in item.rows) for place in range(len(item.columns))]
    rows = [[shown(cell) for cell in row] for row in item.rows]
    return {"kind": "table", "columns": item.columns, "text": is_text, "rows": rows, "files": tuple(places.items())}


def _written_chart(directory: Path, item: Chart) -> Mapping[str, Any]:
    places = {"SVG": f"{FIGURES}/{item.name}.svg", "PNG": f"{FIGURES}/{item.name}.png"}
    for name, place in places.items():
        save(item.figure, directory / place, name.lower())
    kind, media = ("PNG", "image/png") if item.raster else ("SVG", "image/svg+xml")
    content = b64encode((directory / places[kind]).read_bytes()).decode()
    return {
        "kind": "chart",
        "source": f"data:{media};base64,{content}",
        "half": item.figure.get_figwidth() < 7,
        "files": tuple(places.items()),
    }
