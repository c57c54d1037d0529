"""Writes the main numbers of a report as a Markdown page for a repository, with some charts and no statement."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from lilgym_mp.evaluation.files import OutputError, writable_directory, write_text
from lilgym_mp.evaluation.recording_metadata import MODIFIED_SUFFIX, RecordingMetadata
from lilgym_mp.plotting import save
from lilgym_mp.report.items import Chart, Item, Lacking, Table
from lilgym_mp.report.report_data import Gathered

MARK = "<!-- made by lilgym-mp report; do not edit -->"
PICTURES = "pictures"  # directory next to the page
DRAWN = ("Figure 3", "Figure 4", "Edits needed", "Calibration of STOP", "Figure 10")  # charts on the page
RECORDED = "When, where and by which commands episodes were recorded"  # replaced by the top of the page


def check_document(file: Path) -> None:
    """Raises OutputError unless the file is new or was written by a report."""
    writable_directory(file.absolute().parent)
    if file.is_dir():
        raise OutputError(f"cannot write a page to {file}: it is a directory; name a file")
    if file.exists() and MARK not in file.read_text(encoding="utf-8", errors="replace")[:1000]:
        raise OutputError(f"{file} was not made by a report; choose a new file")


def write_document(file: Path, found: Gathered, made: Sequence[tuple[str, Sequence[Item]]], command: str) -> None:
    """Writes the page and its charts; `command` is the command that makes the report."""
    blocks = [MARK, f"# {_title(found)}", *_origin(found, command)]
    for heading, items in made:
        shown = [block for item in items for block in _shown(file, item)]
        blocks += [f"## {heading}", *shown] if shown else []
    write_text(file, "\n\n".join(blocks) + "\n")


def _title(found: Gathered) -> str:
    corpus = {"lilgym": "official", "builtin": "builtin"}.get(found.header.settings.corpus, found.header.corpus)
    return f"Results on the {corpus} corpus: {', '.join(found.splits)}"


def _origin(found: Gathered, command: str) -> Iterator[str]:
    """The origin of the numbers: dates, commits, machine and commands."""
    made = found.metadata
    if made:
        dates = sorted(one.date for one in made)
        span = dates[0] if dates[0] == dates[-1] else f"{dates[0]} to {dates[-1]}"
        machines = "; ".join(dict.fromkeys(one.machine for one in made))
        yield f"Episodes recorded {span} UTC; {commits_text(made)}; machine: {machines}."
    yield f"This page was written by `{command}`. [report.md](report.md) explains its items."
    if found.training_commands:
        yield _commands("Trained by", found.training_commands)
    if made:
        yield _commands("Recorded by", dict.fromkeys(one.command for one in made))


def commits_text(made: Sequence[RecordingMetadata]) -> str:
    """The commits of the recordings, in the order of their first recording."""
    names = list(dict.fromkeys(one.commit for one in sorted(made, key=lambda one: one.date)))
    known = [name for name in names if name]
    if not known:
        return "commit unknown"
    kept = [name for name in known if name.endswith(MODIFIED_SUFFIX) or name + MODIFIED_SUFFIX not in known]
    texts = [
        name.replace(MODIFIED_SUFFIX, " (with and without uncommitted changes)")
        if name.removesuffix(MODIFIED_SUFFIX) in known
        else name.replace(MODIFIED_SUFFIX, " (with uncommitted changes)")
        for name in kept
    ]
    listed = texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} and {texts[-1]}"
    unknown = "" if len(known) == len(names) else ", of some unknown"
    return f"{'commit' if len(texts) == 1 else 'commits'} {listed}{unknown}"


def _commands(heading: str, commands: Sequence[str] | dict[str, None]) -> str:
    return f"{heading}:\n\n```\n" + "\n".join(commands) + "\n```"


def _shown(file: Path, item: Item) -> Iterator[str]:
    if isinstance(item, Lacking) and item.item in DRAWN:
        yield f"**{item.item}. {item.title}**: not here, as {item.note}."
    elif isinstance(item, Table) and item.title != RECORDED:
        yield item.markdown().strip()
    elif isinstance(item, Chart) and item.item in DRAWN and not item.raster:
        place = writable_directory(file.parent / PICTURES) / f"{file.stem}-{item.name}.png"
        save(item.figure, place, "png")
        yield f"**{item.item}. {item.title}**\n\n![{item.item}: {item.title}]({PICTURES}/{place.name})"
        if item.note:
            yield item.note
