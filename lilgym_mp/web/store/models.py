"""ORM models, one per table."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from sqlalchemy import JSON, DateTime, Float, ForeignKey, Integer, MetaData, String, Text, UniqueConstraint
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column
from sqlalchemy.types import TypeDecorator


def now() -> datetime:
    return datetime.now(UTC)


class UTCDateTime(TypeDecorator[datetime]):
    """A timezone-aware UTC datetime, also on databases that store no time zone."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_result_value(self, value: datetime | None, dialect: Any) -> datetime | None:
        return value.replace(tzinfo=UTC) if value is not None and value.tzinfo is None else value


class Base(DeclarativeBase):
    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(table_name)s_%(column_0_N_name)s",
            "uq": "uq_%(table_name)s_%(column_0_N_name)s",
            "fk": "fk_%(table_name)s_%(column_0_name)s",
            "pk": "pk_%(table_name)s",
        }
    )


class Created:
    """Columns of most tables."""

    created: Mapped[datetime] = mapped_column(UTCDateTime, default=now)


class Numbered(Created):
    id: Mapped[int] = mapped_column(Integer, primary_key=True)


class Secret(Base):
    """A random string that must survive a restart, such as the key that signs cookies."""

    __tablename__ = "secrets"
    name: Mapped[str] = mapped_column(String(40), primary_key=True)
    value: Mapped[str] = mapped_column(String(200))


class Person(Numbered, Base):
    """An organiser or annotator, who logs in with a token."""

    __tablename__ = "people"
    name: Mapped[str] = mapped_column(String(80), unique=True)
    role: Mapped[str] = mapped_column(String(20))  # "organiser" or "annotator"
    token_hash: Mapped[str | None] = mapped_column(String(64), unique=True)  # None: revoked


class Visitor(Created, Base):
    """A browser, identified by its cookie; inserted on its first login or episode."""

    __tablename__ = "visitors"
    id: Mapped[str] = mapped_column(String(43), primary_key=True)
    nickname: Mapped[str | None] = mapped_column(String(40))  # shown on the leaderboard
    token_hash: Mapped[str | None] = mapped_column(String(64))  # of the token it logged in with; None: not logged in


class PlayedEpisode(Created, Base):
    """An episode played by a visitor; its MDP state is rebuilt by replaying the actions."""

    __tablename__ = "played_episodes"
    id: Mapped[str] = mapped_column(String(22), primary_key=True)
    visitor_id: Mapped[str] = mapped_column(ForeignKey("visitors.id"), index=True)
    corpus: Mapped[str] = mapped_column(String(500))
    configuration: Mapped[str] = mapped_column(String(40))
    split: Mapped[str] = mapped_column(String(10))
    rules: Mapped[str] = mapped_column(String(20))
    strict: Mapped[bool] = mapped_column(default=False)  # an illegal action ends the episode
    task_id: Mapped[str] = mapped_column(String(200))
    actions: Mapped[list[int]] = mapped_column(JSON, default=list)  # action indices of the appearance
    reward: Mapped[float] = mapped_column(Float, default=0.0)
    outcome: Mapped[str | None] = mapped_column(String(20), index=True)  # None: in progress
    shown_solution: Mapped[bool] = mapped_column(default=False)  # before the end: excluded from statistics
    changed: Mapped[datetime] = mapped_column(UTCDateTime, default=now, onupdate=now)


class Statement(Numbered, Base):
    """A statement to annotate."""

    __tablename__ = "statements"
    name: Mapped[str] = mapped_column(String(200), unique=True)  # its id in the imported file
    text: Mapped[str] = mapped_column(Text)
    appearance: Mapped[str] = mapped_column(String(20))
    split: Mapped[str] = mapped_column(String(10))


class StatementScene(Base):
    """A scene of a statement, labelled with the statement's truth value."""

    __tablename__ = "statement_scenes"
    id: Mapped[int] = mapped_column(Integer, primary_key=True)
    statement_id: Mapped[int] = mapped_column(ForeignKey("statements.id"), index=True)
    position: Mapped[int] = mapped_column(Integer)
    scene: Mapped[list[Any]] = mapped_column(JSON)
    label: Mapped[bool]


class Batch(Numbered, Base):
    """A group of assignments created together."""

    __tablename__ = "batches"
    name: Mapped[str] = mapped_column(String(80), unique=True)


class Assignment(Numbered, Base):
    """An annotation task: a statement assigned to a person, with the draft of its program."""

    __tablename__ = "assignments"
    __table_args__ = (UniqueConstraint("statement_id", "person_id"),)
    batch_id: Mapped[int] = mapped_column(ForeignKey("batches.id"), index=True)
    statement_id: Mapped[int] = mapped_column(ForeignKey("statements.id"), index=True)
    person_id: Mapped[int] = mapped_column(ForeignKey("people.id"), index=True)
    shown: Mapped[int] = mapped_column(Integer)  # position of the shown scene
    state: Mapped[str] = mapped_column(String(10), default="open")  # open, done, skipped
    draft: Mapped[str] = mapped_column(Text, default="")
    draft_version: Mapped[int] = mapped_column(Integer, default=0)
    opened: Mapped[datetime | None] = mapped_column(UTCDateTime)  # when first opened


class Submission(Numbered, Base):
    """An immutable submission for an assignment: a program that agrees with the shown scene, or a skip."""

    __tablename__ = "submissions"
    __table_args__ = (UniqueConstraint("assignment_id", "key"),)
    assignment_id: Mapped[int] = mapped_column(ForeignKey("assignments.id"), index=True)
    key: Mapped[str] = mapped_column(String(64))  # idempotency key chosen by the client
    verdict: Mapped[str] = mapped_column(String(10))  # accepted, failed (on a hidden scene), skipped
    program: Mapped[str] = mapped_column(Text, default="")
    confidence: Mapped[int | None] = mapped_column(Integer)  # 1 .. 5
    reason: Mapped[str] = mapped_column(Text, default="")  # reason for a skip
    comment: Mapped[str] = mapped_column(Text, default="")
    question: Mapped[str] = mapped_column(Text, default="")  # question to the organisers
    seconds: Mapped[float] = mapped_column(Float)  # since the assignment was first opened


class Review(Numbered, Base):
    """An organiser's review of a submission; the latest one counts."""

    __tablename__ = "reviews"
    submission_id: Mapped[int] = mapped_column(ForeignKey("submissions.id"), index=True)
    reviewer_id: Mapped[int] = mapped_column(ForeignKey("people.id"))
    verdict: Mapped[str] = mapped_column(String(10))  # kept, disputed, rejected
    note: Mapped[str] = mapped_column(Text, default="")


class TutorialAnswer(Created, Base):
    """A person's accepted program for a tutorial task."""

    __tablename__ = "tutorial_answers"
    person_id: Mapped[int] = mapped_column(ForeignKey("people.id"), primary_key=True)
    task: Mapped[str] = mapped_column(String(40), primary_key=True)
    program: Mapped[str] = mapped_column(Text)
