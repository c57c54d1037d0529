"""/annotate: write programs for statements, run them on the shown scene, submit them to be checked; the tutorial."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Annotated, Any, Literal, NamedTuple, get_args

from anyio.to_thread import run_sync
from fastapi import APIRouter, Path, Request, Response
from pydantic import AfterValidator, BaseModel, Field, StringConstraints
from sqlalchemy import select, update
from sqlalchemy.orm import Session

from lilgym_mp.programs.syntax import MAX_LENGTH
from lilgym_mp.scene import Scene
from lilgym_mp.web import language
from lilgym_mp.web.app_services import AppServices, Services
from lilgym_mp.web.authentication import CurrentCaller, CurrentPerson
from lilgym_mp.web.bodies import Body, ProgramPart, SceneBody, scene_body
from lilgym_mp.web.errors import http_error
from lilgym_mp.web.field_types import RandomId, ShortText, storable
from lilgym_mp.web.program_evaluator import (
    MAX_REQUESTS,
    EvaluatorBusy,
    ProgramEvaluation,
    ProgramEvaluationError,
    QuotaExceeded,
)
from lilgym_mp.web.store.models import Assignment, Batch, Person, Review, Statement, StatementScene, Submission, now
from lilgym_mp.web.templating import render_page

router = APIRouter()
api = APIRouter(prefix="/api/annotate", tags=["annotate"])

STATE_OPEN, STATE_DONE, STATE_SKIPPED = "open", "done", "skipped"
ACCEPTED, FAILED, SKIPPED = "accepted", "failed", "skipped"
VERDICT_MESSAGES = {
    ACCEPTED: "Accepted: your program agrees with every scene of the statement.",
    FAILED: "Your program agrees with the shown scene but not with a hidden one. It was saved; reread the statement.",
    SKIPPED: "Skipped. The statement may be assigned to somebody else.",
}
MAX_ROW_ID = 2**31 - 1
RowId = Annotated[int, Path(ge=1, le=MAX_ROW_ID)]
ProgramText = Annotated[str, StringConstraints(max_length=2 * MAX_LENGTH), AfterValidator(storable)]
SkipReason = Literal["ambiguous", "cannot be expressed", "wrong label", "not English", "too hard", "other"]
LabelledScenes = Sequence[tuple[Scene, bool]]


class ProgramBody(BaseModel):
    program: ProgramText


class DraftBody(ProgramBody):
    """The editor's text, and the draft version it is based on."""

    version: int = Field(ge=0, le=MAX_ROW_ID)


class SavedDraft(BaseModel):
    version: int


class _NewSubmission(BaseModel):
    key: RandomId
    comment: ShortText = ""
    question: ShortText = ""


class NewSubmission(_NewSubmission, ProgramBody):
    """A program; `key` is an idempotency key chosen by the client, so that a retry is stored once."""

    confidence: int | None = Field(None, ge=1, le=5)


class NewSkip(_NewSubmission):
    reason: SkipReason


class AssignmentSummary(Body):
    """An entry of the annotator's assignment list."""

    id: int
    batch: str
    statement: str
    state: str


class ReviewedSubmission(Body):
    """A submission with its latest review."""

    id: int
    verdict: str
    program: str
    confidence: int | None
    reason: str
    comment: str
    question: str
    created: datetime
    review: str | None
    note: str


class SubmissionBody(ReviewedSubmission):
    """A submission as its author sees it."""

    assignment: int
    statement: str


class AssignmentBody(AssignmentSummary):
    """An assignment as the annotator sees it: of the hidden scenes, only their number."""

    label: bool
    scene: SceneBody
    hidden_scenes: int
    draft: str
    draft_version: int
    submissions: list[SubmissionBody]


class RunBody(Body):
    """A program's truth value on the shown scene; null if evaluation failed, with the error in `fault`."""

    truth: bool | None
    label: bool
    agrees: bool
    fault: str | None
    parts: list[ProgramPart]


class VerdictBody(Body):
    """The verdict on a submission: accepted, failed on some hidden scene, or skipped."""

    id: int
    verdict: str
    message: str


# Pages


@router.get("/annotate", include_in_schema=False)
def home_page(request: Request, caller: CurrentCaller) -> Response:
    return render_page(request, "annotate.html", is_organiser=caller.is_organiser)


@router.get("/annotate/guidelines", include_in_schema=False)
def guidelines_page(request: Request) -> Response:
    return render_page(request, "guidelines.html", language=language.language())


@router.get("/annotate/{assignment_id}", include_in_schema=False)
def work_page(request: Request, person: CurrentPerson, services: Services, assignment_id: RowId) -> Response:
    with services.database.read_session() as session:
        find_assignment(session, person, assignment_id)
    reasons = get_args(SkipReason)
    return render_page(request, "annotate_work.html", assignment_id=assignment_id, reasons=reasons)


# The language


@api.get("/language")
def words() -> language.LanguageBody:
    """All words of the program language, with signatures and documentation."""
    return language.language()


@api.post("/check")
def check(text: ProgramBody) -> language.CheckBody:
    """Checks the syntax of a program."""
    return language.check(text.program)


