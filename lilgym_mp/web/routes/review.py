"""The part of /annotate/organise that reviews submissions, counts them, and exports the programs."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import combinations
from pathlib import Path
from statistics import mean, median
from typing import Annotated, Literal, NamedTuple

from anyio.to_thread import run_sync
from fastapi import APIRouter, Query, Response
from pydantic import BaseModel
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from lilgym_mp.corpus import write_corpus
from lilgym_mp.corpus.jsonlines import LabelledScene, entry_json
from lilgym_mp.scene import Scene
from lilgym_mp.web.app_services import Services
from lilgym_mp.web.authentication import CurrentOrganiser
from lilgym_mp.web.bodies import Body
from lilgym_mp.web.errors import http_error
from lilgym_mp.web.field_types import ShortText
from lilgym_mp.web.program_evaluator import EvaluatorBusy, ProgramEvaluationError, QuotaExceeded
from lilgym_mp.web.routes import annotate
from lilgym_mp.web.routes.annotate import ACCEPTED, MAX_ROW_ID, RowId
from lilgym_mp.web.store.models import Assignment, Person, Review, Statement, StatementScene, Submission

api = APIRouter(prefix="/api/annotate", tags=["annotate"])

KEPT, DISPUTED = "kept", "disputed"
MAX_COMPARED_SCENES = 300  # scenes used for inter-annotator agreement


class NewReview(BaseModel):
    verdict: Literal["kept", "disputed", "rejected"]
    note: ShortText = ""


class ReviewedSubmission(annotate.ReviewedSubmission):
    """A submission as organisers see it."""

    annotator: str
    seconds: float


class StatementReview(Body):
    """A statement with all of its submissions. `agreement`: the share of scenes on which two annotators' programs have
    the same truth value, averaged over pairs; null with fewer than two eligible programs."""

    id: int
    name: str
    statement: str
    appearance: str
    agreement: float | None
    compared_scenes: int
    submissions: list[ReviewedSubmission]


class AnnotatorStatistics(Body):
    name: str
    accepted: int
    failed: int
    skipped: int
    median_seconds: float | None


class StatisticsBody(Body):
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


class SubmissionRecord(NamedTuple):
    """A submission joined with its statement, its annotator and its latest review."""

    submission: Submission
    statement_id: int
    annotator: str
    review: Review | None

    @property
    def reviewed(self) -> str | None:
        return self.review and self.review.verdict


def submission_records(session: Session, statement_ids: Sequence[int] | None = None) -> list[SubmissionRecord]:
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
    reviews = annotate.latest_reviews(session, [submission.id for submission, _, _ in rows])
    return [
        SubmissionRecord(submission, statement, name, reviews.get(submission.id))
        for submission, statement, name in rows
    ]


def disputed_statements(records: Sequence[SubmissionRecord]) -> set[int]:
    """Ids of statements with a disputed submission and none kept in review."""
    disputed, kept = (
        {record.statement_id for record in records if record.reviewed == verdict} for verdict in (DISPUTED, KEPT)
    )
    return disputed - kept


def _eligible_submissions(records: Iterable[SubmissionRecord]) -> dict[int, dict[str, Submission]]:
    """Each annotator's latest submission that may be exported, by statement id and annotator: accepted, and neither
    disputed nor rejected in review."""
    found: dict[int, dict[str, Submission]] = {}
    for record in records:
        if record.submission.verdict == ACCEPTED and record.reviewed in (None, KEPT):
            found.setdefault(record.statement_id, {})[record.annotator] = record.submission
    return found


@api.get("/reviews")
async def reviews(
    services: Services,
    person: CurrentOrganiser,
    first: Annotated[int, Query(ge=0, le=MAX_ROW_ID)] = 0,
    most: Annotated[int, Query(ge=1, le=100)] = 20,
) -> list[StatementReview]:
    """Statements with their submissions, from id `first` on."""

    def read() -> list[tuple[StatementReview, list[str], list[Scene]]]:
        with services.database.read_session() as session:
            return list(_review_page(session, first, most))

    page = await run_sync(read)
    for review, programs, scenes in page:
        if len(programs) < 2:
            continue
        with suppress(ProgramEvaluationError, EvaluatorBusy, QuotaExceeded):  # then the agreement stays unknown
            truths = [(await services.evaluator.evaluate(person.id, program, scenes)).truths for program in programs]
            shares = [mean(x is y for x, y in zip(a, b, strict=True)) for a, b in combinations(truths, 2)]
            review.agreement, review.compared_scenes = round(mean(shares), 4), len(scenes)
    return [review for review, _, _ in page]


def _review_page(session: Session, first: int, most: int) -> Iterator[tuple[StatementReview, list[str], list[Scene]]]:
    """At most `most` statements with submissions, from id `first` on, each with the programs whose agreement is to be
    computed, and the scenes to compare them on."""
    submitted = select(Assignment.statement_id).join(Submission, Submission.assignment_id == Assignment.id)
    statements = session.scalars(
        select(Statement).where(Statement.id.in_(submitted), Statement.id >= first).order_by(Statement.id).limit(most)
    ).all()
    records = submission_records(session, [statement.id for statement in statements])
    eligible = _eligible_submissions(records)
    scenes: dict[str, list[Scene]] = {}  # by appearance
    for statement in statements:
        programs = [submission.program for submission in eligible.get(statement.id, {}).values()]
        if len(programs) > 1 and statement.appearance not in scenes:
            scenes[statement.appearance] = _comparison_scenes(session, statement.appearance)
        review = StatementReview.of(
            statement,
            statement=statement.text,
            agreement=None,
            compared_scenes=0,
            submissions=[
                ReviewedSubmission.of(
                    record.submission,
                    annotator=record.annotator,
                    seconds=round(record.submission.seconds, 1),
                    **annotate.review_fields(record.review),
                )
                for record in records
                if record.statement_id == statement.id
            ],
        )
        yield review, programs, scenes.get(statement.appearance, [])


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


@api.post("/submissions/{submission_id}/reviews", status_code=204)
async def review(services: Services, person: CurrentOrganiser, submission_id: RowId, new: NewReview) -> None:
    """Reviews a submission; its author sees the verdict and the note."""

    def add_review(session: Session) -> None:
        if session.get(Submission, submission_id) is None:
            raise http_error(404, f"there is no submission {submission_id}")
        session.add(Review(submission_id=submission_id, reviewer_id=person.id, **new.model_dump()))

    await services.database.write(add_review)


# Results


def _kept_programs(records: Sequence[SubmissionRecord]) -> dict[int, str]:
    """The program to export for each statement id; disputed statements have none.

    Among eligible submissions, one kept in review wins, then the most confident, the shortest, the latest.
    """
    disputed = disputed_statements(records)
    kept = {record.submission.id for record in records if record.reviewed == KEPT}

    def priority(submission: Submission) -> tuple[bool, int, int, int]:
        confidence = submission.confidence or 0
        return submission.id in kept, confidence, -len(submission.program), submission.id

    return {
        statement: max(by_annotator.values(), key=priority).program
        for statement, by_annotator in _eligible_submissions(records).items()
        if statement not in disputed
    }


@api.get("/export", response_class=Response)
def export(services: Services, person: CurrentOrganiser) -> Response:
    """The kept statements as a corpus file, which `lilgym-mp data check` accepts."""
    with services.database.read_session() as session, tempfile.TemporaryDirectory(prefix="lilgym-mp-") as directory:
        programs = _kept_programs(submission_records(session))
        if not programs:
            raise http_error(409, "no statement has a program to export")
        path = Path(directory) / "corpus.jsonl"
        write_corpus(path, "annotated statements", "as their sources", _corpus_entries(session, programs))
        data = path.read_bytes()
    headers = {"Content-Disposition": 'attachment; filename="annotated.jsonl"'}
    return Response(data, media_type="application/jsonl", headers=headers)


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


@api.get("/statistics")
def statistics(services: Services, person: CurrentOrganiser) -> StatisticsBody:
    counted = func.count(Statement.id), func.count(StatementScene.id)
    with services.database.read_session() as session:
        records = submission_records(session)
        statements, scenes = (session.scalar(select(count)) or 0 for count in counted)
        assigned = session.scalar(select(func.count(func.distinct(Assignment.statement_id)))) or 0
        skipped = len(skipped_statements(session))
    accepted = [record for record in records if record.submission.verdict == ACCEPTED]
    by_annotator: dict[str, list[Submission]] = {}
    for record in sorted(records, key=lambda record: record.annotator):
        by_annotator.setdefault(record.annotator, []).append(record.submission)
    return StatisticsBody(
        statements=statements,
        scenes=scenes,
        assigned=assigned,
        collected=len({record.statement_id for record in accepted}),
        kept=len(_kept_programs(records)),
        skipped=skipped,
        disputed=len(disputed_statements(records)),
        mean_seconds=_seconds(mean, [record.submission for record in accepted]),
        median_seconds=_seconds(median, [record.submission for record in accepted]),
        annotators=[_annotator_statistics(*entry) for entry in by_annotator.items()],
    )


def _annotator_statistics(name: str, submissions: Sequence[Submission]) -> AnnotatorStatistics:
    counts = Counter(submission.verdict for submission in submissions)
    verdicts = {verdict: counts[verdict] for verdict in annotate.VERDICT_MESSAGES}
    accepted = [submission for submission in submissions if submission.verdict == ACCEPTED]
    return AnnotatorStatistics(name=name, median_seconds=_seconds(median, accepted), **verdicts)


def _seconds(summary: Callable[[list[float]], float], submissions: Sequence[Submission]) -> float | None:
    return round(summary([submission.seconds for submission in submissions]), 1) if submissions else None


def skipped_statements(session: Session) -> set[int]:
    """Ids of statements skipped by everybody they were assigned to."""
    isskipped_statements = Assignment.state == annotate.STATE_SKIPPED
    query = select(Assignment.statement_id).group_by(Assignment.statement_id)
    return set(session.scalars(query.having(func.count() == func.count().filter(isskipped_statements))))
