"""The dataset keeps reasoning-gym's contract."""

from __future__ import annotations

from itertools import islice

import lilgym_reasoning_gym  # noqa: F401  (registers the dataset)
import pytest
import reasoning_gym
from reasoning_gym.dataset import ReseedingDataset


@pytest.mark.parametrize("kind", ["plan", "truth", "scene", "program"])
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