# Assignments and submissions of the annotator logged in


@api.get("/assignments")
def assignments(services: Services, person: CurrentPerson) -> list[AssignmentSummary]:
    columns = Assignment.id, Batch.name.label("batch"), Statement.text.label("statement"), Assignment.state
    query = (
        select(*columns)
        .join(Batch, Batch.id == Assignment.batch_id)
        .join(Statement, Statement.id == Assignment.statement_id)
        .where(Assignment.person_id == person.id)
        .order_by(Assignment.id)
    )
    with services.database.read_session() as session:
        return [AssignmentSummary.of(row) for row in session.execute(query)]


@api.get("/assignments/{assignment_id}")
async def assignment(services: Services, person: CurrentPerson, assignment_id: RowId) -> AssignmentBody:
    """The statement, its shown scene and label, and the draft program."""

    def read() -> tuple[AssignmentBody, bool]:
        with services.database.read_session() as session:
            found = find_assignment(session, person, assignment_id)
            submissions = submission_history(session, person, assignment_id)
        scene, label = found.shown
        body = AssignmentBody.of(
            found.assignment,
            batch=found.batch,
            statement=found.statement,
            label=label,
            scene=scene_body(scene),
            hidden_scenes=len(found.scenes) - 1,
            submissions=submissions,
        )
        return body, found.assignment.opened is None

    body, is_new = await run_sync(read)
    if is_new:
        never_opened = Assignment.id == assignment_id, Assignment.opened.is_(None)
        await services.database.write(
            lambda session: session.execute(update(Assignment).where(*never_opened).values(opened=now()))
        )
    return body


@api.put("/assignments/{assignment_id}/draft")
async def draft(services: Services, person: CurrentPerson, assignment_id: RowId, written: DraftBody) -> SavedDraft:
    """Saves the editor's text."""

    def save(session: Session) -> int:
        assignment = lock_assignment(session, person, assignment_id)
        if assignment.draft != written.program:
            if assignment.draft_version != written.version:
                raise http_error(
                    409, "the program was changed in another tab or window; reload to see it, your text stays here"
                )
            assignment.draft = written.program
            assignment.draft_version += 1
        return assignment.draft_version

    return SavedDraft(version=await services.database.write(save))


@api.post("/assignments/{assignment_id}/run")
async def run(services: Services, person: CurrentPerson, assignment_id: RowId, written: ProgramBody) -> RunBody:
    """Runs a program on the shown scene."""

    def read() -> tuple[Scene, bool]:
        with services.database.read_session() as session:
            return find_assignment(session, person, assignment_id).shown

    return await run_program(services, person, written.program, *await run_sync(read))


@api.post("/assignments/{assignment_id}/submissions", status_code=201)
async def submit(services: Services, person: CurrentPerson, assignment_id: RowId, new: NewSubmission) -> VerdictBody:
    """Submits a program that agrees with the shown scene; it is then checked on the hidden scenes."""

    def read() -> tuple[Submission | None, AssignmentDetails]:
        with services.database.read_session() as session:
            found = find_assignment(session, person, assignment_id)
            return find_submission(session, assignment_id, new.key), found

    submission, found = await run_sync(read)
    if submission is not None:
        return verdict_body(submission.verdict, submission.id)
    verdict = await check_program(services, person, new.program, found.scenes, found.assignment.shown)
    return await store_submission(services, person, assignment_id, new, verdict)


@api.post("/assignments/{assignment_id}/skip", status_code=201)
async def skip(services: Services, person: CurrentPerson, assignment_id: RowId, new: NewSkip) -> VerdictBody:
    """Skips the statement, with a reason."""
    return await store_submission(services, person, assignment_id, new, SKIPPED)


@api.get("/history")
def history(services: Services, person: CurrentPerson) -> list[SubmissionBody]:
    """Your submissions, with their reviews."""
    with services.database.read_session() as session:
        return submission_history(session, person)


# What several routes share


class AssignmentDetails(NamedTuple):
    """An assignment with its statement's text, its batch's name and its labelled scenes."""

    assignment: Assignment
    statement: str
    batch: str
    scenes: LabelledScenes

    @property
    def shown(self) -> tuple[Scene, bool]:
        return self.scenes[self.assignment.shown]


def find_assignment(session: Session, person: Person, assignment_id: int) -> AssignmentDetails:
    """An assignment of this person. Responds with 404 if it does not exist or belongs to somebody else."""
    row = session.execute(
        select(Assignment, Statement.text, Batch.name)
        .join(Statement, Statement.id == Assignment.statement_id)
        .join(Batch, Batch.id == Assignment.batch_id)
        .where(Assignment.id == assignment_id, Assignment.person_id == person.id)
    ).one_or_none()
    if row is None:
        raise http_error(404, "you have no such assignment")
    found, statement, batch = row
    scenes = session.scalars(
        select(StatementScene)
        .where(StatementScene.statement_id == found.statement_id)
        .order_by(StatementScene.position)
    )
    return AssignmentDetails(found, statement, batch, [(Scene.from_json(one.scene), one.label) for one in scenes])


