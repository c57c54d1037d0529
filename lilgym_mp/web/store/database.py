"""Database access: opening with schema migration, sessions, and serialised writes on SQLite."""

from __future__ import annotations

import asyncio
import secrets
import sqlite3
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from alembic.util import CommandError as AlembicError
from sqlalchemy import URL, Engine, create_engine, event, inspect, text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError, SQLAlchemyError, TimeoutError
from sqlalchemy.orm import Session

from lilgym_mp.web.store.models import Secret

MIGRATIONS = Path(__file__).parent / "migrations"
LOCK_SECONDS = 5.0  # a write waits this long for its turn and for a lock held by another process, then fails
POSTGRES_WRITERS = 20  # threads
COOKIE_KEY = "cookie key"

T = TypeVar("T")


class DatabaseError(ValueError):
    """A database that cannot be used; the message names it, the reason, and a remedy."""


class Database:
    """Read and write sessions on a database, and persistent secrets."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        self._is_sqlite = engine.dialect.name == "sqlite"
        # SQLite makes concurrent writers poll for its lock; queueing for a single thread is faster and fairer.
        self._writers = ThreadPoolExecutor(1 if self._is_sqlite else POSTGRES_WRITERS, "lilgym-mp writer")

    @contextmanager
    def read_session(self) -> Iterator[Session]:
        """A session whose changes are rolled back."""
        with Session(self.engine, expire_on_commit=False) as session:
            yield session

    @contextmanager
    def write_session(self, lock_seconds: float | None = None) -> Iterator[Session]:
        """A write session outside of requests, as at startup; requests use `write`. Waits at most LOCK_SECONDS."""
        with Session(self.engine, expire_on_commit=False) as session, session.begin():
            if self._is_sqlite:
                seconds = LOCK_SECONDS if lock_seconds is None else lock_seconds
                session.connection().exec_driver_sql(f"PRAGMA busy_timeout={int(1000 * seconds)}")
                session.connection().exec_driver_sql("BEGIN IMMEDIATE")
            yield session

    async def write(self, work: Callable[[Session], T]) -> T:
        """Runs `work` in a session that is then committed, or rolled back if it raises; returns its result.

        On SQLite a single thread runs all of them, holding the write lock from the start: what they read cannot change
        before they write. Raises sqlalchemy's TimeoutError or OperationalError after LOCK_SECONDS of waiting.
        """
        deadline = time.monotonic() + LOCK_SECONDS

        def run_in_session() -> T:
            seconds = deadline - time.monotonic()
            if seconds <= 0:
                raise TimeoutError("other writes did not end in time")
            with self.write_session(seconds) as session:
                return work(session)

        return await asyncio.wrap_future(self._writers.submit(run_in_session))

    def secret(self, name: str) -> str:
        """The secret with that name, generated on the first call."""
        with self.write_session() as session:
            secret = session.get(Secret, name)
            if secret is None:
                secret = Secret(name=name, value=secrets.token_urlsafe(32))
                session.add(secret)
            return secret.value

    def close(self) -> None:
        self._writers.shutdown()
        self.engine.dispose()


def open_database(url: str) -> Database:
    """The database at an SQLAlchemy URL, migrated to the current schema.

    Raises DatabaseError if it cannot be reached, written or locked, or belongs to another program or version.
    """
    label, engine = repr(url), None
    try:
        parsed = make_url(url)
        label = parsed.render_as_string(hide_password=True)
        engine = _create_engine(parsed)
        _migrate(engine)
        database = Database(engine)
        with database.write_session():
            return database
    except (ArgumentError, NoSuchModuleError):
        reason = "not a database URL such as sqlite:///file.sqlite3 or postgresql+psycopg://host/name"
    except ModuleNotFoundError as fault:
        reason = f"needs {fault.name}: pip install {fault.name}"
    except DBAPIError as fault:
        reason = _reason(fault)
    except (SQLAlchemyError, AlembicError, DatabaseError) as fault:
        reason = str(fault).splitlines()[0]
    if engine is not None:
        engine.dispose()
    raise DatabaseError(f"database {label}: {reason}")


def _create_engine(url: URL) -> Engine:
    match url.get_backend_name():
        case "sqlite" if url.database in (None, "", ":memory:"):
            raise DatabaseError("an in-memory database would lose its data; name a file")
        case "sqlite":
            arguments = {"timeout": LOCK_SECONDS, "check_same_thread": False}
            engine = create_engine(url, pool_size=40, connect_args=arguments)
            event.listen(engine, "connect", _prepare_sqlite)
            return engine
        case "postgresql":
            return create_engine(url, pool_pre_ping=True, pool_size=20, max_overflow=30)
        case _:
            raise DatabaseError("must be SQLite or PostgreSQL")


def _prepare_sqlite(connection: sqlite3.Connection, _: Any) -> None:
    connection.isolation_level = None  # `Database.write_session` begins transactions itself
    for setting in ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON"):
        connection.execute(f"PRAGMA {setting}")


def _reason(fault: DBAPIError) -> str:
    message = str(fault.orig).splitlines()[0] if str(fault.orig) else type(fault.orig).__name__
    if "locked" in message:
        return "it is locked by another program; stop that program or name another file with --database"
    if "unable to open" in message or "readonly" in message:
        return f"{message}: its directory must exist, and both must be writable"
    return message


def _migrate(engine: Engine) -> None:
    """Upgrades the schema to the current revision, in one transaction."""
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
    scripts = ScriptDirectory.from_config(config)
    with engine.connect() as connection:
        current = MigrationContext.configure(connection).get_current_heads()
        tables = inspect(connection).get_table_names()
    if current == tuple(scripts.get_heads()):
        return
    if not current and tables:
        raise DatabaseError(f"holds tables of another program ({', '.join(tables[:3])}, ...)")
    known = {script.revision for script in scripts.walk_revisions()}
    if set(current) - known:
        raise DatabaseError(
            f"was written by another version ({', '.join(current)}); "
            "pip install --upgrade lilgym-mp, or name another file"
        )
    with engine.begin() as connection:
        if engine.dialect.name == "sqlite":
            connection.execute(text("BEGIN IMMEDIATE"))
        config.attributes["connection"] = connection
        command.upgrade(config, "head")
