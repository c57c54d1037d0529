"""setuptools' build backend, with editable installs that editors understand and that work from the checkout's root.

An editable install makes two links, `lilgym_mp/wrappers` and `lilgym_mp/data`, to the folders beside the package, and
one link to the package itself, in a folder that is added to Python's path.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from setuptools import build_meta

build_sdist = build_meta.build_sdist
build_wheel = build_meta.build_wheel
get_requires_for_build_editable = build_meta.get_requires_for_build_editable
get_requires_for_build_sdist = build_meta.get_requires_for_build_sdist
get_requires_for_build_wheel = build_meta.get_requires_for_build_wheel
prepare_metadata_for_build_editable = build_meta.prepare_metadata_for_build_editable
prepare_metadata_for_build_wheel = build_meta.prepare_metadata_for_build_wheel


def build_editable(
    wheel_directory: str, config_settings: dict[str, Any] | None = None, metadata_directory: str | None = None
) -> str:
    """`pip install -e .` in setuptools' mode "strict", with the whole package linked, so that new modules are found."""
    settings = {"editable_mode": "strict", **(config_settings or {})}
    root = Path.cwd()
    links = [root / "lilgym_mp" / name for name in ("wrappers", "data")]
    for link in links:
        link.unlink(missing_ok=True)
    wheel = build_meta.build_editable(wheel_directory, settings, metadata_directory)
    for link in links:
        link.symlink_to(Path("..", link.name), target_is_directory=True)
    for tree in root.glob("build/__editable__.*/lilgym_mp"):
        shutil.rmtree(tree)
        tree.symlink_to(root / "lilgym_mp", target_is_directory=True)
    return wheel
