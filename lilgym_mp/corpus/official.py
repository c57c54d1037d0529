"""The files of lilGym's release 0.0.1: known properties, verification, download and import.

The numbers of tasks and contexts are those of the paper (docs/spec.md, "Tasks"). Content digests are known for the
files that were available: Scratch train and dev, and FlipIt dev. The other files are verified by the number of entries,
their format, and labels that agree with the programs.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Callable, Collection, Iterable, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple, cast
from urllib.parse import quote

from lilgym_mp.corpus.faults import CorpusError, Fault, NoTasksError, checked
from lilgym_mp.corpus.formats import Source
from lilgym_mp.corpus.records import FLIPIT, SPLITS, STARTS, Record, as_object, parse_object, read_bytes, read_text
from lilgym_mp.corpus.tasks import TaskReader, contexts
from lilgym_mp.scene.appearances import APPEARANCES
from lilgym_mp.scene.choices import listed

RELEASE = "0.0.1"
RELEASE_NAME = "lilGym"
LABELS = {"true": True, "false": False}  # as the files spell them
STATEMENT_COUNT = 2_661  # distinct statements of all splits and both appearances
# No commit is named because that of the release is unknown: `check_official_file` verifies what the newest one has.
TREE_URL = "https://api.github.com/repos/lil-lab/lilgym/git/trees/HEAD?recursive=1"
RAW_URL = "https://raw.githubusercontent.com/lil-lab/lilgym/HEAD"
RETRIES = 1
SILENCE = 30.0  # seconds without a byte after which a try has failed


def released_name(appearance: str, start: str, split: str) -> str:
    """The name of a file of the official release."""
    return f"{appearance}_{start}_{split}.json"


RELEASED_NAMES = {
    released_name(*configuration): configuration for configuration in product(APPEARANCES, STARTS, SPLITS)
}


def released_path(directory: Path, appearance: str, start: str, split: str) -> Path:
    """The released file of one configuration and split.

    Raises NoTasksError naming the missing file and the released files that exist.
    """
    path = directory / released_name(appearance, start, split)
    if not path.exists():
        existing = [name for name in RELEASED_NAMES if (directory / name).exists()]
        found = f"of the released files it has {listed(existing)}" if existing else "it has none of the released files"
        raise NoTasksError(f"{directory}: lacks {path.name}; {found}")
    return path


def read_released_file(path: Path, faults: list[Fault]) -> Source:
    """A file with a released name. Raises CorpusError when it is not a JSON object."""
    text, sha256 = read_text(path)
    configuration = RELEASED_NAMES[path.name]
    try:
        content = parse_object("the file", text)
    except ValueError as fault:
        raise CorpusError(f"{path}: {fault}") from None
    records: list[Record] = []
    for name, value in content.items():
        where = f"{path}, entry {name!r}"
        if (entry := checked(faults, where, as_object, "an entry", value)) is not None:
            record = Record(where, where, name, entry.get("sentence"), entry.get("lf"))
            if configuration[1] == FLIPIT:
                label = LABELS.get(str(entry.get("label")), entry.get("label"))
                record = record._replace(label=label, scene=entry.get("structured_rep"), is_flipit=True)
            records.append(record)
    return Source(path, RELEASE_NAME, sha256, {configuration: records})


class FileFacts(NamedTuple):
    """Known properties of a released file."""

    tasks: int
    contexts: int  # number reported in the paper
    content_sha256: str | None = None  # `content_digest`; None: no copy was available


FILE_FACTS = {
    "tower_scratch_train.json": FileFacts(989, 989, "0ad23ecc3d8dbe0a40aec5ab28c86edc7da5b7d4885cbc1a6e0433a2d01ae66d"),
    "tower_scratch_dev.json": FileFacts(163, 163, "94d169ef3717768aed1e6137559f81a4001305df93195da05761288bfa06abad"),
    "tower_scratch_test.json": FileFacts(324, 324),
    "tower_flipit_train.json": FileFacts(5_704, 1_910),
    "tower_flipit_dev.json": FileFacts(676, 317, "377ced6f14bba727d8b8e1f427d70e3b97bbc3c1bb21d1b2f4525536b2d7b8f9"),
    "tower_flipit_test.json": FileFacts(1_383, 619),
    "scatter_scratch_train.json": FileFacts(
        1_241, 1_241, "95a257f2fc84f9919a96e13661a7f6fc2972d4be9c8b1b7d9a535ebb69fb3484"
    ),
    "scatter_scratch_dev.json": FileFacts(87, 87, "9bf8e7aff8430179aecf000670573dc243bf72a7660145e1c5500badcbc0530a"),
    "scatter_scratch_test.json": FileFacts(155, 155),
    "scatter_flipit_train.json": FileFacts(6_696, 2_340),
    "scatter_flipit_dev.json": FileFacts(313, 164, "a7da2aa19f9258cbbfb9fab6e42a0ad77870f811e4b6d049fff9a6326030627d"),
    "scatter_flipit_test.json": FileFacts(591, 285),
}


class OfficialFile(NamedTuple):
    """A verified file of the release."""

    name: str
    bytes: int
    tasks: int
    contexts: int
    verified_by: str


def official_names(splits: Collection[str] = SPLITS) -> list[str]:
    """The names of the released files of those splits."""
    return [name for name in FILE_FACTS if RELEASED_NAMES[name][2] in splits]


def content_digest(records: Iterable[Record]) -> str:
    """Hex SHA-256 of the ordered records, independent of JSON whitespace and key order."""
    digest = hashlib.sha256()
    for record in records:
        content = [record.id, record.statement, record.program, record.label, record.scene]
        digest.update(json.dumps(content, sort_keys=True, separators=(",", ":")).encode() + b"\n")
    return digest.hexdigest()


def check_official_file(path: Path) -> OfficialFile:
    """Verifies a file under its released name.

    Raises CorpusError naming the file and the fault: a fault that `load_tasks` would raise, or another version.
    """
    facts = FILE_FACTS[path.name]
    faults = list[Fault]()
    ((appearance, *_), records), *_ = read_released_file(path, faults).records.items()
    if len(records) != facts.tasks:
        raise CorpusError(f"{path}: has {len(records)} entries; the file of release {RELEASE} has {facts.tasks}")
    if facts.content_sha256 not in (None, content_digest(records)):
        raise CorpusError(
            f"{path}: is not the file of release {RELEASE}: it has as many entries, but statements, programs, labels "
            f"or scenes differ (content digest {content_digest(records)}, not {facts.content_sha256})"
        )
    tasks = list(TaskReader(appearance, faults).tasks(records))
    if faults:
        raise CorpusError(str(faults[0]))
    verified_by = "numbers and labels" if facts.content_sha256 is None else "content digest"
    return OfficialFile(path.name, path.stat().st_size, len(tasks), contexts(tasks), verified_by)


def download_official(
    names: Sequence[str], target: Path, url: str | None = None, on_file: Callable[[str], object] = lambda name: None
) -> list[OfficialFile]:
    """Downloads the named released files from GitHub, or from a directory at `url`, and imports them.

    `on_file` is called with the name of each file once it is complete. Raises CorpusError naming the URL and the fault;
    `target` is then unchanged.
    """
    import pooch  # pyright: ignore[reportMissingTypeStubs]
    from requests import RequestException

    library = cast("Any", pooch)  # untyped
    library.get_logger().setLevel("ERROR")
    downloader = library.HTTPDownloader(timeout=SILENCE)
    with tempfile.TemporaryDirectory() as downloaded:
        try:
            urls = _github_urls(names) if url is None else {name: f"{url.rstrip('/')}/{name}" for name in names}
            files = library.create(downloaded, "", registry=dict.fromkeys(names), urls=urls, retry_if_failed=RETRIES)
            for name in names:
                files.fetch(name, downloader=downloader)
                on_file(name)
        except (RequestException, ValueError) as error:
            raise CorpusError(
                f"the download failed, and nothing was installed: {error}. Try again, or obtain the files elsewhere "
                "and run `lilgym-mp data import DIRECTORY`"
            ) from None
        return import_official(Path(downloaded), target)


def _github_urls(names: Sequence[str]) -> dict[str, str]:
    """The URLs of the files, wherever they are in the repository."""
    import requests

    answer = requests.get(TREE_URL, timeout=SILENCE)
    answer.raise_for_status()
    paths = {path.rpartition("/")[2]: path for path in (entry["path"] for entry in answer.json()["tree"])}
    if missing := [name for name in names if name not in paths]:
        raise ValueError(f"{TREE_URL} does not list {listed(missing)}")
    return {name: f"{RAW_URL}/{quote(paths[name])}" for name in names}


def import_official(directory: Path, target: Path) -> list[OfficialFile]:
    """Installs all released files that are anywhere in a directory or checkout at `target`.

    Raises CorpusError if there are none, if two of one name differ, or naming the first that is not of the release;
    `target` is then unchanged.
    """
    if not directory.is_dir():
        raise CorpusError(f"{directory}: no such directory; name a checkout of lilGym or a directory of its JSON files")
    found: dict[str, bytes] = {}
    for parent, _, present in sorted(os.walk(directory)):
        for name in FILE_FACTS.keys() & present:
            content = read_bytes(Path(parent) / name)
            if found.setdefault(name, content) != content:
                raise CorpusError(f"{directory}: has several different files {name}, one of them in {parent}")
    if not found:
        raise CorpusError(f"{directory}: has none of the released files, {listed(FILE_FACTS)}")
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f"{target.name}-", dir=target.parent) as staged:
        paths = [Path(staged, name) for name in FILE_FACTS if name in found]
        for path in paths:
            path.write_bytes(found[path.name])
        try:
            files = list(map(check_official_file, paths))
        except CorpusError as fault:
            raise CorpusError(str(fault).replace(f"{staged}{os.sep}", "")) from None
        target.mkdir(exist_ok=True)
        for path in paths:
            path.replace(target / path.name)
    return files
