"""Writes a report's tables and main charts as a Markdown page for a repository, without any statement of the corpus."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from lilgym_mp.contrib.report.items import Chart, Item, MissingItem, Table
from lilgym_mp.contrib.report.plotting import save
from lilgym_mp.contrib.report.report_data import ReportData
from lilgym_mp.contrib.report.results import PROVENANCE_TITLE
from lilgym_mp.corpus.notes import printable
from lilgym_mp.evaluation.files import OutputError, writable_directory, write_text
from lilgym_mp.evaluation.recording_metadata import RecordingMetadata
from lilgym_mp.evaluation.report import fold_long_blocks

MARK = "<!-- made by lilgym-mp report; do not edit -->"
FENCE = "```"
PICTURES = "pictures"  # directory next to the page
INCLUDED_CHARTS = ("Figure 3", "Figure 4", "Edits needed", "Calibration of STOP", "Figure 10")


def check_document(file: Path) -> None:
    """Raises OutputError unless the file is new or an earlier page of a report."""
    writable_directory(file.absolute().parent)
    if file.is_dir():
        raise OutputError(f"cannot write a page to {file}: it is a directory; name a file")
    if file.exists() and MARK not in file.read_text(encoding="utf-8", errors="replace")[:1000]:
        raise OutputError(f"{file} was not made by a report; choose a new file")


def write_document(file: Path, data: ReportData, made: Sequence[tuple[str, Sequence[Item]]], command: str) -> None:
    """Writes the page and its pictures; `command` is quoted as its origin."""
    corpus = {"lilgym": "official", "builtin": "builtin"}.get(data.header.settings.corpus, data.header.corpus)
    title = f"Results on the {corpus} corpus: {', '.join(data.splits)}"
    blocks = [f"# {title}", *_origin(data, command)]
    for heading, items in made:
        item_blocks = [block for item in items for block in _item_blocks(file, item)]
        blocks += [f"## {heading}", *item_blocks] if item_blocks else []
    write_text(file, fold_long_blocks("\n\n".join([MARK, *map(_without_markup, blocks)])) + "\n")


def _without_markup(block: str) -> str:
    """The block with HTML in names from recordings escaped; code blocks show it as it is."""
    return block if block.endswith(FENCE) else block.replace("<", "&lt;")


def _origin(data: ReportData, command: str) -> Iterator[str]:
    """Dates, commits, machines and commands behind the numbers."""
    metadata = data.metadata
    if metadata:
        dates = sorted(each.date for each in metadata)
        span = dates[0] if dates[0] == dates[-1] else f"{dates[0]} to {dates[-1]}"
        machines = "; ".join(dict.fromkeys(each.machine for each in metadata))
        yield f"Episodes recorded {span} UTC; {commits_text(metadata)}; machine: {machines}."
    yield f"This page was written by `{command}`. [Reports](report.md) explains the items."
    if data.training_commands:
        yield _commands("Trained by", data.training_commands)
    if metadata:
        yield _commands("Recorded by", dict.fromkeys(each.command for each in metadata))


def commits_text(metadata: Sequence[RecordingMetadata]) -> str:
    """The distinct commits of the recordings, by date of their first recording."""
    made = sorted(metadata, key=lambda each: each.date)
    names = dict.fromkeys(each.commit or "unknown" for each in made)
    return f"{'commit' if len(names) == 1 else 'commits'} {', '.join(names)}"


def _commands(heading: str, commands: Sequence[str] | dict[str, None]) -> str:
    lines = [" ".join(printable(command).split()).replace(FENCE, "") for command in commands]
    return "\n".join([f"{heading}:\n\n{FENCE}", *lines, FENCE])


def _item_blocks(file: Path, item: Item) -> Iterator[str]:
    if isinstance(item, MissingItem) and item.item in INCLUDED_CHARTS:
        yield f"**{item.item}. {item.title}**: missing because {item.note}."
    elif isinstance(item, Table) and item.title != PROVENANCE_TITLE:  # summarised at the top of the page
        yield item.markdown().strip()
    elif isinstance(item, Chart) and item.item in INCLUDED_CHARTS and not item.raster:
        path = writable_directory(file.parent / PICTURES) / f"{file.stem}-{item.name}.png"
        save(item.figure, path, "png")
        yield f"**{item.item}. {item.title}**\n\n![{item.item}: {item.title}]({PICTURES}/{path.name})"
        if item.note:
            yield item.note
