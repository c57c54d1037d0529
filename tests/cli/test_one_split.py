"""A corpus with a single split, dev or test, can be played, evaluated and observed as arrays."""

import gymnasium as gym
import pytest

from lilgym_mp.wrappers import tokenized_statement_v0
from tests.command_line import output_of
from tests.corpora import write_statements

STATEMENT = "A blue block crowns some box."


@pytest.mark.parametrize("split", ["dev", "test"])
def test_only_split__is_evaluated_without_seen_statements_and_gives_array_observations_their_words(
    split, tmp_path, capsys
):
    program = "exist(filter_obj(all_items, lambda x: is_blue(x) and is_top(x)))"
    corpus = write_statements(tmp_path / "own.jsonl", (split, STATEMENT, program))
    output = output_of(capsys, f"evaluate --policy expert --corpus {corpus} --split {split}")
    assert "100.0 %" in output
    assert "seen" not in output
    for observation, wrap in (("arrays", lambda env: env), ("text", tokenized_statement_v0)):
        env = wrap(gym.make("lilgym_mp/TowerScratch-v0", corpus=corpus, split=split, observation=observation))
        seen, _ = env.reset(seed=0)
        assert env.observation_space.contains(seen)
        assert len(set(seen["statement"][seen["statement"] > 0])) == len(STATEMENT.split())
