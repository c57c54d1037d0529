"""Configuration of a server."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

LOOPBACK_HOSTS = ("127.0.0.1", "localhost", "::1")


@dataclass(frozen=True, slots=True)
class ServeOptions:
    """Corpus, data locations, access control and limits."""

    corpus: str = "builtin"
    database: str = "sqlite:///lilgym-web.sqlite3"  # SQLAlchemy URL
    runs: Path | None = None  # directory with training runs and recorded episodes
    requires_tokens: bool = False  # every page needs a login; true beyond loopback
    hosts: tuple[str, ...] | None = (*LOOPBACK_HOSTS, "testserver")  # accepted Host headers; None: any
    requests_per_second: float | None = 40.0  # sustained rate limit per visitor; None: unlimited
    program_seconds: float = 5.0  # time limit for evaluating one program
    program_processes: int = 2  # worker processes that evaluate programs


def database_url(location: str) -> str:
    """`location` itself if it is a URL, else the URL of the SQLite file at that path."""
    return location if "://" in location else f"sqlite:///{location}"
