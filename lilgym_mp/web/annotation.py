"""Annotators' side of annotation: assignments, drafts, runs on the shown scene, and checked submissions."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any, NamedTuple

from pydantic import BaseModel
from sqlalchemy import select, update
from sqlalchemy.orm import Session

from lilgym_mp.scene import Scene
from lilgym_mp.web.errors import http_error
from lilgym_mp.web.played_episodes import ProgramPart
from lilgym_mp.web.program_evaluator import (
    MAX_REQUESTS,
    EvaluatorBusy,
    ProgramEvaluation,
    ProgramEvaluationError,
    ProgramEvaluator,
    QuotaExceeded,
)
from lilgym_mp.web.scene_body import SceneBody, scene_body
from lilgym_mp.web.store.models import Assignment, Batch, Person, Review, Statement, StatementScene, Submission, now

ASSIGNMENT_NOT_FOUND = "you have no such assignment"
STATE_OPEN, STATE_DONE, STATE_SKIPPED = "open", "done", "skipped"
ACCEPTED, FAILED, SKIPPED = "accepted", "failed", "skipped"


class AssignmentSummary(BaseModel):
    """An entry of the annotator's assignment list."""

    id: int
    batch: str
    statement: str
    state: str


class SubmissionBody(BaseModel):
    """A submission as its author sees it."""

    id: int
    assignment: int
    statement: str
    verdict: str
    program: str
    confidence: int | None
    reason: str
    comment: str
    question: str
    created: datetime
    review: str | None
    note: str


class AssignmentBody(BaseModel):
    """An assignment as the annotator sees it: of the hidden scenes, only their number."""

    id: int
    batch: str
    statement: str
    state: str
    label: bool
    scene: SceneBody
    hidden_scenes: int
    draft: str
    draft_version: int
    submissions: list[SubmissionBody]


class RunBody(BaseModel):
    """A program's truth value on the shown scene; null if evaluation failed, with the error in `fault`."""

    truth: bool | None
    label: bool
    agrees: bool
    fault: str | None
    parts: list[ProgramPart]


class VerdictBody(BaseModel):
    """The verdict on a submission: accepted, failed on some hidden scene, or skipped."""

    id: int
    verdict: str
    message: str


class AssignmentDetails(NamedTuple):
    """An assignment with its statement, batch and scenes."""

    assignment: Assignment
    statement: Statement
    batch: Batch
    scenes: Sequence[StatementScene]

    @property
    def shown(self) -> StatementScene:
        return self.scenes[self.assignment.shown]


VERDICT_MESSAGES = {
    ACCEPTED: "Accepted: your program agrees with every scene of the statement.",
    FAILED: "Your program agrees with the shown scene but not with a hidden one. It was saved; reread the statement.",
    SKIPPED: "Skipped. The statement may be assigned to somebody else.",
}


def list_assignments(session: Session, person: Person) -> list[AssignmentSummary]:
    rows = session.execute(
        select(Assignment.id, Batch.name, Statement.text, Assignment.state)
        .join(Batch, Batch.id == Assignment.batch_id)
        .join(Statement, Statement.id == Assignment.statement_id)
        .where(Assignment.person_id == person.id)
        .order_by(Assignment.id)
    )
    return [
        AssignmentSummary(id=assignment_id, batch=batch, statement=text, state=state)
        for assignment_id, batch, text, state in rows
    ]


def find_assignment(session: Session, person: Person, assignment_id: int) -> AssignmentDetails:
    """An assignment of this person. Responds with 404 if it does not exist or belongs to somebody else."""
    row = session.execute(
        select(Assignment, Statement, Batch)
        .join(Statement, Statement.id == Assignment.statement_id)
        .join(Batch, Batch.id == Assignment.batch_id)
        .where(Assignment.id == assignment_id, Assignment.person_id == person.id)
    ).one_or_none()
    if row is None:
        raise http_error(404, ASSIGNMENT_NOT_FOUND)
    assignment, statement, batch = row
    scenes = session.scalars(
        select(StatementScene).where(StatementScene.statement_id == statement.id).order_by(StatementScene.position)
    )
    return AssignmentDetails(assignment, statement, batch, list(scenes))


def lock_assignment(session: Session, person: Person, assignment_id: int) -> Assignment:
    """An assignment of this person, selected for update. Responds with 404 as `find_assignment` does."""
    query = select(Assignment).where(Assignment.id == assignment_id, Assignment.person_id == person.id)
    assignment = session.scalar(query.with_for_update())
    if assignment is None:
        raise http_error(404, ASSIGNMENT_NOT_FOUND)
    return assignment


def record_first_opening(session: Session, assignment_id: int) -> None:
    """Stores the time at which the assignment was first opened."""
    session.execute(
        update(Assignment).where(Assignment.id == assignment_id, Assignment.opened.is_(None)).values(opened=now())
    )


