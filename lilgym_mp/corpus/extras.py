"""Installation commands for extras, for error messages."""

from __future__ import annotations

import re
from importlib.metadata import PackageNotFoundError, requires

DISTRIBUTION = "lilgym-mp"


def install(extra: str) -> str:
    """The command that installs an extra's packages, such as `pip install "jinja2>=3.1" "matplotlib>=3.9"`.

    If this package is imported from a checkout without being installed, `pip install ".[extra]"`.
    """
    try:
        requirements = requires(DISTRIBUTION) or []
    except PackageNotFoundError:
        requirements = []
    marker = re.compile(rf"""(.*?)\s*;\s*extra == ['"]{extra}['"]""")
    packages = [match[1] for match in map(marker.fullmatch, requirements) if match]
    named = " ".join(f'"{package}"' for package in packages) or f'".[{extra}]"'
    return f"pip install {named} (the extra {extra})"