def lock_assignment(session: Session, person: Person, assignment_id: int) -> Assignment:
    """An assignment of this person, selected for update. Responds with 404 as `find_assignment` does."""
    query = select(Assignment).where(Assignment.id == assignment_id, Assignment.person_id == person.id)
    found = session.scalar(query.with_for_update())
    if found is None:
        raise http_error(404, "you have no such assignment")
    return found


def submission_history(session: Session, person: Person, assignment_id: int | None = None) -> list[SubmissionBody]:
    """The person's submissions, newest first, each with its latest review."""
    query = (
        select(Submission, Statement.text)
        .join(Assignment, Assignment.id == Submission.assignment_id)
        .join(Statement, Statement.id == Assignment.statement_id)
        .where(Assignment.person_id == person.id)
        .order_by(Submission.id.desc())
    )
    if assignment_id is not None:
        query = query.where(Assignment.id == assignment_id)
    rows = session.execute(query).all()
    reviews = latest_reviews(session, [submission.id for submission, _ in rows])
    return [
        SubmissionBody.of(
            submission,
            assignment=submission.assignment_id,
            statement=text,
            **review_fields(reviews.get(submission.id)),
        )
        for submission, text in rows
    ]


def latest_reviews(session: Session, submission_ids: Sequence[int]) -> dict[int, Review]:
    """The latest review of each submission that has one."""
    if not submission_ids:
        return {}
    found = session.scalars(select(Review).where(Review.submission_id.in_(submission_ids)).order_by(Review.id))
    return {review.submission_id: review for review in found}


def review_fields(review: Review | None) -> dict[str, Any]:
    """The fields of a `ReviewedSubmission` that come from its review."""
    return {"review": review and review.verdict, "note": review.note if review else ""}


def find_submission(session: Session, assignment_id: int, key: str) -> Submission | None:
    """The submission already stored under this idempotency key."""
    return session.scalar(select(Submission).where(Submission.assignment_id == assignment_id, Submission.key == key))


async def store_submission(
    services: AppServices, person: Person, assignment_id: int, new: NewSubmission | NewSkip, verdict: str
) -> VerdictBody:
    """Inserts a submission, unless one is already stored under its key; responds with the verdict on that one."""

    def insert(session: Session) -> Submission:
        assignment = lock_assignment(session, person, assignment_id)
        stored = find_submission(session, assignment_id, new.key)
        if stored is not None:
            return stored
        created = now()
        seconds = max(0.0, (created - assignment.opened).total_seconds()) if assignment.opened else 0.0
        submission = Submission(
            assignment_id=assignment_id, verdict=verdict, seconds=seconds, created=created, **new.model_dump()
        )
        session.add(submission)
        if verdict == ACCEPTED:
            assignment.state = STATE_DONE
        elif verdict == SKIPPED and assignment.state == STATE_OPEN:
            assignment.state = STATE_SKIPPED
        session.flush()
        return submission

    submission = await services.database.write(insert)
    return verdict_body(submission.verdict, submission.id)


def verdict_body(verdict: str, submission_id: int = 0) -> VerdictBody:
    return VerdictBody(id=submission_id, verdict=verdict, message=VERDICT_MESSAGES[verdict])


async def evaluate_program(
    services: AppServices, person: Person, program: str, scenes: Sequence[Scene], *, traced: bool = False
) -> ProgramEvaluation:
    """Responds with 422 for an invalid program or one that exceeds a limit, 429 if the person has too many running, 503
    if all workers stay busy."""
    try:
        return await services.evaluator.evaluate(person.id, program, scenes, traced=traced)
    except ProgramEvaluationError as fault:
        raise http_error(422, str(fault)) from None
    except QuotaExceeded:
        raise http_error(429, f"{MAX_REQUESTS} of your programs are running or waiting; wait for one to end") from None
    except EvaluatorBusy:
        raise http_error(503, "too many programs are running; your text is safe: try again in a moment") from None


async def run_program(services: AppServices, person: Person, program: str, scene: Scene, label: bool) -> RunBody:
    """Evaluates the program on the shown scene, with the value of each part."""
    evaluation = await evaluate_program(services, person, program, [scene], traced=True)
    (truth,) = evaluation.truths
    return RunBody.of(evaluation, truth=truth, label=label, agrees=truth is label)


async def check_program(services: AppServices, person: Person, program: str, scenes: LabelledScenes, shown: int) -> str:
    """ACCEPTED or FAILED; `shown` is the index of the shown scene.

    Responds with 409 if the program disagrees with the label of the shown scene, or cannot be evaluated on the empty
    scene, as every program of a corpus must be.
    """
    evaluation = await evaluate_program(services, person, program, [Scene.empty(), *(scene for scene, _ in scenes)])
    empty_truth, *scene_truths = evaluation.truths
    if scene_truths[shown] is not scenes[shown][1]:
        raise http_error(409, "the program does not agree with the shown scene; run it, and submit it once it does")
    if empty_truth is None:
        raise http_error(
            409,
            f"the program fails on a scene without items ({evaluation.fault}); it must have a value in every scene",
        )
    agrees = all(truth is label for truth, (_, label) in zip(scene_truths, scenes, strict=True))
    return ACCEPTED if agrees else FAILED
