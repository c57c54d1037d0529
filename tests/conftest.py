"""Fixtures for the official data and golden recordings, and a summary of which tests used them."""

import gc
import os
import signal
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import settings

SOURCES = {  # fixture: (environment variable, contents)
    "official_data": ("LILGYM_DATA", "the official data"),
    "golden": ("LILGYM_GOLDEN", "the golden recordings"),
}
RAN = ("passed", "failed", "xfailed", "xpassed")

os.environ.pop("COLUMNS", None)  # set where pytest has imported readline; tables would be wrapped
os.environ.setdefault("OMP_NUM_THREADS", "1")  # torch's threads would contend with the other test processes

gc.set_threshold(10_000)  # imports and collected tests would otherwise be searched for garbage over and over

settings.register_profile("dev", deadline=None, max_examples=30)
settings.register_profile("ci", settings.get_profile("dev"), derandomize=True, print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "dev"))


@pytest.fixture(scope="session")
def official_data():
    """The directory of released JSON files; skips if LILGYM_DATA is unset."""
    return _directory_or_skip("official_data")


@pytest.fixture(scope="session")
def own(tmp_path_factory):
    """The path of a small corpus."""
    from tests.corpora import write_own_corpus

    return str(write_own_corpus(tmp_path_factory.mktemp("corpus") / "own.jsonl"))


@pytest.fixture
def undrawn(monkeypatch):
    """Leaves the pictures of reports empty, as drawing is slow."""
    monkeypatch.setattr("lilgym_mp.contrib.report.writing.save", lambda figure, path, kind: path.write_bytes(b""))


@pytest.fixture(scope="session")
def installed_form(tmp_path_factory):
    """The package in the layout of a wheel."""
    from tests.command_line import python
    from tests.scripts import ROOT, needs

    needs("setuptools")
    place = tmp_path_factory.mktemp("installed")
    program = "from setuptools import setup; setup()"
    done = python("-c", program, "-q", "build_py", "--build-lib", place, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr
    return place


@pytest.fixture(scope="module")
def chromium():
    """A headless browser; skips if there is none."""
    from tests.browser import chromium

    with chromium() as browser:
        yield browser


@pytest.fixture(scope="session")
def golden():
    """The directory of golden recordings; skips if LILGYM_GOLDEN is unset."""
    return _directory_or_skip("golden")


@pytest.fixture(params=["scatter", "tower"])
def appearance(request):
    """The name of each appearance."""
    return request.param


def _directory_or_skip(fixture):
    variable, contents = SOURCES[fixture]
    directory = os.environ.get(variable)
    if not directory:
        pytest.skip(f"{variable} is unset: it names the directory of {contents}")
    return Path(directory)


def pytest_configure():
    # Under `nohup ... &` SIGINT is ignored, and commands under test would inherit that.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    for variable, contents in SOURCES.values():
        directory = os.environ.get(variable)
        if directory and not Path(directory).is_dir():
            raise pytest.UsageError(
                f"{variable}={directory} is not a directory; set it to the directory of {contents}, or unset it"
            )


def pytest_collection_modifyitems(items):
    """Records in each test's properties, and so in its reports, the sources it uses.

    Puts tests of the official data first: of several processes then one alone loads it, which takes ten seconds.
    """
    items.sort(key=lambda item: "official_data" not in getattr(item, "fixturenames", ()))
    for item in items:
        used = SOURCES.keys() & set(getattr(item, "fixturenames", ()))
        item.user_properties.extend(("source", fixture) for fixture in sorted(used))


def pytest_collection_finish():
    gc.freeze()  # modules and tests stay to the end, so garbage collection need not visit them


def pytest_terminal_summary(terminalreporter):
    counts = Counter(
        (outcome == "skipped", value)
        for outcome in (*RAN, "skipped")
        for report in terminalreporter.stats.get(outcome, [])
        for name, value in getattr(report, "user_properties", [])
        if name == "source"
    )
    terminalreporter.section("tests with external data")
    for fixture, (variable, contents) in SOURCES.items():
        reason = "" if os.environ.get(variable) else f" because {variable} is unset"
        ran, skipped = counts[False, fixture], counts[True, fixture]
        terminalreporter.line(f"{ran} ran with {contents}, {skipped} skipped{reason}")
