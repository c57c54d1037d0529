"""The dataset keeps reasoning-gym's contract."""

from __future__ import annotations

from itertools import islice

import lilgym_reasoning_gym
import pytest
import reasoning_gym
from reasoning_gym.dataset import ReseedingDataset


@pytest.mark.parametrize("kind", ["plan", "truth", "program"])
def test_dataset__its_answers_score_1_and_others_less(kind: str):
    dataset = reasoning_gym.create_dataset("lilgym", kind=kind, seed=3, size=6)
    entries = list(dataset)
    assert entries == list(reasoning_gym.create_dataset("lilgym", kind=kind, seed=3, size=6))
    assert len(dataset) == len(entries) == 6
    assert [dataset.score_answer(entry["answer"], entry) for entry in entries] == [1] * 6
    assert [dataset.score_answer(answer, entries[0]) for answer in (None, "", "no idea")] == [0] * 3


def test_dataset__is_endless_by_reseeding():
    dataset = reasoning_gym.create_dataset("lilgym", kind="truth", seed=3, size=4)
    questions = [entry["question"] for entry in islice(ReseedingDataset(dataset, chunk_size=4), 10)]
    assert len(set(questions)) > 8


def test_curriculum__raises_the_difficulty_which_entries_name():
    curriculum = lilgym_reasoning_gym.LilgymCurriculum()
    curriculum.set_attr_level("level", 3)
    curriculum.increment_attr_level("min_actions")
    config = curriculum.generate_configuration({"seed": 1, "size": 2, "split": "dev"})
    (entry, _) = reasoning_gym.create_dataset("lilgym", **vars(config))
    assert entry["metadata"]["difficulty"] == {"level": 4, "min_actions": 3}
    assert entry["metadata"]["actions"] >= 3
    assert "-dev-4-" in entry["metadata"]["row"]["id"]
