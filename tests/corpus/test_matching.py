"""Tasks solved only by scenes of the corpus."""

import json

import pytest

from lilgym_mp.corpus import load_tasks
from lilgym_mp.corpus.matching import matching_corpus, solvable_matching_corpus
from tests.corpora import write_own_corpus
from tests.json_files import read_json_lines


def test_solvable_matching_corpus__omits_tasks_without_a_goal_scene(tmp_path):
    corpus = write_own_corpus(tmp_path / "own.jsonl")
    lines = read_json_lines(corpus)
    without = next(line for line in lines[1:] if (line["appearance"], line["split"]) == ("tower", "train"))
    without["starts"] = [start for start in without["starts"] if not start["label"]]
    corpus.write_text("\n".join(map(json.dumps, lines)))
    tasks = load_tasks(str(corpus), "tower", "scratch", "train")
    kept = solvable_matching_corpus(tasks)
    assert [task.id for task in tasks if task.id not in kept.ids] == [without["id"]]
    assert len(matching_corpus(tasks)) == len(tasks)


@pytest.mark.long
@pytest.mark.usefixtures("official_data")
def test_solvable_matching_corpus__of_official_train_lacks_one_in_a_hundred():
    tasks = {name: load_tasks("lilgym", name, "scratch", "train") for name in ("tower", "scatter")}
    assert {name: len(found) - len(solvable_matching_corpus(found)) for name, found in tasks.items()} == {
        "tower": 9,
        "scatter": 18,
    }
