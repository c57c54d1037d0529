"""The example that makes a table of a model."""

import sys

import table_language_model as table

from tests.llm.server import chat, served


def test_table__asks_before_it_starts_and_does_not_pay_twice(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(table, "baselines", lambda args: {"expert": {"TowerScratch": 1.0}})
    monkeypatch.setattr(table, "shipped", lambda args: {})
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
    rows = {line.split(" | ")[0]: line.strip("| ").split(" | ") for line in shown.splitlines() if line.startswith("| ")}
    assert rows["| expert"][1:] == ["100/-", "-/-", "-/-", "-/-/-/-/-"]
    for name in ("| m, text", "| m, image"):
        assert rows[name][1].endswith("/0")  # STOP alone solves no task of FlipIt
        assert rows[name][3].endswith("/0")  # a verifier that accepts every claim has a J of 0
        assert rows[name][4] == "0/0/0/0/0"
