"""Writes a report: every item as files, one HTML page with all of them, and a Markdown page for a repository.

The directory is replaced atomically.
"""

from __future__ import annotations

import os
import re
import shutil
from base64 import b64encode
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from lilgym_mp.contrib.report import behaviour, breakdowns, examples, learning_curves, results
from lilgym_mp.contrib.report.charts import save
from lilgym_mp.contrib.report.items import Chart, Item, MissingItem, Table
from lilgym_mp.contrib.report.report_data import ReportData, load_report_data
from lilgym_mp.corpus.extras import install
from lilgym_mp.corpus.notes import printable
from lilgym_mp.evaluation.files import OutputError, writable_directory, write_text
from lilgym_mp.evaluation.report import fold_long_blocks

CHAPTERS: Mapping[str, Sequence[Callable[[ReportData], Iterable[Item]]]] = {
    "Results": (
        *(results.table_2, results.figure_3, breakdowns.by_target, results.basis, results.training_runs),
        *(results.provenance, results.table_1),
    ),
    "Learning": (learning_curves.dev_curves, learning_curves.progress_curves),
    "Comparison of agents": (results.paired_tests,),
    "Behaviour": (behaviour.figures_6_and_9, behaviour.errors, behaviour.figure_10),
    "Language": (breakdowns.by_phenomenon, breakdowns.by_novelty),
    "Difficulty and stopping": (
        *(breakdowns.by_edits, breakdowns.by_actions_left, behaviour.calibration, behaviour.regret),
    ),
    "Tasks and programs": (examples.tasks_and_programs,),
    "Failures": (examples.failures,),
}
PAGE_FILE = "index.html"
GENERATOR = '<meta name="generator" content="lilgym_mp report">'  # identifies an existing page as a report
FIGURES, TABLES = "figures", "tables"
MARK = "<!-- made by lilgym-mp report; do not edit -->"  # identifies an existing Markdown page
FENCE = "```"
PICTURES = "pictures"  # directory next to the Markdown page
INCLUDED_CHARTS = ("Figure 3", "Figure 4", "Edits needed", "Calibration of STOP", "Figure 10")  # in the Markdown page


def chapters(data: ReportData) -> dict[str, list[Item]]:
    """The items by heading."""
    return {heading: [item for make in sections for item in make(data)] for heading, sections in CHAPTERS.items()}


def make_report(
    paths: Sequence[Path],
    directory: Path,
    *,
    document: Path | None = None,
    command: str = "make_report",
) -> Path:
    """Writes a report on all recordings in the paths; returns the path of its page. Same input, same bytes.

    `document`: also write a Markdown page, which names `command` as its origin. An earlier report in the directory is
    replaced. Raises ReportError or EpisodesError for unusable recordings, OutputError if the directory holds anything
    else, ImportError naming what to install.
    """
    template = _template()
    check_output(directory, document)
    data = load_report_data(paths)
    made = chapters(data)
    target = directory.absolute()
    temporary, old = (target.with_name(f".{target.name}.{os.getpid()}.{part}") for part in ("tmp", "old"))
    try:
        temporary.mkdir()
        _write(temporary, data, made, template)
        if target.exists():
            target.rename(old)
        temporary.rename(target)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        shutil.rmtree(old, ignore_errors=True)
    if document is not None:
        _write_document(document, data, made, command)
    return directory / PAGE_FILE


def check_output(directory: Path, document: Path | None) -> None:
    """Raises OutputError unless both are new or made by an earlier report, or the directory is empty."""
    if directory.suffix.lower() in (".html", ".htm"):
        raise OutputError(f"{directory}: a report is a directory with its page, {PAGE_FILE}; name a directory")
    writable_directory(directory.absolute().parent)
    if directory.is_dir() and any(directory.iterdir()) and not _contains(directory / PAGE_FILE, GENERATOR):
        raise OutputError(f"{directory} holds something other than a report; choose a new directory")
    if directory.exists() and not directory.is_dir():
        raise OutputError(f"cannot write a report to {directory}: it is a file; name a directory")
    if document is not None:
        writable_directory(document.absolute().parent)
        if document.is_dir():
            raise OutputError(f"cannot write a page to {document}: it is a directory; name a file")
        if document.exists() and not _contains(document, MARK):
            raise OutputError(f"{document} was not made by a report; choose a new file")


def _contains(page: Path, mark: str) -> bool:
    return page.is_file() and mark in page.read_text(encoding="utf-8", errors="replace")[:1000]


def _template() -> Any:
    try:
        from jinja2 import Environment, StrictUndefined
        from markupsafe import Markup, escape
    except ImportError as fault:
        raise ImportError(f"reports need jinja2: {install('report')}", name="jinja2") from fault
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.filters["code"] = lambda text: Markup(re.sub("`(.*?)`", r"<code>\1</code>", str(escape(text))))
    template = files("lilgym_mp.contrib.report") / "page.html"
    return environment.from_string(template.read_text(encoding="utf-8"))


