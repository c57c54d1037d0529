"""Installation hints name the packages of an extra, because this package itself is not on an index."""

from __future__ import annotations

import re
import tomllib
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

from lilgym_mp.corpus import extras

ROOT = Path(__file__).parent.parent
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]


@pytest.mark.parametrize("extra", ["sb3", "report", "human", "pettingzoo"])
def test_install__names_the_packages_of_the_extra(extra: str, monkeypatch: pytest.MonkeyPatch):
    built = [f'{package}; extra == "{name}"' for name, packages in EXTRAS.items() for package in packages]
    monkeypatch.setattr(extras, "requires", lambda name: ["numpy>=2.0", *built])
    expected = {re.split(r"[<>=]", package)[0] for package in EXTRAS[extra]}
    assert set(re.findall(r'"([A-Za-z0-9_-]+(?:\[[a-z0-9,]+\])?)[^"]*"', extras.install(extra))) == expected
    assert extras.install(extra).endswith(f"(the extra {extra})")


def test_install__of_a_checkout_that_is_not_installed(monkeypatch: pytest.MonkeyPatch):
    def missing(name: str) -> None:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(extras, "requires", missing)
    assert extras.install("report") == 'pip install ".[report]" (the extra report)'


def test_extras__named_in_code_exist():
    sources = [path for place in ("lilgym_mp", "wrappers") for path in (ROOT / place).rglob("*.py")]
    named = {extra for path in sources for extra in re.findall(r"""\binstall\(["'](\w+)["']\)""", path.read_text())}
    assert {"sb3", "charts", "human"} <= named <= set(EXTRAS)
