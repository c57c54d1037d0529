"""Reports on episodes of language models and of people beside those of trained agents."""

import json

import pytest

from lilgym_mp.contrib.report.played import conversations
from lilgym_mp.contrib.report.report_data import load_report_data
from lilgym_mp.contrib.report.writing import chapters
from lilgym_mp.corpus import write_corpus
from lilgym_mp.evaluation.files import EpisodesError
from tests.command_line import error_of, succeeds
from tests.corpora import entry

BLUE = "exist(filter_obj(all_items, lambda x: is_blue(x)))"


@pytest.fixture
def corpus(tmp_path):
    statements = ["There is a blue block.", "A block is blue.", "Some block is blue."]
    entries = [entry(f"t{number}", "tower", "dev", statement, BLUE) for number, statement in enumerate(statements)]
    write_corpus(tmp_path / "own.jsonl", "own", "CC0-1.0", entries)
    return tmp_path / "own.jsonl"


@pytest.fixture
def run(corpus, tmp_path):
    """A run of a text agent whose last episode ended with an answer without an action."""
    succeeds(f"llm play TowerScratch --agent expert --corpus {corpus} --out", tmp_path / "run")
    path = tmp_path / "run" / "transcripts.jsonl"
    *lines, last = path.read_text().splitlines()
    changed = json.loads(last) | {"outcome": "not_understood", "actions": []}
    path.write_text("\n".join([*lines, json.dumps(changed), '{"task": "t0", "error": "timeout", "messages": []}', ""]))
    return tmp_path / "run"


@pytest.mark.long
def test_report__has_a_language_model_and_people_beside_policies(run, corpus, tmp_path):
    database = pytest.importorskip("lilgym_mp.contrib.web.database")
    command = f"evaluate --policy expert --configuration TowerScratch --corpus {corpus} --record"
    succeeds(command, tmp_path / "recorded")
    fields = {"corpus": str(corpus), "split": "dev", "configuration": "TowerScratch"}
    played = [("Ada", "t0", [3, 0], "success"), ("Ada", "t0", [0], "wrong_stop"), ("Bo", "t1", [0], "wrong_stop")]
    with database.Database(tmp_path / "web.sqlite3").write() as connection:
        for index, (player, task, actions, outcome) in enumerate(played):
            row = {"player": player, "task_id": task, "actions": actions, "outcome": outcome}
            database.save_episode(connection, database.PlayedEpisode(id=str(index), **fields, **row))
    (run / "game").mkdir()
    for name in (
        "transcripts.jsonl",
        "summary.json",
        "turns.jsonl",
    ):  # games have no such episodes
        (run / "game" / name).write_text("{}\n")
    data = load_report_data([tmp_path / "recorded", run, tmp_path / "web.sqlite3"])
    assert (len(data.agents), "people" in data.agents) == (3, True)
    people = data.find("people", "TowerScratch")
    assert [[one.outcome for one in each.episodes] for each in people.runs] == [["success"], ["wrong_stop"]]
    made = {item.title: item for items in chapters(data).values() for item in items}
    assert "Task-completion accuracy (%)" in made
    assert "Differences in accuracy between agents" in made


def test_conversations__keep_the_outcome_of_answers_without_an_action(run):
    recording = conversations(run)
    assert [episode.outcome for episode in recording.episodes] == ["success", "success", "not_understood"]
    assert (recording.episodes[2].actions, recording.episodes[2].reward) == ((), -1.0)
    assert recording.header.start_scenes == 3


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("summary.json", "{}", "there is no 'settings'"),
        ("transcripts.jsonl", "7\n", "no run of `llm play` that can be read"),
        ("transcripts.jsonl", "\n", "has no episodes yet"),
        ("summary.json", "", "a value is of another type than `llm play` writes"),
    ],
)
def test_conversations__of_damaged_files_are_refused(run, file, content, message):
    content = content or (run / file).read_text().replace('"seed": 0', '"seed": []')
    (run / file).write_text(content)
    with pytest.raises(EpisodesError) as caught:
        conversations(run)
    assert message in str(caught.value)
    assert "object has no attribute" not in str(caught.value)


def test_episodes__of_an_edited_corpus_are_refused(run, corpus, tmp_path, capsys):
    database = pytest.importorskip("lilgym_mp.contrib.web.database")
    row = {"corpus": str(corpus), "split": "dev", "configuration": "TowerScratch", "player": "", "task_id": "t0"}
    row |= {"actions": [3, 0], "outcome": "success", "statement": "There is a blue block."}
    with database.Database(tmp_path / "web.sqlite3").write() as connection:
        database.save_episode(connection, database.PlayedEpisode(id="1", **row))
    corpus.write_text(corpus.read_text().replace("There is a blue block.", "There is no such block."))
    with pytest.raises(EpisodesError, match="was played with other tasks"):
        conversations(run)
    assert "was 'There is a blue block.' when it was played" in error_of(
        capsys, f"data from-recordings {tmp_path / 'web.sqlite3'} --out", tmp_path / "own.npz"
    )
    with pytest.raises(EpisodesError, match="when it was played"):
        load_report_data([tmp_path / "web.sqlite3"])


def test_database__of_an_earlier_version_gets_the_statements_column(tmp_path):
    import sqlite3

    database = pytest.importorskip("lilgym_mp.contrib.web.database")
    columns = ["id PRIMARY KEY", *(name for name in database.EPISODE_COLUMNS[1:] if name != "statement")]
    with sqlite3.connect(tmp_path / "web.sqlite3") as connection:
        connection.execute(f"CREATE TABLE played_episodes ({', '.join(columns)})")
        connection.execute("PRAGMA user_version=1")
        connection.execute("INSERT INTO played_episodes (id, actions, shown_solution) VALUES ('a', '[]', 0)")
    with database.Database(tmp_path / "web.sqlite3").read() as connection:
        assert database.find_episode(connection, "a").statement is None
