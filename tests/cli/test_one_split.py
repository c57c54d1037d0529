"""A corpus with a single split, dev or test, can be played, evaluated and observed as arrays."""

import gymnasium as gym
import pytest

from lilgym_mp.corpus import write_corpus
from lilgym_mp.wrappers import tokenized_statement_v0
from tests.command_line import output_of
from tests.corpora import entry

STATEMENT = "A blue block crowns some box."


@pytest.mark.parametrize("split", ["dev", "test"])
def test_only_split__is_evaluated_without_seen_statements_and_gives_array_observations_their_words(
    split, tmp_path, capsys
):
    corpus, program = str(tmp_path / "own.jsonl"), "exist(filter_obj(all_items, lambda x: is_blue(x) and is_top(x)))"
    write_corpus(corpus, "one split", "CC0-1.0", [entry("crown", "tower", split, STATEMENT, program)])
    output = output_of(capsys, f"evaluate --policy expert --corpus {corpus} --split {split}")
    assert "100.0 %" in output
    assert "seen" not in output
    env = gym.make("lilgym_mp/TowerScratch-v0", corpus=corpus, split=split, observation="arrays")
    assert env.observation_space.contains(env.reset(seed=0)[0])
    tokens = tokenized_statement_v0(gym.make("lilgym_mp/TowerScratch-v0", corpus=corpus, split=split))
    ids = tokens.reset(seed=0)[0]["statement"]
    assert len(set(ids[ids > 0])) == len(STATEMENT.split())
