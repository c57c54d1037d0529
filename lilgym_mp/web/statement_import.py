"""Imports statements with labelled scenes from files in the corpus format or in NLVR's."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sqlalchemy import select
from sqlalchemy.orm import Session

from lilgym_mp.appearances import APPEARANCES
from lilgym_mp.corpus.faults import CorpusError, FaultLog
from lilgym_mp.corpus.jsonlines import CorpusFile
from lilgym_mp.corpus.records import JSONFault, as_object, check_text, parse_json, read_text, shown
from lilgym_mp.scene import Scene, SceneError
from lilgym_mp.web.store.models import Statement, StatementScene

MAX_REPORTED_FAULTS = 20
MAX_STATEMENT_LENGTH = 2_000  # characters
MAX_NAME_LENGTH = 200
NLVR_LABELS = {"true": True, "false": False}


class ImportedStatement(NamedTuple):
    """A statement with its labelled scenes: as JSON until they are validated."""

    where: str  # line, for error messages
    name: str
    text: str
    appearance: str | None  # None: to be inferred from the scenes
    split: str
    scenes: list[tuple[Any, bool]]


def read_statements(data: bytes, split: str) -> tuple[list[ImportedStatement], list[str]]:
    """The valid statements of a file in the corpus format or in NLVR's JSON lines, and error messages for the others.

    The first line determines the format. `split` is assigned to NLVR statements, whose files name no split. Raises
    CorpusError if the file is unreadable.
    """
    faults = FaultLog(stop_at_first=False)
    with tempfile.TemporaryDirectory(prefix="lilgym-mp-") as directory:
        path = Path(directory) / "file"
        path.write_bytes(data)
        try:
            text, _ = read_text(path)
            parsed = list(_parse_corpus(path, faults) if _is_corpus(text) else _parse_nlvr(text, split, faults))
        except CorpusError as fault:
            raise CorpusError(str(fault).replace(f"{path}", "the file")) from None
        statements: list[ImportedStatement] = []
        for statement in parsed:
            try:
                statements.append(_validated(statement))
            except (SceneError, ValueError) as fault:
                faults.add(statement.where, str(fault))
        messages = [str(fault).replace(f"{path}", "the file") for fault in faults.found]
    return statements, messages


def _is_corpus(text: str) -> bool:
    first = text.lstrip().split("\n", 1)[0]
    try:
        record = as_object(parse_json(first))
    except JSONFault:
        return False
    return record is not None and "format" in record


def _parse_corpus(path: Path, faults: FaultLog) -> Iterator[ImportedStatement]:
    for entry in CorpusFile(path, faults).entries:
        scenes = [(start.scene, start.label) for start in entry.starts]
        yield ImportedStatement(entry.where, entry.id, entry.statement, entry.appearance, entry.split, scenes)


def _parse_nlvr(text: str, split: str, faults: FaultLog) -> Iterator[ImportedStatement]:
    """Groups lines by statement: NLVR has one line per (statement, scene), identified as STATEMENT-SCENE."""
    by_name: dict[str, ImportedStatement] = {}
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
        parsed = by_name.setdefault(name, ImportedStatement(where, f"nlvr-{name}", sentence, None, split, []))
        if parsed.text != sentence:
            faults.add(where, f"the text of statement {name!r} differs from that in {parsed.where}")
            continue
        parsed.scenes.append((record["structured_rep"], label))
    yield from by_name.values()


def _validated(parsed: ImportedStatement) -> ImportedStatement:
    """Raises ValueError."""
    if not parsed.scenes:
        raise ValueError("the statement has no scenes")
    if len(parsed.text) > MAX_STATEMENT_LENGTH or len(parsed.name) > MAX_NAME_LENGTH:
        raise ValueError(
            f"a statement may have at most {MAX_STATEMENT_LENGTH} characters, its id at most {MAX_NAME_LENGTH}"
        )
    scenes = [Scene.from_json(scene) for scene, _ in parsed.scenes]
    appearance = parsed.appearance or _infer_appearance(scenes)
    checked = [APPEARANCES[appearance].check_scene(scene) for scene in scenes]
    labels = [label for _, label in parsed.scenes]
    return parsed._replace(appearance=appearance, scenes=list(zip(checked, labels, strict=True)))


def _infer_appearance(scenes: Sequence[Scene]) -> str:
    """The first appearance in which all scenes are valid. Raises SceneError if there is none."""
    faults: list[str] = []
    for name in APPEARANCES:
        try:
            for scene in scenes:
                APPEARANCES[name].check_scene(scene)
            return name
        except SceneError as fault:
            faults.append(f"{name}: {fault}")
    raise SceneError("; ".join(faults))


def store_statements(session: Session, statements: Sequence[ImportedStatement]) -> int:
    """Inserts the statements whose names are new; returns how many."""
    names = [statement.name for statement in statements]
    known = set(session.scalars(select(Statement.name).where(Statement.name.in_(names))))
    new: dict[str, ImportedStatement] = {}
    for statement in statements:
        if statement.name not in known:
            new.setdefault(statement.name, statement)
    for _, name, text, appearance, split, scenes in new.values():
        row = Statement(name=name, text=text, appearance=appearance, split=split)
        session.add(row)
        session.flush()
        session.add_all(
            StatementScene(statement_id=row.id, position=position, scene=scene.to_json(), label=label)
            for position, (scene, label) in enumerate(scenes)
        )
    return len(new)
