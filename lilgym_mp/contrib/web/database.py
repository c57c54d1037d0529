"""Played episodes and annotations, in one SQLite file."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, field, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

SCHEMA_VERSION = 1  # kept in the file's header as `user_version`; increase it when a table changes
LOCK_SECONDS = 5.0  # a write waits this long for another one, then fails


class DatabaseError(ValueError):
    """A database that cannot be used; the message names it, the reason, and a remedy."""


def now() -> str:
    """The current time, in UTC, as ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")


@dataclass
class PlayedEpisode:
    """An episode played in a browser; its MDP state is rebuilt by replaying the actions."""

    id: str  # a secret of who plays it
    player: str  # a name, if one was given
    corpus: str
    configuration: str
    split: str
    task_id: str
    rules: str = "paper"
    actions: list[int] = field(default_factory=list)  # action indices of the appearance
    reward: float = 0.0
    outcome: str | None = None  # None: in progress
    shown_solution: bool = False  # before the end
    created: str = field(default_factory=now)
    changed: str = ""
    statement: str | None = None  # as the player saw it; None in rows of older databases


ANNOTATION_COLUMNS = (
    *("name", "corpus", "appearance", "split", "statement_id", "statement", "program"),
    *("accepted", "comment", "created"),  # accepted: agrees with all labels, those of the hidden scenes included
)
EPISODE_COLUMNS = [column.name for column in fields(PlayedEpisode)]
_TABLES = {
    "played_episodes": ["id PRIMARY KEY", *EPISODE_COLUMNS[1:]],
    "annotations": ["id INTEGER PRIMARY KEY", *ANNOTATION_COLUMNS],
}


class Database:
    """Transactions on an SQLite file."""

    def __init__(self, path: Path) -> None:
        """Opens the file, or creates it. Raises DatabaseError if it cannot be written or is none of this version's."""
        self._path = path
        self._create()

    def _create(self) -> None:
        """Creates the tables that the file lacks."""
        try:
            with self._open() as connection, connection:
                connection.execute("BEGIN IMMEDIATE")
                (version,) = connection.execute("PRAGMA user_version").fetchone()
                if version != SCHEMA_VERSION and connection.execute("SELECT 1 FROM sqlite_master").fetchone():
                    raise DatabaseError("holds tables of another program or version; name another file with --database")
                for table, columns in _TABLES.items():
                    connection.execute(f"CREATE TABLE IF NOT EXISTS {table} ({', '.join(columns)})")
                    known = {row["name"] for row in connection.execute(f"PRAGMA table_info({table})")}
                    for column in columns:
                        if column.split()[0] not in known:  # an older database
                            connection.execute(f"ALTER TABLE {table} ADD COLUMN {column}")
                connection.execute(f"PRAGMA user_version={SCHEMA_VERSION}")
        except (sqlite3.Error, DatabaseError) as fault:
            raise DatabaseError(f"database {self._path}: {_reason(str(fault))}") from None

    @contextmanager
    def read(self) -> Iterator[sqlite3.Connection]:
        """A connection; its rows have names. Creates the file again if it has been moved away."""
        if not self._path.exists():
            self._create()
        with self._open() as connection:
            yield connection

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        with closing(sqlite3.connect(self._path, LOCK_SECONDS, isolation_level=None)) as connection:
            connection.row_factory = sqlite3.Row
            connection.executescript("PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL")
            yield connection

    @contextmanager
    def write(self) -> Iterator[sqlite3.Connection]:
        """A transaction that is committed at the end, or rolled back if the block raises.

        It holds the write lock from the start, so that what it reads cannot change before it writes.
        Raises sqlite3.OperationalError after LOCK_SECONDS of waiting for the lock.
        """
        with self.read() as connection, connection:
            connection.execute("BEGIN IMMEDIATE")
            yield connection


def save_episode(connection: sqlite3.Connection, episode: PlayedEpisode) -> None:
    """Adds the episode, or replaces that with its id."""
    row = {**asdict(episode), "actions": json.dumps(episode.actions), "changed": now()}
    save_row(connection, "played_episodes", row)


def find_episode(connection: sqlite3.Connection, episode_id: str) -> PlayedEpisode | None:
    """The episode with that id, if there is one."""
    query = f"SELECT {', '.join(EPISODE_COLUMNS)} FROM played_episodes WHERE id=?"
    found = connection.execute(query, (episode_id,)).fetchone()
    if found is None:
        return None
    typed = {"shown_solution": bool(found["shown_solution"]), "actions": json.loads(found["actions"])}
    return PlayedEpisode(**{**dict(found), **typed})


def save_row(connection: sqlite3.Connection, table: str, row: Mapping[str, Any]) -> None:
    """Adds the row, or replaces that with its id."""
    values = ", ".join(f":{name}" for name in row)
    connection.execute(f"INSERT OR REPLACE INTO {table} ({', '.join(row)}) VALUES ({values})", row)


def _reason(message: str) -> str:
    if "locked" in message:
        return "it is locked by another program; stop that program or name another file with --database"
    if "unable to open" in message or "readonly" in message:
        return f"{message}: its directory must exist, and both must be writable"
    return message
