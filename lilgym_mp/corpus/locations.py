"""Locates corpora: builtin (shipped with the package), official, or a user's path."""

from __future__ import annotations

import os
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, cast

from lilgym_mp.corpus.faults import CorpusError

BUILTIN = "builtin"
OFFICIAL = "lilgym"
GENERATED = "generated"  # prefix of the names of generated corpora
BUILTIN_FILE = "builtin.jsonl.gz"
DATA_VARIABLE = "LILGYM_DATA"
PathLike = str | os.PathLike[str]


def is_generated(corpus: object) -> bool:
    """Whether the name is that of a generated corpus, valid or not."""
    return isinstance(corpus, str) and corpus.split(":")[0] == GENERATED


def is_path(corpus: str) -> bool:
    """Whether the corpus is named by its path."""
    return corpus not in (BUILTIN, OFFICIAL) and not is_generated(corpus) and not corpus.startswith(f"{BUILTIN}:")


def fixed_name(corpus: PathLike) -> str:
    """The corpus's name; a path is made absolute, "~" being the home directory.

    A word alone (no directory, no suffix) that names nothing stays as it is, for the error that refuses it.
    """
    name = os.fspath(corpus)
    if not is_path(name):
        return name
    path = os.path.abspath(os.path.expanduser(name))
    looks_like_path = os.path.dirname(name) != "" or os.path.splitext(name)[1] != ""
    return path if looks_like_path or os.path.exists(path) else name


def fixed_path(value: Any) -> Any:
    """A path as text and absolute, "~" being the home directory; what is no path as it is."""
    if not isinstance(value, str | os.PathLike):
        return value
    return os.path.abspath(os.path.expanduser(os.fspath(cast("os.PathLike[str]", value))))


FIXED = {"corpus": fixed_name, "vocabulary": fixed_path}  # keywords of environments that may be paths


def fixed_keywords(given: Mapping[str, Any]) -> dict[str, Any]:
    """The keywords of an environment with absolute paths, which mean the same from any working directory."""
    return {name: FIXED[name](value) if name in FIXED else value for name, value in given.items()}


def is_split(corpus: PathLike) -> bool:
    """Whether the name is that of a compositional split, valid or not, or of a file of its lists."""
    return os.fspath(corpus).startswith(f"{BUILTIN}:") or os.fspath(corpus).endswith((".split.json", ".split.json.gz"))


def installed_directory() -> Path:
    """The installation directory of the official corpus, in the user's cache; it may not exist."""
    from platformdirs import user_cache_path  # when first needed: most uses load the builtin corpus

    return user_cache_path("lilgym_mp", appauthor=False, opinion=False) / OFFICIAL


def official_directory() -> Path:
    """The directory to load the official corpus from: LILGYM_DATA or the installation directory; it may not exist."""
    named = os.environ.get(DATA_VARIABLE)
    return Path(named) if named else installed_directory()


@contextmanager
def corpus_path(corpus: PathLike) -> Generator[Path, None, None]:
    """The existing file or directory of a corpus, valid within the `with` block.

    Raises CorpusError when it does not exist, saying how to obtain it.
    """
    if corpus == BUILTIN:
        with as_file(files("lilgym_mp.data") / BUILTIN_FILE) as path:
            yield path
    elif corpus == OFFICIAL:
        directory = official_directory()
        if not directory.is_dir():
            reason = f"named by {DATA_VARIABLE}" if os.environ.get(DATA_VARIABLE) else f"{DATA_VARIABLE} is not set"
            raise CorpusError(
                f"the official corpus was not found: {directory} is not a directory ({reason}). "
                f"Run `lilgym-mp data download`, or set {DATA_VARIABLE} to a directory with the released JSON files; "
                f'corpus="{BUILTIN}" requires neither'
            )
        yield directory
    else:
        path = Path(corpus)
        if not path.exists():
            raise CorpusError(
                f"no corpus {os.fspath(corpus)!r}: no such file or directory; "
                f'choose from "{BUILTIN}", "{OFFICIAL}", or the path of a corpus file or a directory of released files'
            )
        yield path
