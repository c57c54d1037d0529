"""/annotate/organise: organisers manage people, batches and imports, review submissions, and export the programs."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from itertools import combinations
from pathlib import Path
from statistics import mean, median
from typing import Annotated, Any, Literal, NamedTuple

from anyio.to_thread import run_sync
from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, Field, StringConstraints
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from lilgym_mp.corpus import CorpusError, write_corpus
from lilgym_mp.corpus.jsonlines import LabelledScene, entry_json
from lilgym_mp.scene import Scene
from lilgym_mp.web import statement_import
from lilgym_mp.web.app_services import Services
from lilgym_mp.web.authentication import (
    ANNOTATOR,
    OPERATOR,
    CurrentOrganiser,
    add_person,
    find_other_person,
    issue_token,
)
from lilgym_mp.web.bodies import Body
from lilgym_mp.web.errors import http_error
from lilgym_mp.web.field_types import ShortText, SplitName
from lilgym_mp.web.program_evaluator import EvaluatorBusy, ProgramEvaluationError, QuotaExceeded
from lilgym_mp.web.routes import annotate
from lilgym_mp.web.routes.annotate import ACCEPTED, MAX_ROW_ID, RowId
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
from lilgym_mp.web.templating import render_page

router = APIRouter()
api = APIRouter(prefix="/api/annotate", tags=["annotate"])

KEPT, DISPUTED, REJECTED = "kept", "disputed", "rejected"
MAX_COMPARED_SCENES = 300  # scenes used for inter-annotator agreement
IMPORT_BATCH = 200  # statements stored at once; other writes take their turn in between
DisplayName = Annotated[
    str, StringConstraints(strip_whitespace=True, min_length=1, max_length=80, pattern=r"^[\w .,()-]+$")
]


class RoleBody(BaseModel):
    role: Literal["annotator", "organiser"]


class NewPerson(RoleBody):
    name: DisplayName
    role: Literal["annotator", "organiser"] = ANNOTATOR


class TokenBody(BaseModel):
    """A person's login path, returned only once."""

    name: str
    path: str


class NewRedistribution(BaseModel):
    name: DisplayName
    people: list[Annotated[int, Field(ge=1, le=MAX_ROW_ID)]] = Field(max_length=1_000)


class NewBatch(NewRedistribution):
    statements: int = Field(20, ge=1, le=100_000)
    annotators_each: int = Field(1, ge=1, le=100)


class CreatedBatch(BaseModel):
    id: int
    assignments: int


class NewReview(BaseModel):
    verdict: Literal["kept", "disputed", "rejected"]
    note: ShortText = ""


class ImportBody(BaseModel):
    """Result of an import: number of valid statements, of new ones, and of errors, with the first errors."""

    read: int
    added: int
    faults: int
    first_faults: list[str]


class BatchSummary(Body):
    """A batch with the number of its assignments by state."""

    id: int
    name: str
    open: int
    done: int
    skipped: int


class PersonSummary(BatchSummary):
    """A person with assignment counts by state, and the number of tutorial tasks solved."""

    role: str
    has_token: bool
    is_fixed: bool  # the caller, or the organiser who starts the server: link and role cannot be changed here
    tutorial: int


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


@router.get("/annotate/organise", include_in_schema=False)
def organise_page(request: Request, person: CurrentOrganiser) -> Response:
    return render_page(request, "organise.html")


@api.post("/imports", openapi_extra={"requestBody": {"content": {"application/octet-stream": {}}, "required": True}})
async def import_file(
    request: Request, services: Services, person: CurrentOrganiser, split: SplitName = "train"
) -> ImportBody:
    """Imports the file in the request's body: a corpus file, or NLVR's JSON lines, which are added to `split`."""
    data = await request.body()

    try:
        result = await run_sync(statement_import.read_statements, data, split)
    except CorpusError as fault:
        raise http_error(422, str(fault)) from None
    added = 0
    for first in range(0, len(result.statements), IMPORT_BATCH):
        batch = result.statements[first : first + IMPORT_BATCH]
        added += await services.database.write(partial(statement_import.store_statements, statements=batch))
    first_faults = result.faults[: statement_import.MAX_REPORTED_FAULTS]
    return ImportBody(read=len(result.statements), added=added, faults=len(result.faults), first_faults=first_faults)


