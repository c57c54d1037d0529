"""An annotator's work: assignments, drafts, runs on the shown scene, submissions checked on the hidden ones."""

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
from lilgym_mp.web.program_evaluator import EvaluatorBusy, ProgramEvaluation, ProgramEvaluationError, ProgramEvaluator
from lilgym_mp.web.scene_body import SceneBody, scene_body
from lilgym_mp.web.store.models import Assignment, Batch, Person, Review, Statement, StatementScene, Submission, now

ASSIGNMENT_NOT_FOUND = "there is no such assignment of yours"
STATE_OPEN, STATE_DONE, STATE_SKIPPED = "open", "done", "skipped"
ACCEPTED, FAILED, SKIPPED = "accepted", "failed", "skipped"


class AssignmentSummary(BaseModel):
    """An assignment in the annotator's list."""

    id: int
    batch: str
    statement: str
    state: str


class SubmissionBody(BaseModel):
    """A submission as its sender sees it."""

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
    """All that an annotator gets to see of an assignment. Of the hidden scenes only how many there are."""

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
    """What a program says of the shown scene. `truth` is null where it has no value; `fault` says why."""

    truth: bool | None
    label: bool
    agrees: bool
    fault: str | None
    parts: list[ProgramPart]


class VerdictBody(BaseModel):
    """What came of a submission: accepted, or failed on a hidden scene, which is not told."""

    id: int
    verdict: str
    message: str


class Found(NamedTuple):
    """An assignment with what belongs to it."""

    assignment: Assignment
    statement: Statement
    batch: Batch
    scenes: Sequence[StatementScene]

    @property
    def shown(self) -> StatementScene:
        return self.scenes[self.assignment.shown]


VERDICT_MESSAGES = {
    ACCEPTED: "Accepted: it agrees with every scene of the statement.",
    FAILED: "It agrees with the shown scene but fails on a hidden one. It is kept; read the statement once more.",
    SKIPPED: "Skipped. Somebody else may get the statement.",
}


def assignments(session: Session, person: Person) -> list[AssignmentSummary]:
    rows = session.execute(
        select(Assignment.id, Batch.name, Statement.text, Assignment.state)
        .join(Batch, Batch.id == Assignment.batch_id)
        .join(Statement, Statement.id == Assignment.statement_id)
        .where(Assignment.person_id == person.id)
        .order_by(Assignment.id)
    )
    return [AssignmentSummary(id=found, batch=batch, statement=text, state=state) for found, batch, text, state in rows]


def find(session: Session, person: Person, assignment_id: int) -> Found:
    """An assignment of this person. Answers 404 where there is none, be it another's or nobody's."""
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
    return Found(assignment, statement, batch, list(scenes))


def locked(session: Session, person: Person, assignment_id: int) -> Assignment:
    """An assignment of this person, to be changed. Answers 404 where there is none."""
    asked = select(Assignment).where(Assignment.id == assignment_id, Assignment.person_id == person.id)
    assignment = session.scalar(asked.with_for_update())
    if assignment is None:
        raise http_error(404, ASSIGNMENT_NOT_FOUND)
    return assignment


def record_first_opening(session: Session, assignment_id: int) -> None:
    """Notes that the assignment was looked at for the first time."""
    session.execute(
        update(Assignment).where(Assignment.id == assignment_id, Assignment.opened.is_(None)).values(opened=now())
    )


def body(session: Session, person: Person, found: Found) -> AssignmentBody:
    assignment = found.assignment
    return AssignmentBody(
        id=assignment.id,
        batch=found.batch.name,
        statement=found.statement.text,
        state=assignment.state,
        label=found.shown.label,
        scene=scene_body(Scene.from_json(found.shown.scene)),
        hidden_scenes=len(found.scenes) - 1,
        draft=assignment.draft,
        draft_version=assignment.draft_version,
        submissions=history(session, person, assignment.id),
    )


def history(session: Session, person: Person, assignment_id: int | None = None) -> list[SubmissionBody]:
    """What the person submitted, the latest first, with the latest review of each."""
    asked = (
        select(Submission, Statement.text)
        .join(Assignment, Assignment.id == Submission.assignment_id)
        .join(Statement, Statement.id == Assignment.statement_id)
        .where(Assignment.person_id == person.id)
        .order_by(Submission.id.desc())
    )
    if assignment_id is not None:
        asked = asked.where(Assignment.id == assignment_id)
    rows = session.execute(asked).all()
    reviews = latest_reviews(session, [submission.id for submission, _ in rows])
    return [
        SubmissionBody(
            assignment=submission.assignment_id,
            statement=text,
            review=reviews[submission.id].verdict if submission.id in reviews else None,
            note=reviews[submission.id].note if submission.id in reviews else "",
            **{name: getattr(submission, name) for name in _SUBMISSION_FIELDS},
        )
        for submission, text in rows
    ]


