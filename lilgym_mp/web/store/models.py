"""The tables."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from sqlalchemy import JSON, DateTime, Float, ForeignKey, Integer, MetaData, String, Text, UniqueConstraint
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column
from sqlalchemy.types import TypeDecorator


def now() -> datetime:
    return datetime.now(UTC)


class Moment(TypeDecorator[datetime]):
    """A time in UTC, on databases that keep no zone as well."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_result_value(self, value: datetime | None, dialect: Any) -> datetime | None:
        return value.replace(tzinfo=UTC) if value is not None and value.tzinfo is None else value


class Table(DeclarativeBase):
    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(table_name)s_%(column_0_N_name)s",
            "uq": "uq_%(table_name)s_%(column_0_N_name)s",
            "fk": "fk_%(table_name)s_%(column_0_name)s",
            "pk": "pk_%(table_name)s",
        }
    )


class Secret(Table):
    """A random text that the server needs again after a restart, such as the key that signs visitors' cookies."""

    __tablename__ = "secrets"
    name: Mapped[str] = mapped_column(String(40), primary_key=True)
    value: Mapped[str] = mapped_column(String(200))


class Person(Table):
    """Somebody who was given a token: an organiser or an annotator."""

    __tablename__ = "people"
    id: Mapped[int] = mapped_column(Integer, primary_key=True)
    name: Mapped[str] = mapped_column(String(80), unique=True)
    role: Mapped[str] = mapped_column(String(20))  # "organiser" or "annotator"
    token_hash: Mapped[str | None] = mapped_column(String(64), unique=True)  # None: the token was revoked
    created: Mapped[datetime] = mapped_column(Moment, default=now)


class Visitor(Table):
    """A browser, by the cookie it was given; kept from its first login or episode on."""

    __tablename__ = "visitors"
    id: Mapped[str] = mapped_column(String(43), primary_key=True)
    nickname: Mapped[str | None] = mapped_column(String(40))  # shown in the table of best play
    person_id: Mapped[int | None] = mapped_column(ForeignKey("people.id"))
    created: Mapped[datetime] = mapped_column(Moment, default=now)


class PlayedEpisode(Table):
    """An episode that a visitor plays: the task and the actions, from which its state is rebuilt."""

    __tablename__ = "played_episodes"
    id: Mapped[str] = mapped_column(String(22), primary_key=True)
    visitor_id: Mapped[str] = mapped_column(ForeignKey("visitors.id"), index=True)
    corpus: Mapped[str] = mapped_column(String(500))
    configuration: Mapped[str] = mapped_column(String(40))
    split: Mapped[str] = mapped_column(String(10))
    rules: Mapped[str] = mapped_column(String(20))
    strict: Mapped[bool] = mapped_column(default=False)  # whether an illegal action ends it
    task_id: Mapped[str] = mapped_column(String(200))
    actions: Mapped[list[int]] = mapped_column(JSON, default=list)  # as the appearance numbers them
    reward: Mapped[float] = mapped_column(Float, default=0.0)
    outcome: Mapped[str | None] = mapped_column(String(20), index=True)  # None: not over
    shown_solution: Mapped[bool] = mapped_column(default=False)  # before the end: then it does not count
    created: Mapped[datetime] = mapped_column(Moment, default=now)
    changed: Mapped[datetime] = mapped_column(Moment, default=now, onupdate=now)


class Statement(Table):
    """A statement to annotate; its scenes are `StatementScene`."""

    __tablename__ = "statements"
    id: Mapped[int] = mapped_column(Integer, primary_key=True)
    name: Mapped[str] = mapped_column(String(200), unique=True)  # the id that its source gives it
    text: Mapped[str] = mapped_column(Text)
    appearance: Mapped[str] = mapped_column(String(20))
    split: Mapped[str] = mapped_column(String(10))
    created: Mapped[datetime] = mapped_column(Moment, default=now)