# People


@api.get("/people")
def people(services: Services, person: CurrentOrganiser) -> list[PersonSummary]:
    answers = select(func.count()).where(TutorialAnswer.person_id == Person.id).scalar_subquery()
    query = (
        select(Person, answers.label("tutorial"), *_state_counts())
        .outerjoin(Assignment, Assignment.person_id == Person.id)
        .group_by(Person.id)
        .order_by(Person.name)
    )
    with services.database.read_session() as session:
        return [
            PersonSummary.of(
                found,
                has_token=found.token_hash is not None,
                is_fixed=found.id == person.id or found.name == OPERATOR,
                **counts,
            )
            for found, counts in ((row.Person, row._mapping) for row in session.execute(query))
        ]


def _state_counts() -> list[Any]:
    """Columns: the number of assignments in each state."""
    states = (annotate.STATE_OPEN, annotate.STATE_DONE, annotate.STATE_SKIPPED)
    return [func.count(Assignment.id).filter(Assignment.state == state).label(state) for state in states]


@api.post("/people", status_code=201)
async def new_person(services: Services, person: CurrentOrganiser, new: NewPerson) -> TokenBody:
    """Adds a person with a login link."""
    token = await services.database.write(lambda session: issue_token(add_person(session, new.name, new.role)))
    return TokenBody(name=new.name, path=f"/login?token={token}")


@api.post("/people/{person_id}/token", status_code=201)
async def new_token(services: Services, person: CurrentOrganiser, person_id: RowId) -> TokenBody:
    """Issues a new login link for a person, which ends the older link and all of the person's logins."""

    def replace_token(session: Session) -> tuple[str, str]:
        found = find_other_person(session, person, person_id)
        return found.name, issue_token(found)

    name, token = await services.database.write(replace_token)
    return TokenBody(name=name, path=f"/login?token={token}")


@api.put("/people/{person_id}/role", status_code=204)
async def change_role(services: Services, person: CurrentOrganiser, person_id: RowId, new: RoleBody) -> None:
    """Makes a person an annotator or an organiser."""

    def set_role(session: Session) -> None:
        find_other_person(session, person, person_id).role = new.role

    await services.database.write(set_role)


@api.delete("/people/{person_id}/token", status_code=204)
async def revoke(services: Services, person: CurrentOrganiser, person_id: RowId) -> None:
    """Revokes a person's token, which ends all of their logins."""

    def remove_token(session: Session) -> None:
        find_other_person(session, person, person_id).token_hash = None

    await services.database.write(remove_token)


# Batches


@api.get("/batches")
def batches(services: Services, person: CurrentOrganiser) -> list[BatchSummary]:
    query = (
        select(Batch.id, Batch.name, *_state_counts())
        .join(Assignment, Assignment.batch_id == Batch.id)
        .group_by(Batch.id, Batch.name)
        .order_by(Batch.id)
    )
    with services.database.read_session() as session:
        return [BatchSummary.of(row) for row in session.execute(query)]


@api.post("/batches", status_code=201)
async def create_batch(services: Services, person: CurrentOrganiser, new: NewBatch) -> CreatedBatch:
    """Assigns unassigned statements, in order of import, to people in turn."""

    def assign(session: Session) -> CreatedBatch:
        is_unassigned = Statement.id.not_in(select(Assignment.statement_id))
        query = select(Statement.id).where(is_unassigned).order_by(Statement.id).limit(new.statements)
        work = [(statement, new.annotators_each) for statement in session.scalars(query)]
        if not work:
            raise http_error(409, "every statement has been assigned; import more")
        return _assign(session, new, work)

    return await services.database.write(assign)


