"""Opening a database: reached, ours, and brought to this version's tables before anything is served."""

from __future__ import annotations

import asyncio
import os
import secrets
import sqlite3
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from alembic.util import CommandError as AlembicError
from anyio.to_thread import run_sync
from sqlalchemy import Engine, create_engine, event, inspect, text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError, SQLAlchemyError
from sqlalchemy.orm import Session

from lilgym_mp.web.store.models import Secret

MIGRATIONS = Path(__file__).parent / "migrations"
LOCK_SECONDS = 10.0  # to wait for another writer
CHECKPOINT_COMMITS = 500  # after so many, SQLite's write-ahead log is moved into the database
COOKIE_KEY = "cookie key"

T = TypeVar("T")


class DatabaseError(ValueError):
    """A database that cannot be used; the text says which, why, and what to do."""


class Database:
    """Sessions on one database, and the secrets that outlive a restart."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        self._log = _Log(engine) if engine.dialect.name == "sqlite" else None
        # SQLite lets one write and has the others ask again now and then: waiting in line is quicker and fairer.
        self._turn = threading.Lock() if self._log else nullcontext()
        self._writer = ThreadPoolExecutor(1, "lilgym-mp writer")

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """A session whose changes are thrown away."""
        with Session(self.engine, expire_on_commit=False) as session:
            yield session

    @contextmanager
    def writing(self, *, durable: bool = True) -> Iterator[Session]:
        """A session that is committed when the block ends, and rolled back where it raises.

        On SQLite it holds the write lock from the start, so that what it reads stays true until it writes. What is
        committed outlives this process, however that ends; where it need not outlive a power cut as well, it is
        not `durable` and does not wait for the disk.
        """
        with self._session(durable=durable) as session:
            yield session
        if self._log:
            self._log.written(durable=durable)

    async def write(self, work: Callable[[Session], T], *, durable: bool = True) -> T:
        """What `work` gives, called with a session like that of `writing`.

        For requests that come often: one thread does all of them on SQLite, so that the write lock need not wait for
        a thread to wake up, nor other writes for the disk.
        """

        def done() -> T:
            with self._session(durable=durable) as session:
                return work(session)

        if self._log is None:
            return await run_sync(done)
        result = await asyncio.wrap_future(self._writer.submit(done))
        if durable or self._log.is_long:
            await run_sync(partial(self._log.written, durable=durable))
        return result

    @contextmanager
    def _session(self, *, durable: bool) -> Iterator[Session]:
        with self._turn, Session(self.engine, expire_on_commit=False) as session, session.begin():
            if self._log:
                session.connection().exec_driver_sql("BEGIN IMMEDIATE")
            elif not durable:
                session.execute(text("SET LOCAL synchronous_commit TO off"))
            yield session
        if self._log:
            self._log.commits += 1

    def secret(self, name: str) -> str:
        """The secret of that name, made at the first call."""
        with self.writing() as session:
            kept = session.get(Secret, name)
            if kept is None:
                kept = Secret(name=name, value=secrets.token_urlsafe(32))
                session.add(kept)
            return kept.value

    def close(self) -> None:
        self._writer.shutdown()
        self.engine.dispose()


class _Log:
    """The write-ahead log of an SQLite database, brought to the disk after a commit, while others write already.

    SQLite itself would do both while it holds the write lock.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._path = Path(str(engine.url.database) + "-wal").absolute()
        self.commits = 0

    @property
    def is_long(self) -> bool:
        return self.commits >= CHECKPOINT_COMMITS

    def written(self, *, durable: bool) -> None:
        """After a commit: waits for the disk where it must, and now and then moves the log into the database."""
        if durable:
            self._sync()
        if self.is_long:
            self.commits = 0
            with self._engine.connect() as connection:
                connection.exec_driver_sql("PRAGMA wal_checkpoint(PASSIVE)")

    def _sync(self) -> None:
        log = os.open(self._path, os.O_RDWR)
        try:
            os.fsync(log)
        finally:
            os.close(log)