class StatementScene(Table):
    """One of a statement's scenes, with the statement's truth value in it."""

    __tablename__ = "statement_scenes"
    id: Mapped[int] = mapped_column(Integer, primary_key=True)
    statement_id: Mapped[int] = mapped_column(ForeignKey("statements.id"), index=True)
    position: Mapped[int] = mapped_column(Integer)
    scene: Mapped[list[Any]] = mapped_column(JSON)
    label: Mapped[bool]


class Batch(Table):
    """Statements that were given to annotators together."""

    __tablename__ = "batches"
    id: Mapped[int] = mapped_column(Integer, primary_key=True)
    name: Mapped[str] = mapped_column(String(80), unique=True)
    created: Mapped[datetime] = mapped_column(Moment, default=now)


class Assignment(Table):
    """A statement that one person is to annotate, and the program as it is being written."""

    __tablename__ = "assignments"
    __table_args__ = (UniqueConstraint("statement_id", "person_id"),)
    id: Mapped[int] = mapped_column(Integer, primary_key=True)
    batch_id: Mapped[int] = mapped_column(ForeignKey("batches.id"), index=True)
    statement_id: Mapped[int] = mapped_column(ForeignKey("statements.id"), index=True)
    person_id: Mapped[int] = mapped_column(ForeignKey("people.id"), index=True)
    shown: Mapped[int] = mapped_column(Integer)  # position of the scene that is shown
    state: Mapped[str] = mapped_column(String(10), default="open")  # open, done, skipped
    draft: Mapped[str] = mapped_column(Text, default="")
    draft_version: Mapped[int] = mapped_column(Integer, default=0)
    opened: Mapped[datetime | None] = mapped_column(Moment)  # first looked at
    created: Mapped[datetime] = mapped_column(Moment, default=now)


class Submission(Table):
    """What was sent for an assignment, never changed: a program that agrees with the shown scene, or a skip."""

    __tablename__ = "submissions"
    __table_args__ = (UniqueConstraint("assignment_id", "key"),)
    id: Mapped[int] = mapped_column(Integer, primary_key=True)
    assignment_id: Mapped[int] = mapped_column(ForeignKey("assignments.id"), index=True)
    key: Mapped[str] = mapped_column(String(64))  # the sender's own, so that sending twice keeps one
    verdict: Mapped[str] = mapped_column(String(10))  # accepted, failed (on a hidden scene), skipped
    program: Mapped[str] = mapped_column(Text, default="")
    confidence: Mapped[int | None] = mapped_column(Integer)  # 1 .. 5
    reason: Mapped[str] = mapped_column(Text, default="")  # of a skip
    comment: Mapped[str] = mapped_column(Text, default="")
    question: Mapped[str] = mapped_column(Text, default="")  # to the organisers
    seconds: Mapped[float] = mapped_column(Float)  # since the assignment was first looked at
    created: Mapped[datetime] = mapped_column(Moment, default=now)


class Review(Table):
    """What an organiser says of a submission; the latest counts."""

    __tablename__ = "reviews"
    id: Mapped[int] = mapped_column(Integer, primary_key=True)
    submission_id: Mapped[int] = mapped_column(ForeignKey("submissions.id"), index=True)
    reviewer_id: Mapped[int] = mapped_column(ForeignKey("people.id"))
    verdict: Mapped[str] = mapped_column(String(10))  # kept, disputed, rejected
    note: Mapped[str] = mapped_column(Text, default="")
    created: Mapped[datetime] = mapped_column(Moment, default=now)


class TutorialAnswer(Table):
    """A tutorial task that somebody solved."""

    __tablename__ = "tutorial_answers"
    person_id: Mapped[int] = mapped_column(ForeignKey("people.id"), primary_key=True)
    task: Mapped[str] = mapped_column(String(40), primary_key=True)
    program: Mapped[str] = mapped_column(Text)
    created: Mapped[datetime] = mapped_column(Moment, default=now)
