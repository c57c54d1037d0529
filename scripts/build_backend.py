"""setuptools' build backend, with editable installs that editors understand: folders that links lead to, with
`wrappers` and `data` in the package."""

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
    """`pip install -e .` in setuptools' mode "strict", with whole packages linked, so that new modules are found."""
    settings = {"editable_mode": "strict", **(config_settings or {})}
    wheel = build_meta.build_editable(wheel_directory, settings, metadata_directory)
    root = Path.cwd()
    for tree in root.glob("build/__editable__.*/lilgym_mp"):
        for folder in [path for path in tree.iterdir() if path.is_dir() and not path.is_symlink()]:
            shutil.rmtree(folder)
            inside = root / "lilgym_mp" / folder.name
            folder.symlink_to(inside if inside.is_dir() else root / folder.name, target_is_directory=True)
    return wheel
