"""The organisers' work: people, batches, review with agreement, statistics, export."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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
from lilgym_mp.web.errors import http_error
from lilgym_mp.web.program_evaluator import EvaluatorBusy, ProgramEvaluationError, ProgramEvaluator
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
MAX_COMPARED_SCENES = 300  # scenes on which two programs are compared


class PersonSummary(BaseModel):
    """A person in the organisers' list."""

    id: int
    name: str
    role: str
    has_token: bool
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
    """A submission as organisers see it."""

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
    """A statement with all that was submitted for it. `agreement`: the share of scenes of which the programs of two
    annotators have the same truth, the mean over pairs; null where fewer than two were accepted."""

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
    """How far the collection is. `collected`: statements with an accepted program; `kept`: those that are exported."""

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


def people(session: Session) -> list[PersonSummary]:
    counts = {
        (person, state): count
        for person, state, count in session.execute(
            select(Assignment.person_id, Assignment.state, func.count()).group_by(
                Assignment.person_id, Assignment.state
            )
        )
    }
    answered = _pairs(
        session.execute(select(TutorialAnswer.person_id, func.count()).group_by(TutorialAnswer.person_id))
    )
    return [
        PersonSummary(
            id=person.id,
            name=person.name,
            role=person.role,
            has_token=person.token_hash is not None,
            open=counts.get((person.id, STATE_OPEN), 0),
            done=counts.get((person.id, STATE_DONE), 0),
            skipped=counts.get((person.id, STATE_SKIPPED), 0),
            tutorial=answered.get(person.id, 0),
        )
        for person in session.scalars(select(Person).order_by(Person.name))
    ]


def batches(session: Session) -> list[BatchSummary]:
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
        BatchSummary(id=found, name=name, open=opened, done=done, skipped=skipped)
        for found, name, opened, done, skipped in map(tuple[Any, ...], rows)
    ]


def make_batch(
    session: Session, name: str, person_ids: Sequence[int], statements: int, annotators_each: int
) -> tuple[Batch, int]:
    """Gives statements that nobody has yet, the first imported first, to the people in turn; gives the batch and how
    many assignments it has. Answers 409 or 422 where that cannot be."""
    chosen = select(Assignment.statement_id)
    free = session.scalars(
        select(Statement.id).where(Statement.id.not_in(chosen)).order_by(Statement.id).limit(statements)
    ).all()
    if not free:
        raise http_error(409, "no statement is left that nobody was given; import more")
    return _assign(session, name, person_ids, [(statement, annotators_each) for statement in free])


def redistribute(session: Session, name: str, person_ids: Sequence[int]) -> tuple[Batch, int]:
    """Gives every statement that was skipped by all who had it, or is disputed, to one more of the people.

    Answers 409 where there is none that any of them could be given.
    """
    work = [(statement, 1) for statement in sorted({*_skipped(session), *_disputed(session)})]
    if not work:
        raise http_error(409, "no statement is skipped or disputed")
    return _assign(session, name, person_ids, work)


def _assign(
    session: Session, name: str, person_ids: Sequence[int], work: Sequence[tuple[int, int]]
) -> tuple[Batch, int]:
    known = set(session.scalars(select(Person.id).where(Person.id.in_(person_ids), Person.token_hash.is_not(None))))
    unknown = [person for person in person_ids if person not in known]
    if unknown or not person_ids:
        raise http_error(422, f"no such people with a token: {', '.join(map(str, unknown)) or 'none was named'}")
    if session.scalar(select(Batch.id).where(Batch.name == name)) is not None:
        raise http_error(409, f"there is a batch {name!r} already")
    taken = {tuple(row) for row in session.execute(select(Assignment.statement_id, Assignment.person_id))}
    scenes = _pairs(
        session.execute(select(StatementScene.statement_id, func.count()).group_by(StatementScene.statement_id))
    )
    batch = Batch(name=name)
    session.add(batch)
    session.flush()
    people_in_turn = list(dict.fromkeys(person_ids))
    made, turn = 0, 0
    for statement, wanted in work:
        for _ in range(len(people_in_turn)):
            if not wanted:
                break
            person = people_in_turn[turn % len(people_in_turn)]
            turn += 1
            if (statement, person) in taken:
                continue
            shown = (statement + made) % scenes[statement]
            session.add(Assignment(batch_id=batch.id, statement_id=statement, person_id=person, shown=shown))
            made += 1
            wanted -= 1
    if not made:
        raise http_error(409, "these people had all of these statements already; name others")
    session.flush()
    return batch, made


