"""Imports modules from scripts/, which is not a package; and skips tests for want of packages."""

import importlib
import importlib.util
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = ROOT / "scripts"


def needs(*modules):
    """Skips a test if one of the modules is not installed, without importing them."""
    for module in modules:
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed")


def load_script(name):
    """The module scripts/NAME.py, which may import others."""
    if str(SCRIPTS) not in sys.path:
        sys.path.append(str(SCRIPTS))
    return importlib.import_module(name)
