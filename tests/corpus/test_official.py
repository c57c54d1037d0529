"""Download of the official corpus from a local server, and import from a directory."""

import json
import os
import threading
from functools import partial
from http.server import HTTPServer, SimpleHTTPRequestHandler
from types import SimpleNamespace

import pytest

from lilgym_mp.corpus import CorpusError, load_tasks, official
from lilgym_mp.corpus.official import (
    FILE_FACTS,
    STATEMENT_COUNT,
    content_digest,
    download_official,
    import_official,
    official_names,
    read_released_file,
)

SCRATCH, FLIPIT = "tower_scratch_test.json", "tower_flipit_test.json"
NAMES = [SCRATCH, FLIPIT]


class Server(HTTPServer):
    """Serves a directory; the first `interruptions` responses break off."""

    interruptions = 0

    @property
    def url(self):
        return f"http://127.0.0.1:{self.server_port}"


class _Handler(SimpleHTTPRequestHandler):
    def do_GET(self):
        if self.server.interruptions:
            self.server.interruptions -= 1
            self.send_response(200)
            self.send_header("Content-Length", "1000")
            self.end_headers()
            self.wfile.write(b"{")
        else:
            super().do_GET()

    def log_message(self, *_):
        pass


@pytest.fixture
def server(small_release, monkeypatch):
    """Serves the small release on loopback, without a proxy and without pauses between tries."""
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    monkeypatch.setattr("pooch.core.time", SimpleNamespace(sleep=lambda seconds: None))
    with Server(("127.0.0.1", 0), partial(_Handler, directory=small_release)) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.fixture
def target(tmp_path):
    return tmp_path / "cache" / "lilgym"


def test_download__installs_files_that_load_tasks_reads(server, target):
    finished = []
    files = download_official(NAMES, target, server.url, finished.append)
    assert [(file.name, file.verified_by) for file in files] == [
        (SCRATCH, "content digest"),
        (FLIPIT, "numbers and labels"),
    ]
    assert finished == NAMES
    assert [task.id for task in load_tasks(target, "tower", "flipit", "test")] == ["blue-yes", "blue-no", "pair-no"]
    assert os.listdir(target.parent) == ["lilgym"]


def test_download__finds_the_files_anywhere_in_the_repository(server, small_release, target, monkeypatch):
    (small_release / "some where").mkdir()
    (small_release / SCRATCH).rename(small_release / "some where" / SCRATCH)
    tree = [{"path": f"some where/{SCRATCH}"}, {"path": "README.md"}]
    (small_release / "tree").write_text(json.dumps({"tree": tree}))
    monkeypatch.setattr(official, "TREE_URL", f"{server.url}/tree")
    monkeypatch.setattr(official, "RAW_URL", server.url)
    download_official([SCRATCH], target)
    assert (target / SCRATCH).exists()
    with pytest.raises(CorpusError, match=f"does not list {FLIPIT}.*lilgym-mp data import"):
        download_official(NAMES, target)


def test_download__is_tried_once_again_and_then_leaves_nothing(server, target):
    server.interruptions = 1
    download_official([SCRATCH], target, server.url)
    server.interruptions = 3
    with pytest.raises(CorpusError, match=r"nothing was installed: .*IncompleteRead.*lilgym-mp data import DIRECTORY"):
        download_official([FLIPIT], target, server.url)
    assert os.listdir(target.parent) == ["lilgym"]
    assert os.listdir(target) == [SCRATCH]


def test_download__a_missing_file_is_named(server, small_release, target):
    (small_release / FLIPIT).unlink()
    with pytest.raises(CorpusError, match=f"404.*{server.url}/{FLIPIT}"):
        download_official(NAMES, target, f"{server.url}/")
    assert not any(target.parent.rglob("*"))


def test_import__finds_files_in_any_directory(small_release, target):
    (small_release / "data").mkdir()
    (small_release / SCRATCH).rename(small_release / "data" / SCRATCH)
    assert [file.name for file in import_official(small_release, target)] == NAMES
    assert load_tasks(target, "tower", "scratch", "test").ids == ("7",)
    (small_release / FLIPIT).unlink()
    import_official(small_release, target)
    assert sorted(os.listdir(target)) == sorted(NAMES), "the others are kept"


def test_import__needs_released_files_without_contradictions(small_release, target, tmp_path):
    with pytest.raises(CorpusError, match="nowhere: no such directory"):
        import_official(tmp_path / "nowhere", target)
    (tmp_path / "empty").mkdir()
    with pytest.raises(CorpusError, match=f"none of the released files, .*{SCRATCH}"):
        import_official(tmp_path / "empty", target)
    (small_release / "copy").mkdir()
    (small_release / "copy" / FLIPIT).write_text("{}")
    with pytest.raises(CorpusError, match=f"several different files {FLIPIT}"):
        import_official(small_release, target)
    assert not target.parent.exists()


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        (SCRATCH, "Blue is", "Pink is", rf"^{SCRATCH}: is not the file of release 0\.0\.1.*content digest"),
        (SCRATCH, '"7"', '"6": {"sentence": "a", "lf": "exist(all_items)"}, "7"', "has 2 entries; the file .* has 1"),
        (FLIPIT, '"false"', '"true"', "label is true but the program is false"),
        (FLIPIT, "{", "", "not JSON"),
    ],
    ids=["another statement", "another number", "a wrong label", "broken"],
)
def test_import__a_file_of_another_version_keeps_the_previous_installation(
    name, old, new, message, small_release, target
):
    import_official(small_release, target)
    before = {path.name: path.read_bytes() for path in target.iterdir()}
    path = small_release / name
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(CorpusError, match=message):
        import_official(small_release, target)
    assert {path.name: path.read_bytes() for path in target.iterdir()} == before
    assert os.listdir(target.parent) == ["lilgym"]


def test_file_facts__cover_every_released_file():
    assert set(FILE_FACTS) == set(official_names())
    assert STATEMENT_COUNT < sum(facts.tasks for name, facts in FILE_FACTS.items() if "scratch" in name) == 2_959


def test_import__official_dev_files_are_verified_by_content(official_data, target, tmp_path):
    for name in official_names(["dev"]):
        (tmp_path / name).symlink_to(official_data / name)
    files = {file.name: file for file in import_official(tmp_path, target)}
    assert [files[name].verified_by for name in official_names(["dev"])] == ["content digest"] * 4
    assert [files[name].contexts for name in official_names(["dev"])] == [163, 317, 87, 164]
    assert {task.target for task in load_tasks(target, "scatter", "flipit", "dev")} == {True, False}


def test_content_digest__ignores_whitespace_and_key_order(tmp_path):
    compact = '{"a":{"sentence":"S.","lf":"exist(all_items)","label":"true","structured_rep":[[],[],[]]}}'
    spread = '{ "a": {"structured_rep": [[ ], [ ], [ ]], "label": "true", "lf": "exist(all_items)", "sentence": "S."} }'
    other = compact.replace("true", "false")

    def digest(text):
        path = tmp_path / "tower_flipit_dev.json"
        path.write_text(text)
        (records,) = read_released_file(path, []).records.values()
        return content_digest(records)

    assert digest(compact) == digest(spread) != digest(other)
