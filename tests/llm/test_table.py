"""The examples that serve a model and make its table."""

import sys
from unittest.mock import MagicMock

import pytest
import serve_language_model as server
import table_language_model as table

from tests.llm.server import chat, failing, served

PLAYED = {
    "success": 0.0,
    "results": [
        {"proposer": "openai", "verifier": "openai", "success": 0, "true_accept_rate": 0, "false_accept_rate": 0}
    ]
    * 2,
}


@pytest.fixture(autouse=True)
def _quick_baselines(monkeypatch):
    monkeypatch.setattr(table, "baselines", lambda args: {"expert": {"TowerScratch": 1.0}})
    monkeypatch.setattr(table, "shipped", lambda args: {})


@pytest.mark.long
def test_table__asks_before_it_starts_and_does_not_pay_twice(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("builtins.input", lambda prompt: "n")

    def reply(body, number):
        return 200, chat("holds" if "You are the verifier" in str(body["messages"][0]["content"]) else "STOP")

    with served(reply) as (url, asked):
        words = f"table --url {url} --model m --episodes 1 --prices 1 10 --out {tmp_path}"
        monkeypatch.setattr(sys, "argv", words.split())
        table.main()
        assert not asked
        assert "about 64 calls" in capsys.readouterr().out
        monkeypatch.setattr(sys, "argv", [*words.split(), "--yes"])
        table.main()
        shown = capsys.readouterr().out
        count = len(asked)
        table.main()
        assert len(asked) == count
        monkeypatch.setattr(sys, "argv", [*words.split(), "--yes", "--model", "other"])
        with pytest.raises(SystemExit, match=r"was played with option .*'m'.*, not .*'other'"):
            table.main()
        assert len(asked) == count
    rows = {line.split(" | ")[0]: line.strip("| ").split(" | ") for line in shown.splitlines() if line.startswith("| ")}
    assert rows["| expert"][1:] == ["100/-", "-/-", "-/-", "-/-/-/-/-"]
    for name in ("| m, text", "| m, image"):
        assert rows[name][1].endswith("/0")  # STOP alone solves no task of FlipIt
        assert rows[name][3].endswith("/0")  # a verifier that accepts every claim has a J of 0
        assert rows[name][4] == "0/0/0/0/0"


@pytest.mark.long
def test_table__of_texts_alone_keeps_what_was_answered_before_a_failure(tmp_path, monkeypatch):
    monkeypatch.setattr(table, "COLUMNS", ())
    monkeypatch.setattr(table, "GROUPS", {})
    monkeypatch.setattr(table, "played", lambda args, name, scene, *more: PLAYED)
    down = [3]
    with served(failing(down)) as (url, asked):
        words = f"table --url {url} --model m --episodes 1 --scenes list --option max_tokens=9 retries=0 --yes"
        monkeypatch.setattr(sys, "argv", [*words.split(), "--out", str(tmp_path)])
        with pytest.raises(SystemExit, match=r"busy.*; the same command continues the table"):
            table.main()
        down.clear()
        table.main()
    assert len(asked) == 6  # five levels, one of them twice
    assert asked[0]["max_tokens"] == 9


def test_server__is_given_the_file_and_the_threads(tmp_path, monkeypatch, capsys):
    library = MagicMock()
    library.Server.return_value.listening_address = "http://127.0.0.1:9"
    monkeypatch.setitem(sys.modules, "xllamacpp", library)
    monkeypatch.setattr(server.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(server.threading, "Event", MagicMock())
    monkeypatch.setattr(sys, "argv", ["serve"])
    with pytest.raises(SystemExit, match="name a file with --gguf"):
        server.main()
    monkeypatch.setattr(sys, "argv", f"serve --gguf {tmp_path / 'own.gguf'} --threads 3".split())
    server.main()
    assert capsys.readouterr().out == f"serving {tmp_path / 'own.gguf'} at http://127.0.0.1:9/v1\n"
    settings = library.CommonParams.return_value
    assert (settings.cpuparams.n_threads, settings.cpuparams_batch.n_threads, settings.n_ctx) == (3, 3, 8192)
