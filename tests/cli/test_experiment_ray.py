"""`lilgym-mp experiment --ray`: runs on a local cluster of two nodes, one of which is killed."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lilgym_mp.cli import USAGE_ERROR, main
from lilgym_mp.cli.experiment_plan import PlannedRun, read_plan
from lilgym_mp.cli.experiment_ray import pack, run_on_ray, unpack
from lilgym_mp.cli.experiment_runs import RunStatus, make_attempts
from lilgym_mp.evaluation.episodes import read_header
from lilgym_mp.evaluation.files import SUFFIX
from lilgym_mp.evaluation.options import CommandError

NEEDS_RAY = 'ray is not installed: pip install "lilgym-mp[ray]"'
TWO_RUNS = """
configurations = ["TowerScratch"]
seeds = [0, 1]
[[learners]]
learner = "ppo"
steps = 4096
"""


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A cluster whose head node has one CPU."""
    pytest.importorskip("ray", reason=NEEDS_RAY)
    from ray.cluster_utils import Cluster

    monkeypatch.setenv("RAY_worker_niceness", "0")  # otherwise Ray has a lower priority than other processes
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    attempts = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    yield attempts
    attempts.shutdown()


@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
def test_ray__run_of_a_killed_node_is_retried_and_a_failed_one_is_not(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    doomed = cluster.add_node(num_cpus=1)
    monkeypatch.chdir(tmp_path)
    Path("two.toml").write_text(TWO_RUNS)
    bad = PlannedRun("bad", (), (("no-such-command",),))
    attempts = make_attempts([bad, *read_plan(Path("two.toml"))], Path("results"), 1)

    def watch() -> None:
        nonlocal doomed
        training = Path(tempfile.gettempdir()).glob("lilgym-mp-*/results/runs/*/progress.jsonl")  # on both nodes
        if doomed is not None and len(list(training)) == 2:
            cluster.remove_node(doomed, allow_graceful=False)
            doomed = None

    run_on_ray(attempts, cluster.address, 1, watch, 0.2)
    assert doomed is None
    assert [attempt.status for attempt in attempts] == [RunStatus.FAILED, *[RunStatus.FINISHED] * 2]
    assert "no-such-command" in attempts[0].error
    for attempt in attempts[1:]:
        assert json.loads(attempt.marker.read_text())["commands"] == attempt.planned.commands
        assert (attempt.run / "agent.safetensors").exists()
        (recording,) = attempt.episodes.glob(f"*{SUFFIX}")
        header = read_header(recording)
        assert header is not None
        assert header.run == f"results/runs/{attempt.planned.name}"
        assert "$ lilgym-mp evaluate" in attempt.log.read_text()
    assert main(["experiment", "two.toml", "--out", "results"]) == 0  # the runs are already finished


def test_pack__contains_one_run_and_unpacks_elsewhere(tmp_path: Path):
    plan = [PlannedRun(name, (), ()) for name in ("a", "b")]
    here, other = make_attempts(plan, tmp_path / "here", 1)
    for attempt in (here, other):
        attempt.run.mkdir()
        (attempt.run / "checkpoint.pt").write_text(attempt.planned.name)
        attempt.log.write_text("message")
    (there,) = make_attempts(plan[:1], Path("there"), 1, tmp_path)
    unpack(pack(here), there)
    found = sorted(path.relative_to(tmp_path) for path in (tmp_path / "there").rglob("*") if path.is_file())
    assert found == [Path("there/logs/a.log"), Path("there/runs/a/checkpoint.pt")]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--ray", "auto", "--jobs", "2"], "--jobs is for runs on this machine"),
        (["--jobs", "0"], "--jobs must be at least 1"),
    ],
)
def test_experiment__rejects_invalid_options(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], message: str
):
    (tmp_path / "two.toml").write_text(TWO_RUNS)
    assert main(["experiment", str(tmp_path / "two.toml"), "--out", str(tmp_path / "out"), *words]) == USAGE_ERROR
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_ray__missing_cluster_is_reported_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    pytest.importorskip("ray", reason=NEEDS_RAY)
    (tmp_path / "two.toml").write_text(TWO_RUNS)
    command = ["experiment", str(tmp_path / "two.toml"), "--out", str(tmp_path / "out"), "--ray", "auto"]
    assert main(command) == USAGE_ERROR
    assert "--ray auto: cannot connect to a cluster" in capsys.readouterr().err


def test_ray__rejects_a_corpus_at_a_relative_path(tmp_path: Path):
    attempts = make_attempts([PlannedRun("a", ("train", "ppo", "--corpus", "own.jsonl"), ())], tmp_path, 1)
    with pytest.raises(CommandError, match=r"own\.jsonl is a relative path; --ray needs one that exists on all nodes"):
        run_on_ray(attempts, "auto", 1, lambda: None, 0.1)
