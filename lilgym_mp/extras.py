"""How to install what an extra brings, said in errors: by the names of packages, wherever this one came from."""

from __future__ import annotations

import re
from importlib.metadata import PackageNotFoundError, requires

DISTRIBUTION = "lilgym-mp"


def install(extra: str) -> str:
    """The command that installs an extra's packages, such as `pip install "jinja2>=3.1" "matplotlib>=3.9"`.

    Where this package is not installed, but imported from a checkout, its form for a checkout's root.
    """
    try:
        found = requires(DISTRIBUTION) or []
    except PackageNotFoundError:
        found = []
    marker = re.compile(rf"""(.*?)\s*;\s*extra == ['"]{extra}['"]""")
    packages = [match[1] for match in map(marker.fullmatch, found) if match]
    named = " ".join(f'"{package}"' for package in packages) or f'".[{extra}]"'
    return f"pip install {named} (the extra {extra})"
