"""What a server is started with."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

LOOPBACK_HOSTS = ("127.0.0.1", "localhost", "::1")


@dataclass(frozen=True, slots=True)
class ServeOptions:
    """The corpus, the places and the limits of one server."""

    corpus: str = "builtin"
    database: str = "sqlite:///lilgym-web.sqlite3"  # an URL as SQLAlchemy reads it
    runs: Path | None = None  # the directory with training runs and recorded episodes
    requires_tokens: bool = False  # whether nobody gets in without a token; true beyond loopback
    hosts: tuple[str, ...] | None = (*LOOPBACK_HOSTS, "testserver")  # names this server answers to; None: any
    requests_per_second: float | None = 40.0  # of one visitor in the long run; None: as many as come
    program_seconds: float = 5.0  # after which the process that evaluates a program is ended
    program_processes: int = 2


def database_url(place: str) -> str:
    """The URL of a database that is named by an URL or by an SQLite file's path."""
    return place if "://" in place else f"sqlite:///{place}"