def _skipped(session: Session) -> set[int]:
    """Statements that everybody who was given them skipped."""
    rows = session.execute(
        select(Assignment.statement_id)
        .group_by(Assignment.statement_id)
        .having(func.count() == func.count().filter(Assignment.state == STATE_SKIPPED))
    )
    return {statement for (statement,) in rows}


class _Sent(NamedTuple):
    """A submission with whose it is and its latest review."""

    submission: Submission
    statement_id: int
    annotator: str
    review: Review | None

    @property
    def stands(self) -> bool:
        """Whether it is accepted and no review is against it."""
        return self.submission.verdict == ACCEPTED and (self.review is None or self.review.verdict == KEPT)


def _sent(session: Session, statement_ids: Sequence[int] | None = None) -> list[_Sent]:
    asked = (
        select(Submission, Assignment.statement_id, Person.name)
        .join(Assignment, Assignment.id == Submission.assignment_id)
        .join(Person, Person.id == Assignment.person_id)
        .order_by(Submission.id)
    )
    if statement_ids is not None:
        asked = asked.where(Assignment.statement_id.in_(statement_ids))
    rows = session.execute(asked).all()
    reviews = latest_reviews(session, [submission.id for submission, _, _ in rows])
    return [_Sent(sent, statement, name, reviews.get(sent.id)) for sent, statement, name in rows]


def _disputed(session: Session) -> set[int]:
    """Statements with a submission whose latest review disputes it, and none that a review keeps."""
    sent = _sent(session)
    disputed = {each.statement_id for each in sent if each.review and each.review.verdict == DISPUTED}
    return disputed - {each.statement_id for each in sent if each.review and each.review.verdict == KEPT}


def _standing(sent: Iterable[_Sent]) -> dict[int, dict[str, Submission]]:
    """For each statement each annotator's latest submission that stands."""
    found: dict[int, dict[str, Submission]] = {}
    for each in sent:
        if each.stands:
            found.setdefault(each.statement_id, {})[each.annotator] = each.submission
    return found


def review_page(session: Session, evaluator: ProgramEvaluator, first: int, most: int) -> list[StatementReview]:
    """Statements with submissions, from the given one on, with the agreement between annotators."""
    has_any = select(Assignment.statement_id).join(Submission, Submission.assignment_id == Assignment.id)
    statements = session.scalars(
        select(Statement).where(Statement.id.in_(has_any), Statement.id >= first).order_by(Statement.id).limit(most)
    ).all()
    sent = _sent(session, [statement.id for statement in statements])
    standing = _standing(sent)
    panels: dict[str, list[Scene]] = {}
    found: list[StatementReview] = []
    for statement in statements:
        programs = [submission.program for submission in standing.get(statement.id, {}).values()]
        agreement, compared = None, 0
        if len(programs) > 1:
            if statement.appearance not in panels:
                panels[statement.appearance] = _panel(session, statement.appearance)
            agreement, compared = _agreement(evaluator, programs, panels[statement.appearance])
        found.append(
            StatementReview(
                id=statement.id,
                name=statement.name,
                statement=statement.text,
                appearance=statement.appearance,
                agreement=agreement,
                compared_scenes=compared,
                submissions=[_reviewed(each) for each in sent if each.statement_id == statement.id],
            )
        )
    return found


def _reviewed(each: _Sent) -> ReviewedSubmission:
    submission = each.submission
    return ReviewedSubmission(
        id=submission.id,
        annotator=each.annotator,
        verdict=submission.verdict,
        program=submission.program,
        confidence=submission.confidence,
        reason=submission.reason,
        comment=submission.comment,
        question=submission.question,
        seconds=round(submission.seconds, 1),
        created=submission.created,
        review=each.review.verdict if each.review else None,
        note=each.review.note if each.review else "",
    )


