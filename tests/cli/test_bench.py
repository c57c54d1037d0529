"""`lilgym-mp bench` measures what it claims to; the speeds themselves are not tested."""

import re
import sys

import gymnasium as gym
import pytest
from gymnasium.vector import AutoresetMode

from lilgym_mp.cli import bench
from lilgym_mp.cli.bench import EPISODE_ACTIONS, FIXED, Workload
from lilgym_mp.evaluation import Settings
from tests.command_line import error_of, lilgym, output_of, succeeds


@pytest.mark.parametrize("configuration", ["TowerFlipIt", "ScatterFlipIt"])
def test_11_actions__are_random_legal_edits_and_a_stop(configuration):
    workload = Workload(Settings(configuration), FIXED, 110)
    played = workload.episodes(3, 2)
    assert [len(actions) for actions in played] == [4] + [EPISODE_ACTIONS] * 5
    assert all(actions[-1] == 0 and 0 not in actions[:-1] for actions in played)
    assert Workload(Settings(configuration), FIXED, 110).episodes(3, 2) == played


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_rows__contain_no_invalid_action_and_count_what_autoreset_does_not_ignore(mode):
    workload = Workload(Settings("TowerFlipIt"), FIXED, 110)
    env = gym.make_vec(workload.id, num_envs=12, autoreset_mode=mode, **workload.arguments)
    rows, steps = workload.rows(12, mode)
    env.reset(seed=0)
    played, ignored = 0, 0
    for row in rows:
        _, _, terminated, truncated, infos = env.step(row)
        assert "invalid_reason" not in infos.get("final_info", infos)
        played += 12 - ignored
        ignored = int((terminated | truncated).sum()) if mode is AutoresetMode.NEXT_STEP else 0
    assert steps == played


@pytest.fixture
def few_actions(monkeypatch):
    """Makes the command's workloads short."""
    monkeypatch.setattr(bench, "Workload", lambda settings, name, actions: Workload(settings, name, 110))


@pytest.mark.long
@pytest.mark.usefixtures("few_actions")
def test_bench__measures_speed_and_memory_of_the_given_numbers_of_environments(capsys, monkeypatch):
    monkeypatch.setattr(bench.Player, "rate", lambda player, seconds: player.steps / player.play())
    printed = output_of(
        capsys, "bench --quick --configuration TowerScratch --only batched single pettingzoo --num-envs 2 16"
    )
    rows = [re.split(" {2,}", line) for line in printed.splitlines() if re.search(r"  [\d,]+  ", line)]
    megabytes = {(way, workload, envs): float(cell) for way, workload, envs, *_, cell in rows if cell != "-"}
    assert megabytes["batched", FIXED, "16"] > 16 * 28_500 / 1e6, "an image each"
    assert megabytes["batched", FIXED, "2"] < megabytes["batched", FIXED, "16"]
    assert {way for way, *_ in megabytes} >= {"single, masks", "batched, action_mask_v0", "games, batched"}


@pytest.mark.usefixtures("few_actions")
@pytest.mark.long
def test_bench__ctrl_c_keeps_results_so_far(capsys, monkeypatch):
    done = []

    def rate(player, seconds):
        if len(done) == 20:
            raise KeyboardInterrupt
        done.append(player)
        return 1.0

    monkeypatch.setattr(bench.Player, "rate", rate)
    assert lilgym("bench --quick --only single --configuration TowerFlipIt TowerScratch") == 130
    printed = capsys.readouterr()
    assert "\n\nTowerFlipIt\n\n" in printed.out
    assert "\nTowerScratch\n" not in printed.out


def test_missing_package__leaves_out_its_ways(capsys, monkeypatch):
    for name in [
        name for name in sys.modules if name.startswith(("stable_baselines3.", "sb3_contrib", "lilgym_mp.sb3"))
    ]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    monkeypatch.setattr(bench.Player, "rate", lambda player, seconds: 1.0)
    succeeds("bench --quick --configuration TowerFlipIt --only sb3 --num-envs 2")
    assert "not measured: SB3, batched (needs stable_baselines3" in capsys.readouterr().err


def test_bench__rejects_an_empty_batch(capsys):
    assert "--num-envs must be at least 1, not 0" in error_of(capsys, "bench --num-envs 8 0")
