"""Organisers' side of annotation: people, batches, reviews with inter-annotator agreement, statistics, export."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from itertools import combinations
from pathlib import Path
from statistics import mean, median
from typing import Any, NamedTuple

from pydantic import BaseModel
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from lilgym_mp.corpus import write_corpus
from lilgym_mp.corpus.exporting import LabelledScene, entry_json
from lilgym_mp.scene import Scene
from lilgym_mp.web.annotation import ACCEPTED, FAILED, SKIPPED, STATE_DONE, STATE_OPEN, STATE_SKIPPED, latest_reviews
from lilgym_mp.web.authentication import OPERATOR
from lilgym_mp.web.errors import http_error
from lilgym_mp.web.program_evaluator import EvaluatorBusy, ProgramEvaluationError, ProgramEvaluator, QuotaExceeded
from lilgym_mp.web.store.models import (
    Assignment,
    Batch,
    Person,
    Review,
    Statement,
    StatementScene,
    Submission,
    TutorialAnswer,
)

KEPT, DISPUTED, REJECTED = "kept", "disputed", "rejected"
MAX_COMPARED_SCENES = 300  # scenes used for inter-annotator agreement


class PersonSummary(BaseModel):
    """A person with assignment counts by state, and the number of tutorial tasks solved."""

    id: int
    name: str
    role: str
    has_token: bool
    is_fixed: bool  # the caller, or the organiser who starts the server: link and role cannot be changed here
    open: int
    done: int
    skipped: int
    tutorial: int


class BatchSummary(BaseModel):
    id: int
    name: str
    open: int
    done: int
    skipped: int


class ReviewedSubmission(BaseModel):
    """A submission as organisers see it, with its latest review."""

    id: int
    annotator: str
    verdict: str
    program: str
    confidence: int | None
    reason: str
    comment: str
    question: str
    seconds: float
    created: datetime
    review: str | None
    note: str


class StatementReview(BaseModel):
    """A statement with all of its submissions. `agreement`: the share of scenes on which two annotators' programs have
    the same truth value, averaged over pairs; null with fewer than two eligible programs."""

    id: int
    name: str
    statement: str
    appearance: str
    agreement: float | None
    compared_scenes: int
    submissions: list[ReviewedSubmission]


class AnnotatorStatistics(BaseModel):
    name: str
    accepted: int
    failed: int
    skipped: int
    median_seconds: float | None


class StatisticsBody(BaseModel):
    """Progress of the annotation. `collected`: statements with an accepted program; `kept`: statements to export."""

    statements: int
    scenes: int
    assigned: int
    collected: int
    kept: int
    skipped: int
    disputed: int
    mean_seconds: float | None
    median_seconds: float | None
    annotators: list[AnnotatorStatistics]


def list_people(session: Session, caller: Person) -> list[PersonSummary]:
    counts = {
        (person, state): count
        for person, state, count in session.execute(
            select(Assignment.person_id, Assignment.state, func.count()).group_by(
                Assignment.person_id, Assignment.state
            )
        )
    }
    answered = _to_dict(
        session.execute(select(TutorialAnswer.person_id, func.count()).group_by(TutorialAnswer.person_id))
    )
    return [
        PersonSummary(
            id=person.id,
            name=person.name,
            role=person.role,
            has_token=person.token_hash is not None,
            is_fixed=person.id == caller.id or person.name == OPERATOR,
            open=counts.get((person.id, STATE_OPEN), 0),
            done=counts.get((person.id, STATE_DONE), 0),
            skipped=counts.get((person.id, STATE_SKIPPED), 0),
            tutorial=answered.get(person.id, 0),
        )
        for person in session.scalars(select(Person).order_by(Person.name))
    ]


def list_batches(session: Session) -> list[BatchSummary]:
    rows = session.execute(
        select(
            Batch.id,
            Batch.name,
            *(func.count().filter(Assignment.state == state) for state in (STATE_OPEN, STATE_DONE, STATE_SKIPPED)),
        )
        .join(Assignment, Assignment.batch_id == Batch.id)
        .group_by(Batch.id, Batch.name)
        .order_by(Batch.id)
    )
    return [
        BatchSummary(id=batch_id, name=name, open=open_count, done=done, skipped=skipped)
        for batch_id, name, open_count, done, skipped in map(tuple[Any, ...], rows)
    ]


def create_batch(
    session: Session, name: str, person_ids: Sequence[int], statements: int, annotators_each: int
) -> tuple[Batch, int]:
    """Assigns up to `statements` unassigned statements, in order of import, to the people in turn.

    Returns the batch and its number of assignments. Responds with 409 if there is nothing to assign or the name is
    taken, 422 for unknown people.
    """
    assigned = select(Assignment.statement_id)
    unassigned = session.scalars(
        select(Statement.id).where(Statement.id.not_in(assigned)).order_by(Statement.id).limit(statements)
    ).all()
    if not unassigned:
        raise http_error(409, "every statement has been assigned; import more")
    return _assign(session, name, person_ids, [(statement, annotators_each) for statement in unassigned])


def redistribute(session: Session, name: str, person_ids: Sequence[int]) -> tuple[Batch, int]:
    """Assigns every disputed statement, and every one skipped by all of its annotators, to one more person.

    Responds with 409 if there is no such statement, or none that these people have not had yet.
    """
    work = [(statement, 1) for statement in sorted({*_skipped(session), *_disputed(session)})]
    if not work:
        raise http_error(409, "no statement is skipped or disputed")
    return _assign(session, name, person_ids, work)


def _assign(
    session: Session, name: str, person_ids: Sequence[int], work: Sequence[tuple[int, int]]
) -> tuple[Batch, int]:
    """Creates a batch from `work`, pairs of a statement id and the number of annotators; round-robin over people."""
    known = set(session.scalars(select(Person.id).where(Person.id.in_(person_ids), Person.token_hash.is_not(None))))
    unknown = [person for person in person_ids if person not in known]
    if not person_ids:
        raise http_error(422, "choose at least one person")
    if unknown:
        raise http_error(422, f"unknown people, or without a token: {', '.join(map(str, unknown))}")
    if session.scalar(select(Batch.id).where(Batch.name == name)) is not None:
        raise http_error(409, f"a batch named {name!r} already exists")
    taken = {tuple(row) for row in session.execute(select(Assignment.statement_id, Assignment.person_id))}
    scene_counts = _to_dict(
        session.execute(select(StatementScene.statement_id, func.count()).group_by(StatementScene.statement_id))
    )
    batch = Batch(name=name)
    session.add(batch)
    session.flush()
    people = list(dict.fromkeys(person_ids))
    created, turn = 0, 0
    for statement, annotators in work:
        for _ in range(len(people)):
            if not annotators:
                break
            person = people[turn % len(people)]
            turn += 1
            if (statement, person) in taken:
                continue
            shown = (statement + created) % scene_counts[statement]
            session.add(Assignment(batch_id=batch.id, statement_id=statement, person_id=person, shown=shown))
            created += 1
            annotators -= 1
    if not created:
        raise http_error(409, "these people have already had all of these statements; choose others")
    session.flush()
    return batch, created


def _skipped(session: Session) -> set[int]:
    """Ids of statements skipped by everybody they were assigned to."""
    rows = session.execute(
        select(Assignment.statement_id)
        .group_by(Assignment.statement_id)
        .having(func.count() == func.count().filter(Assignment.state == STATE_SKIPPED))
    )
    return {statement for (statement,) in rows}


class _SubmissionRecord(NamedTuple):
    """A submission joined with its statement, its annotator and its latest review."""

    submission: Submission
    statement_id: int
    annotator: str
    review: Review | None

    @property
    def is_eligible(self) -> bool:
        """Accepted, and neither disputed nor rejected in review: may be exported."""
        return self.submission.verdict == ACCEPTED and (self.review is None or self.review.verdict == KEPT)


def _submission_records(session: Session, statement_ids: Sequence[int] | None = None) -> list[_SubmissionRecord]:
    """All submissions, or those for the statements, in order of submission."""
    query = (
        select(Submission, Assignment.statement_id, Person.name)
        .join(Assignment, Assignment.id == Submission.assignment_id)
        .join(Person, Person.id == Assignment.person_id)
        .order_by(Submission.id)
    )
    if statement_ids is not None:
        query = query.where(Assignment.statement_id.in_(statement_ids))
    rows = session.execute(query).all()
    reviews = latest_reviews(session, [submission.id for submission, _, _ in rows])
    return [
        _SubmissionRecord(submission, statement, name, reviews.get(submission.id))
        for submission, statement, name in rows
    ]


def _disputed(session: Session) -> set[int]:
    """Ids of statements with a disputed submission and none kept in review."""
    records = _submission_records(session)
    disputed = {record.statement_id for record in records if record.review and record.review.verdict == DISPUTED}
    return disputed - {record.statement_id for record in records if record.review and record.review.verdict == KEPT}


def _eligible_submissions(records: Iterable[_SubmissionRecord]) -> dict[int, dict[str, Submission]]:
    """Each annotator's latest eligible submission, by statement id and annotator."""
    found: dict[int, dict[str, Submission]] = {}
    for record in records:
        if record.is_eligible:
            found.setdefault(record.statement_id, {})[record.annotator] = record.submission
    return found


