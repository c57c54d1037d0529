"""The tables."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from sqlalchemy import JSON, DateTime, Float, ForeignKey, Integer, MetaData, String, Text
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


__all__ = ["Moment", "Person", "PlayedEpisode", "Secret", "Table", "Text", "Visitor", "now"]
