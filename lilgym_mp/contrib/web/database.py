"""Played episodes and annotations, in one SQLite file."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sqlalchemy import JSON, String, create_engine, event, inspect
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import DeclarativeBase, Mapped, Session, mapped_column

SCHEMA_VERSION = 1  # kept in the file's header as `user_version`; increase it when a table changes
LOCK_SECONDS = 5.0  # a write waits this long for another one, then fails


class DatabaseError(ValueError):
    """A database that cannot be used; the message names it, the reason, and a remedy."""


def now() -> str:
    """The current time, in UTC, as ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")


class Base(DeclarativeBase):
    created: Mapped[str] = mapped_column(String(40), default=now)


class PlayedEpisode(Base):
    """An episode played in a browser; its MDP state is rebuilt by replaying the actions."""

    __tablename__ = "played_episodes"
    id: Mapped[str] = mapped_column(primary_key=True)
    visitor: Mapped[str] = mapped_column(index=True)  # id of the browser
    player: Mapped[str]  # a name, if one was given
    corpus: Mapped[str]
    configuration: Mapped[str]
    split: Mapped[str]
    rules: Mapped[str]
    strict: Mapped[bool]  # an illegal action ends the episode
    task_id: Mapped[str]
    actions: Mapped[list[int]] = mapped_column(JSON, default=list)  # action indices of the appearance
    reward: Mapped[float] = mapped_column(default=0.0)
    outcome: Mapped[str | None]  # None: in progress
    shown_solution: Mapped[bool] = mapped_column(default=False)  # before the end
    changed: Mapped[str] = mapped_column(String(40), default=now, onupdate=now)


class Annotation(Base):
    """A program that somebody submitted for a statement."""

    __tablename__ = "annotations"
    id: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str] = mapped_column(index=True)  # of the annotator
    corpus: Mapped[str]
    appearance: Mapped[str]
    split: Mapped[str]
    statement_id: Mapped[str]
    statement: Mapped[str]
    program: Mapped[str]
    accepted: Mapped[bool]  # the program agrees with all labels, those of the hidden scenes included
    comment: Mapped[str]


class Database:
    """Read and write sessions on an SQLite file."""

    def __init__(self, path: Path) -> None:
        """Opens the file, or creates it. Raises DatabaseError if it cannot be written or is none of this version's."""
        self._engine = create_engine(f"sqlite:///{path}", pool_size=40, connect_args={"timeout": LOCK_SECONDS})
        event.listen(self._engine, "connect", _prepare)
        try:
            with self.write() as session:
                connection = session.connection()
                version = connection.exec_driver_sql("PRAGMA user_version").scalar_one()
                if version != SCHEMA_VERSION and inspect(connection).get_table_names():
                    raise DatabaseError("holds tables of another program or version; name another file with --database")
                Base.metadata.create_all(connection)
                connection.exec_driver_sql(f"PRAGMA user_version={SCHEMA_VERSION}")
        except (DBAPIError, DatabaseError) as fault:
            self.close()
            reason = _reason(fault) if isinstance(fault, DBAPIError) else str(fault)
            raise DatabaseError(f"database {path}: {reason}") from None

    @contextmanager
    def read(self) -> Iterator[Session]:
        """A session whose changes are rolled back."""
        with Session(self._engine, expire_on_commit=False) as session:
            yield session

    @contextmanager
    def write(self) -> Iterator[Session]:
        """A session that is committed at the end, or rolled back if the block raises.

        It holds the write lock from the start, so that what it reads cannot change before it writes.
        Raises sqlalchemy's OperationalError after LOCK_SECONDS of waiting for the lock.
        """
        with Session(self._engine, expire_on_commit=False) as session, session.begin():
            session.connection().exec_driver_sql("BEGIN IMMEDIATE")
            yield session

    def close(self) -> None:
        self._engine.dispose()


def _prepare(connection: sqlite3.Connection, _: Any) -> None:
    connection.isolation_level = None  # `Database.write` begins transactions itself
    for setting in ("journal_mode=WAL", "synchronous=FULL"):
        connection.execute(f"PRAGMA {setting}")


def _reason(fault: DBAPIError) -> str:
    message = str(fault.orig)
    if "locked" in message:
        return "it is locked by another program; stop that program or name another file with --database"
    if "unable to open" in message or "readonly" in message:
        return f"{message}: its directory must exist, and both must be writable"
    return message