class ComparedPrograms(NamedTuple):
    """A statement's review, the programs whose truth values it compares, and the scenes to compare them on."""

    review: StatementReview
    programs: list[str]
    scenes: list[Scene]


def review_page(session: Session, first: int, most: int) -> list[ComparedPrograms]:
    """At most `most` statements with submissions, from id `first` on, whose agreement is still to be computed."""
    submitted = select(Assignment.statement_id).join(Submission, Submission.assignment_id == Assignment.id)
    statements = session.scalars(
        select(Statement).where(Statement.id.in_(submitted), Statement.id >= first).order_by(Statement.id).limit(most)
    ).all()
    records = _submission_records(session, [statement.id for statement in statements])
    eligible = _eligible_submissions(records)
    comparison_scenes: dict[str, list[Scene]] = {}  # by appearance
    compared: list[ComparedPrograms] = []
    for statement in statements:
        programs = [submission.program for submission in eligible.get(statement.id, {}).values()]
        if len(programs) > 1 and statement.appearance not in comparison_scenes:
            comparison_scenes[statement.appearance] = _comparison_scenes(session, statement.appearance)
        review = StatementReview(
            id=statement.id,
            name=statement.name,
            statement=statement.text,
            appearance=statement.appearance,
            agreement=None,
            compared_scenes=0,
            submissions=[_reviewed(record) for record in records if record.statement_id == statement.id],
        )
        compared.append(ComparedPrograms(review, programs, comparison_scenes.get(statement.appearance, [])))
    return compared