def _write(directory: Path, data: ReportData, made: Mapping[str, Sequence[Item]], template: Any) -> None:
    for name in (FIGURES, TABLES):
        (directory / name).mkdir()
    settings = data.header.settings
    counts = f"Agents: {len(data.agents)}, recordings: {sum(len(entry.runs) for entry in data.entries)}"
    page = template.render(
        title=f"lilGym results, {settings.corpus} corpus",
        subtitle=f"{counts}; configurations {', '.join(data.configurations)}; splits {', '.join(data.splits)};"
        f" rules {settings.rules}.",
        chapters=[(heading, [_write_item(directory, item) for item in items]) for heading, items in made.items()],
    )
    (directory / PAGE_FILE).write_text(page, encoding="utf-8")


def _write_item(directory: Path, item: Item) -> Mapping[str, Any]:
    """Writes the item's files; returns its template context."""
    common = {"name": item.name, "item": item.item, "title": item.title, "note": item.note}
    if isinstance(item, MissingItem):
        return {**common, "kind": "missing", "files": ()}
    if isinstance(item, Chart):
        paths = {name: f"{FIGURES}/{item.name}.{name.lower()}" for name in ("SVG", "PNG", "PDF")}
        for name, path in paths.items():
            save(item.figure, directory / path, name.lower())
        shown, media_type = ("PNG", "image/png") if item.raster else ("SVG", "image/svg+xml")
        content = b64encode((directory / paths[shown]).read_bytes()).decode()
        looks = {"half": item.figure.get_figwidth() < 7, "raster": item.raster}
        source = f"data:{media_type};base64,{content}"
        return {**common, **looks, "kind": "chart", "source": source, "files": tuple(paths.items())}
    texts = {"CSV": ("csv", item.csv()), "Markdown": ("md", item.markdown()), "LaTeX": ("tex", item.latex())}
    paths = {name: f"{TABLES}/{item.name}.{suffix}" for name, (suffix, _) in texts.items()}
    for name, path in paths.items():
        (directory / path).write_text(texts[name][1], encoding="utf-8")
    is_text = [any(isinstance(cell, str) for cell in column) for column in zip(*item.rows, strict=True)]
    shown = {"columns": item.columns, "text": is_text or [False] * len(item.columns), "rows": item.texts()}
    return {**common, **shown, "kind": "table", "files": tuple(paths.items())}


def _write_document(file: Path, data: ReportData, made: Mapping[str, Sequence[Item]], command: str) -> None:
    """Writes the main tables and charts, without any statement of the corpus, as a Markdown page with its pictures."""
    corpus = {"lilgym": "official", "builtin": "builtin"}.get(data.header.settings.corpus, data.header.corpus)
    blocks = [f"# Results on the {corpus} corpus: {', '.join(data.splits)}", *_origin(data, command)]
    for heading, items in made.items():
        item_blocks = [block for item in items for block in _item_blocks(file, item)]
        blocks += [f"## {heading}", *item_blocks] if item_blocks else []
    # HTML in names from recordings is escaped; code blocks show it as it is.
    escaped = [block if block.endswith(FENCE) else block.replace("<", "&lt;") for block in blocks]
    write_text(file, fold_long_blocks("\n\n".join([MARK, *escaped])) + "\n")


def _origin(data: ReportData, command: str) -> Iterator[str]:
    """Dates, commits, machines and commands behind the numbers."""
    metadata = sorted(data.metadata, key=lambda each: each.date)
    if metadata:
        span = " to ".join(dict.fromkeys((metadata[0].date, metadata[-1].date)))
        machines = "; ".join(dict.fromkeys(each.machine for each in data.metadata))
        commits = dict.fromkeys(each.commit or "unknown" for each in metadata)
        said = f"{'commit' if len(commits) == 1 else 'commits'} {', '.join(commits)}"
        yield f"Episodes recorded {span} UTC; {said}; machine: {machines}."
    yield f"This page was written by `{command}`. [Reports](report.md) explains the items."
    recorded = dict.fromkeys(each.command for each in data.metadata)
    for title, commands in {"Trained by": data.training_commands, "Recorded by": recorded}.items():
        if commands:
            lines = [" ".join(printable(each).split()).replace(FENCE, "") for each in commands]
            yield "\n".join([f"{title}:\n\n{FENCE}", *lines, FENCE])


def _item_blocks(file: Path, item: Item) -> Iterator[str]:
    if isinstance(item, MissingItem) and item.item in INCLUDED_CHARTS:
        yield f"**{item.item}. {item.title}**: missing because {item.note}."
    elif isinstance(item, Table) and item.title != results.PROVENANCE_TITLE:  # summarised at the top of the page
        yield item.markdown().strip()
    elif isinstance(item, Chart) and item.item in INCLUDED_CHARTS and not item.raster:
        path = writable_directory(file.parent / PICTURES) / f"{file.stem}-{item.name}.png"
        save(item.figure, path, "png")
        yield f"**{item.item}. {item.title}**\n\n![{item.item}: {item.title}]({PICTURES}/{path.name})"
        if item.note:
            yield item.note
