"""Statements with scenes from files: the corpus format and NLVR's."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, cast

from sqlalchemy import select
from sqlalchemy.orm import Session

from lilgym_mp.appearances import APPEARANCES
from lilgym_mp.corpus.faults import CorpusError, FaultLog
from lilgym_mp.corpus.jsonlines import CorpusFile
from lilgym_mp.corpus.records import JSONFault, as_object, check_text, parse_json, read_text, shown
from lilgym_mp.scene import Scene, SceneError
from lilgym_mp.web.store.models import Statement, StatementScene

MOST_FAULTS = 20  # that are told
MOST_STATEMENT = 2_000  # characters
NLVR_LABELS = {"true": True, "false": False}


class ImportedScene(NamedTuple):
    scene: Scene
    label: bool


class ImportedStatement(NamedTuple):
    """A statement with its scenes, checked."""

    name: str
    text: str
    appearance: str
    split: str
    scenes: tuple[ImportedScene, ...]


class ImportResult(NamedTuple):
    """The statements that were read, and what is wrong with others."""

    statements: list[ImportedStatement]
    faults: list[str]


class _Raw(NamedTuple):
    where: str
    name: str
    text: str
    appearance: str | None  # None: by its scenes
    split: str
    starts: list[tuple[object, bool]]


def read_statements(data: bytes, split: str) -> ImportResult:
    """The statements of a file in the corpus format or in NLVR's (a JSON object a line), told apart by its first line.

    `split`: of statements whose file does not say. Raises CorpusError for a file that cannot be read at all.
    """
    faults = FaultLog(stop_at_first=False)
    with tempfile.TemporaryDirectory(prefix="lilgym-mp-") as directory:
        path = Path(directory) / "file"
        path.write_bytes(data)
        try:
            text = read_text(path).text
            raw = list(_of_corpus(path, faults) if _is_corpus(text) else _of_nlvr(text, split, faults))
        except CorpusError as fault:
            raise CorpusError(str(fault).replace(f"{path}", "the file")) from None
        statements = list(_checked(raw, faults))
        told = [str(fault).replace(f"{path}", "the file") for fault in faults.found]
    return ImportResult(statements, told)


def _is_corpus(text: str) -> bool:
    first = text.lstrip().split("\n", 1)[0]
    try:
        record = as_object(parse_json(first))
    except JSONFault:
        return False
    return record is not None and "format" in record


def _of_corpus(path: Path, faults: FaultLog) -> Iterator[_Raw]:
    for entry in CorpusFile(path, faults).entries:
        starts = [(start.scene, start.label) for start in entry.starts]
        yield _Raw(entry.where, entry.id, entry.statement, entry.appearance, entry.split, starts)


def _of_nlvr(text: str, split: str, faults: FaultLog) -> Iterator[_Raw]:
    """NLVR has a line for each pair of a statement and a scene; the identifier is the statement's, a dash, a number."""
    found: dict[str, _Raw] = {}
    for number, line in enumerate(text.split("\n"), start=1):
        if not line.strip():
            continue
        where = f"line {number}"
        try:
            record = as_object(parse_json(line))
            if record is None:
                raise JSONFault(f"must be a JSON object, not {shown(line)}")
            missing = {"sentence", "identifier", "label", "structured_rep"} - record.keys()
            if missing:
                raise JSONFault(f"lacks {', '.join(sorted(missing))}")
            sentence = check_text("sentence", record["sentence"])
            name = check_text("identifier", record["identifier"]).rpartition("-")[0] or str(record["identifier"])
            label = NLVR_LABELS.get(str(record["label"]).lower())
            if label is None:
                raise JSONFault(f"label must be true or false, not {shown(record['label'])}")
        except JSONFault as fault:
            faults.add(where, str(fault))
            continue
        kept = found.setdefault(name, _Raw(where, f"nlvr-{name}", sentence, None, split, []))
        if kept.text != sentence:
            faults.add(where, f"statement {name!r} has another text than in {kept.where}")
            continue
        kept.starts.append((record["structured_rep"], label))
    yield from found.values()


def _checked(raw: Iterable[_Raw], faults: FaultLog) -> Iterator[ImportedStatement]:
    for statement in raw:
        try:
            yield _statement(statement)
        except (SceneError, ValueError) as fault:
            faults.add(statement.where, str(fault))


def _statement(raw: _Raw) -> ImportedStatement:
    """Raises ValueError saying what is wrong."""
    if not raw.starts:
        raise ValueError("the statement has no scenes to annotate it with")
    if len(raw.text) > MOST_STATEMENT or len(raw.name) > 200:
        raise ValueError(f"a statement has at most {MOST_STATEMENT} characters, its id 200")
    scenes = [Scene.from_json(scene) for scene, _ in raw.starts]
    appearance = raw.appearance or _appearance(scenes)
    checked = [APPEARANCES[appearance].check_scene(scene) for scene in scenes]
    labelled = tuple(ImportedScene(scene, label) for scene, (_, label) in zip(checked, raw.starts, strict=True))
    return ImportedStatement(raw.name, raw.text, appearance, raw.split, labelled)


def _appearance(scenes: Iterable[Scene]) -> str:
    """The first appearance that has all of the scenes. Raises SceneError where none has."""
    kept = list(scenes)
    faults: list[str] = []
    for name in ("tower", "scatter"):
        try:
            for scene in kept:
                APPEARANCES[name].check_scene(scene)
            return name
        except SceneError as fault:
            faults.append(f"{name}: {fault}")
    raise SceneError("; ".join(faults))


def keep_statements(session: Session, statements: Iterable[ImportedStatement]) -> int:
    """Adds the statements whose names are new; gives how many."""
    known = set(session.scalars(select(Statement.name)))
    added = 0
    for statement in statements:
        if statement.name in known:
            continue
        known.add(statement.name)
        kept = Statement(
            name=statement.name, text=statement.text, appearance=statement.appearance, split=statement.split
        )
        session.add(kept)
        session.flush()
        session.add_all(
            StatementScene(
                statement_id=kept.id,
                position=position,
                scene=cast("list[Any]", labelled.scene.to_json()),
                label=labelled.label,
            )
            for position, labelled in enumerate(statement.scenes)
        )
        added += 1
    return added