def _panel(session: Session, appearance: str) -> list[Scene]:
    """Scenes of the appearance, those of all statements alike, to compare programs on; the empty one among them."""
    rows = session.scalars(
        select(StatementScene.scene)
        .join(Statement, Statement.id == StatementScene.statement_id)
        .where(Statement.appearance == appearance)
        .order_by(StatementScene.position, StatementScene.id)
        .limit(MAX_COMPARED_SCENES - 1)
    )
    return [Scene.empty(), *map(Scene.from_json, rows)]


def _agreement(
    evaluator: ProgramEvaluator, programs: Sequence[str], panel: Sequence[Scene]
) -> tuple[float | None, int]:
    try:
        truths = [evaluator.evaluate(program, panel).truths for program in programs]
    except (ProgramEvaluationError, EvaluatorBusy):
        return None, 0
    shares = [mean(x is y for x, y in zip(a, b, strict=True)) for a, b in combinations(truths, 2)]
    return round(mean(shares), 4), len(panel)


def add_review(session: Session, reviewer: Person, submission_id: int, verdict: str, note: str) -> None:
    """Answers 404 for no submission."""
    if session.get(Submission, submission_id) is None:
        raise http_error(404, f"there is no submission {submission_id}")
    session.add(Review(submission_id=submission_id, reviewer_id=reviewer.id, verdict=verdict, note=note))


def kept_programs(session: Session) -> dict[int, str]:
    """The program of each statement that is kept: of those that stand, one a review keeps before others, then the most
    confident, then the shorter, then the later. Disputed statements have none."""
    sent = _sent(session)
    disputed = _disputed(session)
    reviewed = {each.submission.id for each in sent if each.review and each.review.verdict == KEPT}

    def worth(submission: Submission) -> tuple[bool, int, int, int]:
        confidence = submission.confidence or 0
        return submission.id in reviewed, confidence, -len(submission.program), submission.id

    return {
        statement: max(by_annotator.values(), key=worth).program
        for statement, by_annotator in _standing(sent).items()
        if statement not in disputed
    }


def export(session: Session) -> bytes:
    """The kept statements as a corpus file. Answers 409 where there are none."""
    programs = kept_programs(session)
    if not programs:
        raise http_error(409, "no statement has a program that is kept")
    with tempfile.TemporaryDirectory(prefix="lilgym-mp-") as directory:
        path = Path(directory) / "corpus.jsonl"
        write_corpus(path, "annotated statements", "as their sources", _entries(session, programs))
        return path.read_bytes()


def _entries(session: Session, programs: Mapping[int, str]) -> Iterator[dict[str, object]]:
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
    sent = _sent(session)
    accepted = [each for each in sent if each.submission.verdict == ACCEPTED]
    seconds = [each.submission.seconds for each in accepted]
    return StatisticsBody(
        statements=_count(session, Statement),
        scenes=_count(session, StatementScene),
        assigned=session.scalar(select(func.count(func.distinct(Assignment.statement_id)))) or 0,
        collected=len({each.statement_id for each in accepted}),
        kept=len(kept_programs(session)),
        skipped=len(_skipped(session)),
        disputed=len(_disputed(session)),
        mean_seconds=_rounded(mean, seconds),
        median_seconds=_rounded(median, seconds),
        annotators=[
            _of_annotator(name, [each.submission for each in sent if each.annotator == name])
            for name in sorted({each.annotator for each in sent})
        ],
    )


def _of_annotator(name: str, sent: Sequence[Submission]) -> AnnotatorStatistics:
    counts = Counter(each.verdict for each in sent)
    return AnnotatorStatistics(
        name=name,
        accepted=counts[ACCEPTED],
        failed=counts[FAILED],
        skipped=counts[SKIPPED],
        median_seconds=_rounded(median, [each.seconds for each in sent if each.verdict == ACCEPTED]),
    )


def _rounded(summary: Callable[[Sequence[float]], float], values: Sequence[float]) -> float | None:
    return round(summary(values), 1) if values else None


def _pairs(rows: Iterable[Sequence[Any]]) -> dict[int, int]:
    """Rows of two numbers as a table."""
    return {row[0]: row[1] for row in rows}


def _count(session: Session, table: type) -> int:
    return session.scalar(select(func.count()).select_from(table)) or 0