def open_database(url: str) -> Database:
    """The database at an SQLAlchemy URL, with this version's tables; an older one is migrated.

    Raises DatabaseError for one that cannot be reached, written or unlocked, is not ours, or of a newer version.
    """
    shown = _shown(url)
    engine = _engine(url, shown)
    try:
        _migrate(engine, shown)
        with Database(engine).writing():
            pass
    except DBAPIError as fault:
        engine.dispose()
        raise DatabaseError(f"database {shown}: {_reason(fault)}") from None
    except (SQLAlchemyError, AlembicError) as fault:
        engine.dispose()
        raise DatabaseError(f"database {shown}: {str(fault).splitlines()[0]}") from None
    except DatabaseError:
        engine.dispose()
        raise
    return Database(engine)


def _shown(url: str) -> str:
    """The URL for people, without its password."""
    try:
        return make_url(url).render_as_string(hide_password=True)
    except ArgumentError:
        return repr(url)


def _engine(url: str, shown: str) -> Engine:
    options: dict[str, Any] = {"pool_pre_ping": True, "pool_size": 20, "max_overflow": 30}
    try:
        parsed = make_url(url)
        if parsed.get_backend_name() == "sqlite":
            options = {"pool_size": 40, "connect_args": {"timeout": LOCK_SECONDS, "check_same_thread": False}}
            if parsed.database in (None, "", ":memory:"):
                raise DatabaseError(f"database {shown}: a database in memory would lose what it is given; name a file")
        elif parsed.get_backend_name() != "postgresql":
            raise DatabaseError(f"database {shown}: must be SQLite's or PostgreSQL's")
        engine = create_engine(parsed, **options)
    except (ArgumentError, NoSuchModuleError):
        raise DatabaseError(
            f"database {shown}: not an URL of a database, such as sqlite:///file.sqlite3 or postgresql+psycopg://host/name"
        ) from None
    except ModuleNotFoundError as fault:
        raise DatabaseError(f"database {shown}: needs {fault.name}: pip install {fault.name}") from None
    if parsed.get_backend_name() == "sqlite":
        event.listen(engine, "connect", _prepare_sqlite)
    return engine


def _prepare_sqlite(connection: sqlite3.Connection, _: Any) -> None:
    connection.isolation_level = None  # transactions begin where `Database.writing` says so
    for setting in ("journal_mode=WAL", "synchronous=NORMAL", "wal_autocheckpoint=0", "foreign_keys=ON"):
        connection.execute(f"PRAGMA {setting}")


def _reason(fault: DBAPIError) -> str:
    said = str(fault.orig).splitlines()[0] if str(fault.orig) else type(fault.orig).__name__
    if "locked" in said:
        return "it is locked by another program; end that one or name another file with --database"
    if "unable to open" in said or "readonly" in said:
        return f"{said}: its directory must exist and both must be writable"
    return said


def _migrate(engine: Engine, shown: str) -> None:
    """Brings the tables to this version's, in one transaction."""
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
    scripts = ScriptDirectory.from_config(config)
    with engine.connect() as connection:
        found = MigrationContext.configure(connection).get_current_heads()
        tables = inspect(connection).get_table_names()
    if found == tuple(scripts.get_heads()):
        return
    if not found and tables:
        raise DatabaseError(f"database {shown}: holds tables of another program ({', '.join(tables[:3])}, ...)")
    known = {script.revision for script in scripts.walk_revisions()}
    if set(found) - known:
        raise DatabaseError(
            f"database {shown}: was written by a newer version ({', '.join(found)}); pip install --upgrade lilgym-mp"
        )
    with engine.begin() as connection:
        if engine.dialect.name == "sqlite":
            connection.execute(text("BEGIN IMMEDIATE"))
        config.attributes["connection"] = connection
        command.upgrade(config, "head")


__all__ = ["COOKIE_KEY", "Database", "DatabaseError", "open_database"]
