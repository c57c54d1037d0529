"""`lilgym-mp bench` measures what it claims to; the speeds themselves are not tested."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from PIL import Image

from lilgym_mp.benchmark import Bench, Effort, Workload, benchmark_cases, players
from lilgym_mp.benchmark.catalogue import COPY_GROUP, BenchmarkCase
from lilgym_mp.benchmark.players import Play, Timing
from lilgym_mp.benchmark.report import BEGIN, COLOURS, END, insert_tables, report_text, scaling_chart
from lilgym_mp.benchmark.traces import EPISODE_ACTIONS, Episode, Script, vector_trace
from lilgym_mp.cli import main

SHORT = Effort(2, 1e-9, 110)


@pytest.fixture(scope="module", params=["TowerFlipIt", "ScatterFlipIt"])
def workload(request: pytest.FixtureRequest) -> Workload:
    return Workload(request.param, actions=110)


def test_script__is_deterministic_random_legal_edits_and_a_stop(workload: Workload) -> None:
    (script,) = workload.scripts(1)
    assert [len(episode.actions) for episode in script.episodes] == [1] + [EPISODE_ACTIONS] * 9
    assert all(episode.actions[-1] == 0 and 0 not in episode.actions[:-1] for episode in script.episodes)
    assert Workload(workload.configuration, actions=110).scripts(1) == [script]


def test_scripts__have_first_episodes_of_different_lengths(workload: Workload) -> None:
    firsts = [len(script.episodes[0].actions) for script in workload.scripts(16)]
    assert sorted(set(firsts)) == list(range(1, EPISODE_ACTIONS + 1))


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_trace__contains_no_invalid_action(workload: Workload, mode: AutoresetMode) -> None:
    env: Any = gym.make_vec(workload.environment_id, num_envs=12, autoreset_mode=mode, **workload.arguments)
    trace = vector_trace(workload.scripts(12), mode)
    env.reset(seed=0)
    for row in trace.rows:
        infos = env.step(row)[-1]
        assert "invalid_reason" not in infos.get("final_info", infos)


def test_trace__does_not_count_actions_ignored_by_autoreset() -> None:
    scripts = [
        Script(0, (Episode("a", (5, 0)), Episode("b", (6, 0)))),
        Script(1, (Episode("c", (0,)), Episode("d", (7, 8, 9, 0)))),
    ]
    next_step = vector_trace(scripts, AutoresetMode.NEXT_STEP)
    assert np.array(next_step.rows).T.tolist() == [[5, 0, 0, 6, 0, 0], [0, 0, 7, 8, 9, 0]]
    assert next_step.actions == 9
    same_step = vector_trace(scripts, AutoresetMode.SAME_STEP)
    assert np.array(same_step.rows).T.tolist() == [[5, 0, 6, 0], [0, 7, 8, 9]]
    assert same_step.actions == 8


def test_games__play_every_action_of_the_script() -> None:
    workload = Workload("TowerFlipIt", actions=110)
    with players.game(workload, "parallel_env") as play:
        rounds = play().steps
    with players.game(workload, "env") as play:
        assert play().steps == 2 * rounds == 2 * sum(len(e.actions) for e in workload.scripts(1)[0].episodes)


def _case_names() -> list[str]:
    return [f"{case.name} {case.num_envs}" for case in benchmark_cases()]


def test_cases__have_unique_names_and_lines_in_the_chart() -> None:
    assert len(set(_case_names())) == len(_case_names())
    assert COLOURS.keys() <= {case.name for case in benchmark_cases()}


def _fake(case: BenchmarkCase, rate: float = 1000.0) -> BenchmarkCase:
    """The case with a fixed rate."""
    return BenchmarkCase(case.group, case.name, case.num_envs, partial(_fake_player, rate=rate), case.is_part)


@contextmanager
def _fake_player(workload: Workload, rate: float) -> Iterator[Play]:
    yield lambda: Timing(int(rate), 1.0)


def test_ratio_to_copying__is_computed_by_round() -> None:
    copies, steps = iter([8, 4, 9, 2]), iter([7, 4, 6, 1])  # the first of each round is the warm-up
    bench = Bench(Effort(2, 0.5))
    bench.measure(
        Workload("TowerScratch", actions=11),
        [
            _case_with_steps(COPY_GROUP, "memory copy", lambda: next(copies)),
            _case_with_steps("single", "single", lambda: next(steps)),
        ],
        lambda: None,
    )
    ours = bench.results[1]
    assert ours.rates == [4.0, 1.0]
    assert bench.ratio_to_copying(ours) == (4 / 4 + 1 / 2) / 2


def _case_with_steps(group: str, name: str, count: Callable[[], int]) -> BenchmarkCase:
    @contextmanager
    def open_case(workload: Workload) -> Iterator[Play]:
        yield lambda: Timing(count(), 1.0)

    return BenchmarkCase(group, name, 1, open_case)


def test_missing_package__skips_its_cases_with_a_note() -> None:
    @contextmanager
    def open_case(workload: Workload) -> Iterator[Play]:
        raise ModuleNotFoundError("no SB3", name="stable_baselines3.common")
        yield

    bench = Bench(SHORT)
    rest = _fake(benchmark_cases(["single"])[0])
    bench.measure(Workload("TowerScratch", actions=11), [BenchmarkCase("sb3", "SB3", 8, open_case), rest], lambda: None)
    assert bench.notes == ["not measured: sb3 (needs stable_baselines3.common)"]
    assert [measurement.case for measurement in bench.results] == [rest]


def test_interrupt__keeps_completed_rounds() -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    bench = Bench(SHORT)
    bench.measure(Workload("TowerScratch", actions=11), [_fake(benchmark_cases(["single"])[0])], interrupt)
    assert bench.is_interrupted
    assert [len(measurement.rates) for measurement in bench.results] == [1]
    assert "Interrupted" in report_text(bench)


def test_chart__has_a_panel_per_configuration() -> None:
    bench = Bench(SHORT)
    for name in ("TowerScratch", "TowerFlipIt", "ScatterScratch"):
        bench.measure(Workload(name, actions=11), [_fake(case) for case in benchmark_cases(["batched"])], lambda: None)
    chart = scaling_chart(bench)
    assert chart is not None
    assert chart.get_figwidth() * chart.dpi <= 1000
    assert [axes.get_title(loc="left") for axes in chart.axes] == [
        "TowerScratch: steps per second",
        "TowerFlipIt: steps per second",
        "ScatterScratch: steps per second",
    ]


def test_insert_tables__replaces_the_old_tables() -> None:
    assert insert_tables(f"Before\n{BEGIN}\nold\n{END}\nafter\n", "new") == f"Before\n{BEGIN}\n\nnew\n\n{END}\nafter\n"
    with pytest.raises(ValueError, match="begin"):
        insert_tables("no marks", "new")


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """An even shorter quick effort."""
    monkeypatch.setattr("lilgym_mp.benchmark.EFFORTS", {"quick": SHORT})


@pytest.mark.long
@pytest.mark.usefixtures("short")
def test_bench__writes_tables_json_chart_and_document(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = tmp_path / "benchmarks.md"
    document.write_text(f"# Benchmarks\n{BEGIN}\n{END}\n")
    output = tmp_path / "out"
    command = ["bench", "--quick", "--only", "single", "batched", "parts", "--configurations", "TowerScratch"]
    assert main([*command, "--output", str(output), "--write-docs", str(document)]) == 0
    printed, progress = capsys.readouterr()
    assert "2 of 2 rounds, TowerScratch, " in progress
    assert "### TowerScratch" in printed
    assert printed.strip() in document.read_text()
    written = json.loads((output / "bench.json").read_text())
    names = {(result["name"], result["num_envs"]): result for result in written["results"]}
    assert len(names["batched, no copy", 64]["rates"]) == SHORT.repeats
    assert names["memory copy", 64]["of_copying"] is None
    for picture in (output, tmp_path / "pictures"):
        with Image.open(picture / "benchmark_scaling.png") as chart:
            assert chart.format == "PNG"


@pytest.mark.usefixtures("short")
def test_bench__ctrl_c_writes_results_so_far(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rate = Bench._rate
    calls = iter(range(100))

    def interrupted(self: Bench, play: Play) -> float:
        if next(calls) == 9:
            raise KeyboardInterrupt
        return rate(self, play)

    monkeypatch.setattr(Bench, "_rate", interrupted)
    command = ["bench", "--quick", "--only", "single", "--output", str(tmp_path)]
    assert main(command) == 130
    written = json.loads((tmp_path / "bench.json").read_text())
    assert written["is_interrupted"]
    assert {result["configuration"] for result in written["results"]} == {"TowerFlipIt"}
    assert len(written["results"]) == 7


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--only", "speed"], "unknown group 'speed'; choose from batched, copy, parts"),
        (["--configurations", "Tower"], "unknown configuration 'Tower'; choose from ScatterFlipIt"),
        (["--write-docs", "missing.md"], "cannot read missing.md"),
        (["--corpus", "missing.jsonl", "--quick"], "no corpus 'missing.jsonl'"),
    ],
)
def test_bench__rejects_invalid_options(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["bench", *arguments]) == 2
    assert message in capsys.readouterr().err
