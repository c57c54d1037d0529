"""Where official data and recorded behaviour come from, and an account of which tests had them."""

from __future__ import annotations

import os
import signal
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import settings

SOURCES = {  # fixture: (environment variable, what it holds)
    "official_data": ("LILGYM_DATA", "the official data"),
    "golden": ("LILGYM_GOLDEN", "the golden recordings"),
}
RAN = ("passed", "failed", "xfailed", "xpassed")

settings.register_profile("dev", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True, print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "dev"))


@pytest.fixture(scope="session")
def official_data() -> Path:
    """The directory of released JSON files; skips where LILGYM_DATA is unset."""
    return _directory_or_skip("official_data")


@pytest.fixture(scope="session")
def golden() -> Path:
    """The directory of recorded behaviour; skips where LILGYM_GOLDEN is unset."""
    return _directory_or_skip("golden")


def _directory_or_skip(fixture: str) -> Path:
    variable, contents = SOURCES[fixture]
    named = os.environ.get(variable)
    if not named:
        pytest.skip(f"{variable} is unset: it names the directory of {contents}")
    return Path(named)


def pytest_configure() -> None:
    if (
        signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    ):  # as under `nohup ... &`: commands under test would inherit it
        signal.signal(signal.SIGINT, signal.default_int_handler)
    for variable, contents in SOURCES.values():
        named = os.environ.get(variable)
        if named and not Path(named).is_dir():
            raise pytest.UsageError(f"{variable}={named} is not a directory; name that of {contents}, or unset it")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks each test with the sources that it uses; the mark travels with its reports."""
    for item in items:
        used = SOURCES.keys() & set(getattr(item, "fixturenames", ()))
        item.user_properties.extend(("source", fixture) for fixture in sorted(used))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    stats = terminalreporter.stats
    ran = Counter(source for outcome in RAN for report in stats.get(outcome, []) for source in _sources(report))
    skipped = Counter(source for report in stats.get("skipped", []) for source in _sources(report))
    terminalreporter.section("tests with data from elsewhere")
    for fixture, (variable, contents) in SOURCES.items():
        lack = f"{skipped[fixture]} skipped" + (f" for lack of {variable}" if not os.environ.get(variable) else "")
        terminalreporter.line(f"{ran[fixture]} ran with {contents}, {lack}")


def _sources(report: object) -> set[str]:
    """The sources that a report's test uses, or was skipped for lack of, whoever skipped it."""
    properties: list[tuple[str, object]] = getattr(report, "user_properties", [])
    used = {str(value) for name, value in properties if name == "source"}
    reason = str(getattr(report, "longrepr", "")) if getattr(report, "skipped", False) else ""
    return used | {fixture for fixture, (variable, _) in SOURCES.items() if variable in reason}