@api.post("/redistributions", status_code=201)
async def redistribute(services: Services, person: CurrentOrganiser, new: NewRedistribution) -> CreatedBatch:
    """Assigns each disputed statement, and each skipped by all of its annotators, to one more person."""

    def assign(session: Session) -> CreatedBatch:
        wanted = sorted({*_skipped(session), *_disputed(_submission_records(session))})
        if not wanted:
            raise http_error(409, "no statement is skipped or disputed")
        return _assign(session, new, [(statement, 1) for statement in wanted])

    return await services.database.write(assign)


def _assign(session: Session, new: NewRedistribution, work: Sequence[tuple[int, int]]) -> CreatedBatch:
    """Creates a batch from `work`, pairs of a statement id and the number of annotators; round-robin over people.

    Responds with 409 if the name is taken or these people have had all of these statements, 422 for unknown people.
    """
    known = set(session.scalars(select(Person.id).where(Person.id.in_(new.people), Person.token_hash.is_not(None))))
    unknown = [person for person in new.people if person not in known]
    if not new.people:
        raise http_error(422, "choose at least one person")
    if unknown:
        raise http_error(422, f"unknown people, or without a token: {', '.join(map(str, unknown))}")
    if session.scalar(select(Batch.id).where(Batch.name == new.name)) is not None:
        raise http_error(409, f"a batch named {new.name!r} already exists")
    taken = {tuple(row) for row in session.execute(select(Assignment.statement_id, Assignment.person_id))}
    scene_counts = Counter(session.scalars(select(StatementScene.statement_id)))
    batch = Batch(name=new.name)
    session.add(batch)
    session.flush()
    people = list(dict.fromkeys(new.people))
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
    return CreatedBatch(id=batch.id, assignments=created)


def _skipped(session: Session) -> set[int]:
    """Ids of statements skipped by everybody they were assigned to."""
    is_skipped = Assignment.state == annotate.STATE_SKIPPED
    query = select(Assignment.statement_id).group_by(Assignment.statement_id)
    return set(session.scalars(query.having(func.count() == func.count().filter(is_skipped))))


# Reviews


class _SubmissionRecord(NamedTuple):
    """A submission joined with its statement, its annotator and its latest review."""

    submission: Submission
    statement_id: int
    annotator: str
    review: Review | None

    @property
    def reviewed(self) -> str | None:
        return self.review and self.review.verdict


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
    reviews = annotate.latest_reviews(session, [submission.id for submission, _, _ in rows])
    return [
        _SubmissionRecord(submission, statement, name, reviews.get(submission.id))
        for submission, statement, name in rows
    ]


def _disputed(records: Sequence[_SubmissionRecord]) -> set[int]:
    """Ids of statements with a disputed submission and none kept in review."""
    disputed, kept = (
        {record.statement_id for record in records if record.reviewed == verdict} for verdict in (DISPUTED, KEPT)
    )
    return disputed - kept


def _eligible_submissions(records: Iterable[_SubmissionRecord]) -> dict[int, dict[str, Submission]]:
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
    records = _submission_records(session, [statement.id for statement in statements])
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


def _kept_programs(records: Sequence[_SubmissionRecord]) -> dict[int, str]:
    """The program to export for each statement id; disputed statements have none.

    Among eligible submissions, one kept in review wins, then the most confident, the shortest, the latest.
    """
    disputed = _disputed(records)
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
        programs = _kept_programs(_submission_records(session))
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
        records = _submission_records(session)
        statements, scenes = (session.scalar(select(count)) or 0 for count in counted)
        assigned = session.scalar(select(func.count(func.distinct(Assignment.statement_id)))) or 0
        skipped = len(_skipped(session))
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
        disputed=len(_disputed(records)),
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


router.include_router(api)
