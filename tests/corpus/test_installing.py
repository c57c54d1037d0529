"""Atomic installation of the official corpus from a directory."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from lilgym_mp.corpus import CorpusError, check_corpus, load_tasks
from lilgym_mp.corpus.faults import FaultLog
from lilgym_mp.corpus.official.installing import import_official, intact_installation, read_installation, staging_area
from lilgym_mp.corpus.official.release import FILE_FACTS, STATEMENT_COUNT, content_digest, official_names
from lilgym_mp.corpus.released import ReleasedFile

SCRATCH, FLIPIT = "tower_scratch_test.json", "tower_flipit_test.json"
NAMES = [SCRATCH, FLIPIT]


@pytest.fixture
def target(tmp_path: Path) -> Path:
    return tmp_path / "cache" / "lilgym"


@pytest.fixture
def checkout(tmp_path: Path, small_release: dict[str, bytes]) -> Path:
    """A checkout with files in different directories, one of them twice."""
    for name, place in ((SCRATCH, "data"), (FLIPIT, "data/deep"), (FLIPIT, "copy")):
        path = tmp_path / "checkout" / place / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(small_release[name])
    return tmp_path / "checkout"


def test_import__finds_files_in_any_directory(checkout: Path, target: Path):
    installation = import_official(checkout, NAMES, target)
    assert load_tasks(target, "tower", "scratch", "test").ids == ("7",)
    assert installation.source == str(checkout)
    assert read_installation(target) == installation
    assert [path.name for path in target.parent.iterdir()] == ["lilgym"]


def test_import__missing_files_are_named(checkout: Path, target: Path):
    (checkout / "data" / SCRATCH).unlink()
    with pytest.raises(CorpusError, match=rf"lacks {SCRATCH}; it has {FLIPIT}"):
        import_official(checkout, NAMES, target)
    with pytest.raises(CorpusError, match="it has none of the released files"):
        import_official(checkout / "data" / "deep", [SCRATCH], target)
    assert not target.parent.exists()


def test_import__a_missing_directory_is_an_error(tmp_path: Path, target: Path):
    with pytest.raises(CorpusError, match="nowhere: no such directory"):
        import_official(tmp_path / "nowhere", NAMES, target)


def test_import__different_files_of_one_name_are_an_error(checkout: Path, target: Path):
    (checkout / "copy" / FLIPIT).write_text("{}")
    with pytest.raises(CorpusError, match=f"several different files {FLIPIT}"):
        import_official(checkout, NAMES, target)


def test_import__files_of_another_version_keep_the_previous_installation(checkout: Path, target: Path):
    first = import_official(checkout, NAMES, target)
    (checkout / "data" / SCRATCH).write_text('{"7": {"sentence": "Other.", "lf": "exist(all_items)"}}')
    with pytest.raises(CorpusError, match=rf"^{SCRATCH}: is not the file of release 0\.0\.1"):
        import_official(checkout, NAMES, target)
    assert read_installation(target) == first
    assert [path.name for path in target.parent.iterdir()] == ["lilgym"]


def test_import__replaces_the_previous_installation(checkout: Path, target: Path):
    import_official(checkout, NAMES, target)
    import_official(checkout, [SCRATCH], target)
    assert sorted(path.name for path in target.iterdir()) == ["installed.json", SCRATCH]


def test_staging__leaves_nothing_after_an_error(target: Path):
    with pytest.raises(CorpusError), staging_area(target) as files:
        import_official(files, NAMES, files / "target")
    assert list(target.parent.iterdir()) == []


def test_staging__error_names_an_unwritable_directory(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(CorpusError, match=r"file.*cannot be written"),
        staging_area(tmp_path / "file" / "lilgym"),
    ):
        pass


def test_intact_installation__requires_unmodified_files_from_the_source(checkout: Path, target: Path):
    assert intact_installation(target, NAMES, None) is None
    installation = import_official(checkout, NAMES, target)
    assert intact_installation(target, [SCRATCH], None) == installation
    assert intact_installation(target, NAMES, str(checkout)) == installation
    assert intact_installation(target, NAMES, "elsewhere") is None
    assert intact_installation(target, [*NAMES, "tower_scratch_dev.json"], None) is None
    (target / SCRATCH).write_text("{}")
    assert intact_installation(target, NAMES, None) is None
    (target / "installed.json").write_text("{}")
    assert intact_installation(target, NAMES, None) is None


def test_check__modified_and_missing_installed_files_are_faults(checkout: Path, target: Path):
    import_official(checkout, NAMES, target)
    assert check_corpus(target).ok
    text = (target / FLIPIT).read_text()
    (target / FLIPIT).write_text(text + " ")
    (target / SCRATCH).unlink()
    assert [str(fault).rsplit(os.sep, 1)[-1] for fault in check_corpus(target).faults] == [
        f"{SCRATCH}: is missing since installation",
        f"{FLIPIT}: has changed since installation (its SHA-256 differs)",
    ]


def test_check__an_invalid_manifest_is_a_fault(checkout: Path, target: Path):
    import_official(checkout, NAMES, target)
    for record in ("{", "{}", '{"format": "other", "version": 1}', '{"format": "lilgym_mp-official", "version": 1}'):
        (target / "installed.json").write_text(record)
        assert any("installed.json: cannot be read" in str(fault) for fault in check_corpus(target).faults)


def test_file_facts__cover_every_released_file():
    assert set(FILE_FACTS) == set(official_names())
    scratch = sum(facts.tasks for name, facts in FILE_FACTS.items() if "scratch" in name)
    assert STATEMENT_COUNT < scratch == 2_959


def test_import__official_dev_files_are_verified_by_content(official_data: Path, target: Path):
    installation = import_official(official_data, official_names(["dev"]), target)
    assert [(file.proof, file.remark) for file in installation.files] == [("content digest", None)] * 4


def test_import__the_official_files_without_test_are_partial(official_data: Path, target: Path):
    with pytest.raises(CorpusError, match=r"lacks scatter_flipit_test\.json, scatter_scratch_test\.json, "):
        import_official(official_data, official_names(), target)


def test_content_digest__ignores_whitespace_and_key_order(tmp_path: Path):
    compact = '{"a":{"sentence":"S.","lf":"exist(all_items)","label":"true","structured_rep":[[],[],[]]}}'
    spread = '{ "a": {"structured_rep": [[ ], [ ], [ ]], "label": "true", "lf": "exist(all_items)", "sentence": "S."} }'
    other = compact.replace("true", "false")
    digests = []
    for text in (compact, spread, other):
        (tmp_path / "file").write_text(text)
        digests.append(content_digest(ReleasedFile(tmp_path / "file", "flipit").records(FaultLog(stop_at_first=True))))
    assert digests[0] == digests[1] != digests[2]