async def with_agreement(
    evaluator: ProgramEvaluator, person: Person, compared: Sequence[ComparedPrograms]
) -> list[StatementReview]:
    """The reviews with inter-annotator agreement, as far as the programs can be evaluated."""
    for review, programs, scenes in compared:
        if len(programs) < 2:
            continue
        with suppress(ProgramEvaluationError, EvaluatorBusy, QuotaExceeded):
            truths = [(await evaluator.evaluate(person.id, program, scenes)).truths for program in programs]
            shares = [mean(x is y for x, y in zip(a, b, strict=True)) for a, b in combinations(truths, 2)]
            review.agreement, review.compared_scenes = round(mean(shares), 4), len(scenes)
    return [review for review, _, _ in compared]


def _reviewed(record: _SubmissionRecord) -> ReviewedSubmission:
    submission = record.submission
    return ReviewedSubmission(
        id=submission.id,
        annotator=record.annotator,
        verdict=submission.verdict,
        program=submission.program,
        confidence=submission.confidence,
        reason=submission.reason,
        comment=submission.comment,
        question=submission.question,
        seconds=round(submission.seconds, 1),
        created=submission.created,
        review=record.review.verdict if record.review else None,
        note=record.review.note if record.review else "",
    )


def _comparison_scenes(session: Session, appearance: str) -> list[Scene]:
    """The empty scene, and up to MAX_COMPARED_SCENES - 1 of the appearance, taken evenly from all statements."""
    rows = session.scalars(
        select(StatementScene.scene)
        .join(Statement, Statement.id == StatementScene.statement_id)
        .where(Statement.appearance == appearance)
        .order_by(StatementScene.position, StatementScene.id)
        .limit(MAX_COMPARED_SCENES - 1)
    )
    return [Scene.empty(), *map(Scene.from_json, rows)]