_SUBMISSION_FIELDS = ("id", "verdict", "program", "confidence", "reason", "comment", "question", "created")


def latest_reviews(session: Session, submission_ids: Sequence[int]) -> dict[int, Review]:
    """The latest review of each submission that has one."""
    if not submission_ids:
        return {}
    found = session.scalars(select(Review).where(Review.submission_id.in_(submission_ids)).order_by(Review.id))
    return {review.submission_id: review for review in found}


def save_draft(session: Session, person: Person, assignment_id: int, program: str, version: int) -> int:
    """Keeps the text of the editor; gives its new version. Answers 409 where another tab saved since `version`."""
    assignment = locked(session, person, assignment_id)
    if assignment.draft == program:
        return assignment.draft_version
    if assignment.draft_version != version:
        raise http_error(
            409, "the program was changed in another tab or window; reload to see it, your text stays here"
        )
    assignment.draft = program
    assignment.draft_version += 1
    return assignment.draft_version


def evaluated(
    evaluator: ProgramEvaluator, program: str, scenes: Sequence[Scene], *, traced: bool = False
) -> ProgramEvaluation:
    """What a program says of scenes. Answers 422 for no program and one that takes too long, 503 when all is busy."""
    try:
        return evaluator.evaluate(program, scenes, traced=traced)
    except ProgramEvaluationError as fault:
        raise http_error(422, str(fault)) from None
    except EvaluatorBusy:
        raise http_error(503, "too many programs are being run; your text is kept: try again in a moment") from None


def run(evaluator: ProgramEvaluator, program: str, scene: Scene, *, label: bool) -> RunBody:
    """What the program says of the shown scene, part by part."""
    found = evaluated(evaluator, program, [scene], traced=True)
    return RunBody(
        truth=found.truths[0],
        label=label,
        agrees=found.truths[0] is label,
        fault=found.fault,
        parts=[ProgramPart(**part._asdict()) for part in found.parts],
    )


def judged(evaluator: ProgramEvaluator, program: str, scenes: Sequence[tuple[Scene, bool]], shown: int) -> str:
    """ACCEPTED or FAILED. Answers 409 where the program disagrees with the shown scene, or has no value of the empty
    one, which no corpus may have."""
    truths = evaluated(evaluator, program, [Scene.empty(), *(scene for scene, _ in scenes)]).truths
    empty, of_scenes = truths[0], truths[1:]
    if of_scenes[shown] is not scenes[shown][1]:
        raise http_error(409, "the program does not agree with the shown scene; run it, and submit it once it does")
    if empty is None:
        fault = evaluated(evaluator, program, [Scene.empty()]).fault
        raise http_error(
            409, f"the program has no value of a scene without items ({fault}); it must have one of any scene"
        )
    agrees = all(truth is label for truth, (_, label) in zip(of_scenes, scenes, strict=True))
    return ACCEPTED if agrees else FAILED


def labelled_scenes(found: Found) -> list[tuple[Scene, bool]]:
    return [(Scene.from_json(kept.scene), kept.label) for kept in found.scenes]


def earlier(session: Session, assignment_id: int, key: str) -> Submission | None:
    """The submission that was sent with this key already."""
    return session.scalar(select(Submission).where(Submission.assignment_id == assignment_id, Submission.key == key))


def submit(session: Session, person: Person, assignment_id: int, key: str, verdict: str, **said: Any) -> Submission:
    """Keeps a submission, once for each key."""
    assignment = locked(session, person, assignment_id)
    kept = earlier(session, assignment_id, key)
    if kept is not None:
        return kept
    moment = now()
    seconds = (moment - assignment.opened).total_seconds() if assignment.opened else 0.0
    kept = Submission(
        assignment_id=assignment_id,
        key=key,
        verdict=verdict,
        seconds=max(0.0, seconds),
        created=moment,
        **{"program": "", "reason": "", "comment": "", "question": "", "confidence": None, **said},
    )
    session.add(kept)
    if verdict == ACCEPTED:
        assignment.state = STATE_DONE
    elif verdict == SKIPPED and assignment.state == STATE_OPEN:
        assignment.state = STATE_SKIPPED
    session.flush()
    return kept


def verdict_body(kept: Submission) -> VerdictBody:
    return VerdictBody(id=kept.id, verdict=kept.verdict, message=VERDICT_MESSAGES[kept.verdict])