def assignment_body(session: Session, person: Person, details: AssignmentDetails) -> AssignmentBody:
    assignment = details.assignment
    return AssignmentBody(
        id=assignment.id,
        batch=details.batch.name,
        statement=details.statement.text,
        state=assignment.state,
        label=details.shown.label,
        scene=scene_body(Scene.from_json(details.shown.scene)),
        hidden_scenes=len(details.scenes) - 1,
        draft=assignment.draft,
        draft_version=assignment.draft_version,
        submissions=submission_history(session, person, assignment.id),
    )


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
        SubmissionBody(
            assignment=submission.assignment_id,
            statement=text,
            review=reviews[submission.id].verdict if submission.id in reviews else None,
            note=reviews[submission.id].note if submission.id in reviews else "",
            **{name: getattr(submission, name) for name in _SUBMISSION_COLUMNS},
        )
        for submission, text in rows
    ]


_SUBMISSION_COLUMNS = ("id", "verdict", "program", "confidence", "reason", "comment", "question", "created")


def latest_reviews(session: Session, submission_ids: Sequence[int]) -> dict[int, Review]:
    """The latest review of each submission that has one."""
    if not submission_ids:
        return {}
    found = session.scalars(select(Review).where(Review.submission_id.in_(submission_ids)).order_by(Review.id))
    return {review.submission_id: review for review in found}


def save_draft(session: Session, person: Person, assignment_id: int, program: str, version: int) -> int:
    """Saves the editor's text; returns its new version. Responds with 409 if another tab has saved since `version`."""
    assignment = lock_assignment(session, person, assignment_id)
    if assignment.draft == program:
        return assignment.draft_version
    if assignment.draft_version != version:
        raise http_error(
            409, "the program was changed in another tab or window; reload to see it, your text stays here"
        )
    assignment.draft = program
    assignment.draft_version += 1
    return assignment.draft_version


async def evaluate_program(
    evaluator: ProgramEvaluator, person: Person, program: str, scenes: Sequence[Scene], *, traced: bool = False
) -> ProgramEvaluation:
    """Responds with 422 for an invalid program or one that exceeds a limit, 429 if the person has too many running, 503
    if all workers stay busy."""
    try:
        return await evaluator.evaluate(person.id, program, scenes, traced=traced)
    except ProgramEvaluationError as fault:
        raise http_error(422, str(fault)) from None
    except QuotaExceeded:
        raise http_error(429, f"{MAX_REQUESTS} of your programs are running or waiting; wait for one to end") from None
    except EvaluatorBusy:
        raise http_error(503, "too many programs are running; your text is safe: try again in a moment") from None


async def run_program(
    evaluator: ProgramEvaluator, person: Person, program: str, scene: Scene, *, label: bool
) -> RunBody:
    """Evaluates the program on the shown scene, with the value of each part."""
    evaluation = await evaluate_program(evaluator, person, program, [scene], traced=True)
    return RunBody(
        truth=evaluation.truths[0],
        label=label,
        agrees=evaluation.truths[0] is label,
        fault=evaluation.fault,
        parts=[ProgramPart(**part._asdict()) for part in evaluation.parts],
    )


async def check_program(
    evaluator: ProgramEvaluator, person: Person, program: str, scenes: Sequence[tuple[Scene, bool]], shown: int
) -> str:
    """ACCEPTED or FAILED; `shown` is the index of the shown scene.

    Responds with 409 if the program disagrees with the label of the shown scene, or cannot be evaluated on the empty
    scene, as every program of a corpus must be.
    """
    evaluation = await evaluate_program(evaluator, person, program, [Scene.empty(), *(scene for scene, _ in scenes)])
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


def find_submission(session: Session, assignment_id: int, key: str) -> Submission | None:
    """The submission already stored under this idempotency key."""
    return session.scalar(select(Submission).where(Submission.assignment_id == assignment_id, Submission.key == key))


def store_submission(
    session: Session, person: Person, assignment_id: int, key: str, verdict: str, **columns: Any
) -> Submission:
    """Inserts a submission, or returns the one already stored under the key."""
    assignment = lock_assignment(session, person, assignment_id)
    existing = find_submission(session, assignment_id, key)
    if existing is not None:
        return existing
    created = now()
    seconds = (created - assignment.opened).total_seconds() if assignment.opened else 0.0
    submission = Submission(
        assignment_id=assignment_id,
        key=key,
        verdict=verdict,
        seconds=max(0.0, seconds),
        created=created,
        **{"program": "", "reason": "", "comment": "", "question": "", "confidence": None, **columns},
    )
    session.add(submission)
    if verdict == ACCEPTED:
        assignment.state = STATE_DONE
    elif verdict == SKIPPED and assignment.state == STATE_OPEN:
        assignment.state = STATE_SKIPPED
    session.flush()
    return submission


def verdict_body(submission: Submission) -> VerdictBody:
    return VerdictBody(id=submission.id, verdict=submission.verdict, message=VERDICT_MESSAGES[submission.verdict])