def add_review(session: Session, reviewer: Person, submission_id: int, verdict: str, note: str) -> None:
    """Responds with 404 if there is no such submission."""
    if session.get(Submission, submission_id) is None:
        raise http_error(404, f"there is no submission {submission_id}")
    session.add(Review(submission_id=submission_id, reviewer_id=reviewer.id, verdict=verdict, note=note))


def kept_programs(session: Session) -> dict[int, str]:
    """The program to export for each statement id; disputed statements have none.

    Among eligible submissions, one kept in review wins, then the most confident, the shortest, the latest.
    """
    records = _submission_records(session)
    disputed = _disputed(session)
    kept = {record.submission.id for record in records if record.review and record.review.verdict == KEPT}

    def priority(submission: Submission) -> tuple[bool, int, int, int]:
        confidence = submission.confidence or 0
        return submission.id in kept, confidence, -len(submission.program), submission.id

    return {
        statement: max(by_annotator.values(), key=priority).program
        for statement, by_annotator in _eligible_submissions(records).items()
        if statement not in disputed
    }


def export_corpus(session: Session) -> bytes:
    """The kept statements as a corpus file. Responds with 409 if there are none."""
    programs = kept_programs(session)
    if not programs:
        raise http_error(409, "no statement has a program to export")
    with tempfile.TemporaryDirectory(prefix="lilgym-mp-") as directory:
        path = Path(directory) / "corpus.jsonl"
        write_corpus(path, "annotated statements", "as their sources", _corpus_entries(session, programs))
        return path.read_bytes()


def _corpus_entries(session: Session, programs: Mapping[int, str]) -> Iterator[dict[str, object]]:
    taken: set[str] = set(session.scalars(select(Statement.name)))
    for statement in session.scalars(select(Statement).where(Statement.id.in_(list(programs))).order_by(Statement.id)):
        scenes = session.scalars(
            select(StatementScene).where(StatementScene.statement_id == statement.id).order_by(StatementScene.position)
        )
        starts: list[tuple[str, LabelledScene]] = []
        for scene in scenes:
            name = f"{statement.name}/{scene.position}"
            while name in taken:
                name += "'"
            taken.add(name)
            starts.append((name, LabelledScene(Scene.from_json(scene.scene), scene.label)))
        yield entry_json(
            statement.name, statement.appearance, statement.split, statement.text, programs[statement.id], starts
        )


def statistics(session: Session) -> StatisticsBody:
    records = _submission_records(session)
    accepted = [record for record in records if record.submission.verdict == ACCEPTED]
    seconds = [record.submission.seconds for record in accepted]
    return StatisticsBody(
        statements=_count(session, Statement),
        scenes=_count(session, StatementScene),
        assigned=session.scalar(select(func.count(func.distinct(Assignment.statement_id)))) or 0,
        collected=len({record.statement_id for record in accepted}),
        kept=len(kept_programs(session)),
        skipped=len(_skipped(session)),
        disputed=len(_disputed(session)),
        mean_seconds=_rounded(mean, seconds),
        median_seconds=_rounded(median, seconds),
        annotators=[
            _annotator_statistics(name, [record.submission for record in records if record.annotator == name])
            for name in sorted({record.annotator for record in records})
        ],
    )


def _annotator_statistics(name: str, submissions: Sequence[Submission]) -> AnnotatorStatistics:
    counts = Counter(submission.verdict for submission in submissions)
    return AnnotatorStatistics(
        name=name,
        accepted=counts[ACCEPTED],
        failed=counts[FAILED],
        skipped=counts[SKIPPED],
        median_seconds=_rounded(
            median, [submission.seconds for submission in submissions if submission.verdict == ACCEPTED]
        ),
    )


def _rounded(summary: Callable[[Sequence[float]], float], values: Sequence[float]) -> float | None:
    return round(summary(values), 1) if values else None


def _to_dict(rows: Iterable[Sequence[Any]]) -> dict[int, int]:
    return {row[0]: row[1] for row in rows}


def _count(session: Session, table: type) -> int:
    return session.scalar(select(func.count()).select_from(table)) or 0
