"""A shortened run of tests/stress/wrapper_stacks.py."""

from __future__ import annotations

from gymnasium.vector import AutoresetMode

from tests.stress.wrapper_stacks import compare, differences


def test_random_wrapper_stacks__play_alike_on_single_batched_and_worker_environments() -> None:
    compared, found = compare(count=8, seed=3)
    assert not found
    assert compared["played"] >= 20
    assert compared["also by workers"]


def test_entries_of_steps__are_absent_from_infos_where_every_environment_only_resets() -> None:
    stack = [("stop_forcing", {"mode": "replace"}), ("channels_first", {})]
    for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP):
        for seed in range(3):
            assert not list(differences("ScatterScratch", stack, mode, seed, workers=False))
