"""`lilgym-mp experiment --ray`: runs are tasks of a cluster, and what is lost is done by the next command."""

import os
import subprocess
import sys
import time
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from lilgym_mp.cli import experiment_ray
from lilgym_mp.cli.experiment_plan import read_plan
from lilgym_mp.cli.experiment_runs import FINISHED
from lilgym_mp.evaluation.files import write_json
from tests.command_line import error_of, lilgym, output_of
from tests.scripts import ROOT

TEXT = 'configurations = ["TowerScratch"]\nseeds = [0, 1]\n[[learners]]\nlearner = "ppo"\nsteps = 64\n'


def one_process():
    """What the command uses of Ray, in this process: a task runs when its result is fetched."""
    ray = Mock()
    ray.remote.return_value = lambda function: SimpleNamespace(remote=lambda words, threads: (function, words[-1]))
    ray.wait = lambda pending: (pending[-1:], pending[:-1])
    ray.get = lambda task: task[0](task[1])
    return ray


@pytest.fixture
def command(tmp_path):
    """An experiment of two runs on Ray; an address can follow."""
    (tmp_path / "own.toml").write_text(TEXT)
    return f"experiment {tmp_path / 'own.toml'} --out {tmp_path / 'out'} --jobs 2 --ray"


def test_ray__executes_unfinished_runs_and_continues_after_a_lost_node(command, tmp_path, monkeypatch, capsys):
    results = tmp_path / "out"
    plan = {planned.name: planned for planned in read_plan(tmp_path / "own.toml")}
    first, second = plan
    lost, executed = {second}, list[str]()
    ray = one_process()
    monkeypatch.setitem(sys.modules, "ray", ray)

    def run(name):
        if name in lost:
            lost.remove(name)
            raise ConnectionError("node lost")
        executed.append(name)
        write_json(results / FINISHED / f"{name}.json", {"commands": [list(words) for words in plan[name].commands]})
        return 0

    monkeypatch.setattr(experiment_ray, "_run", run)
    assert lilgym(f"{command} 10.0.0.1:6379") == 1
    printed = capsys.readouterr().out
    assert f"failed: {second}: ConnectionError: node lost" in printed
    assert "1 of 2 runs finished" in printed
    ray.init.assert_called_once_with(address="10.0.0.1:6379", log_to_driver=False)
    assert "2 of 2 runs finished" in output_of(capsys, command)
    assert executed == [first, second]
    assert [name for name, *_ in ray.mock_calls] == ["init", "remote", "shutdown"] * 2


def test_ray__missing_is_one_line_that_names_the_extra(command, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "ray", None)
    assert 'needs Ray: pip install "' in error_of(capsys, command)


@pytest.mark.parametrize(("address", "shown"), [("", "on this machine"), ("10.0.0.1:6379", "10.0.0.1:6379")])
def test_ray__that_cannot_start_is_one_line(command, monkeypatch, capsys, address, shown):
    init = Mock(side_effect=Exception("The current node timed out during startup."))
    monkeypatch.setitem(sys.modules, "ray", SimpleNamespace(init=init))
    refused = error_of(capsys, f"{command} {address}")
    assert f"--ray {shown}: The current node timed out during startup." in refused


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")  # of Ray
def test_ray__runs_of_a_killed_node_are_finished_by_another(tmp_path):
    pytest.importorskip("ray")
    from ray.cluster_utils import Cluster

    few = "envs = 2\nsame_statement = 1\nrollout = 32\nbatch_size = 16\nepochs = 1\n"
    (tmp_path / "own.toml").write_text(TEXT.replace("steps = 64\n", f"steps = 256\n{few}"))
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    lost = cluster.add_node(num_cpus=1)
    cluster.wait_for_nodes()
    command = f"-m lilgym_mp experiment own.toml --out results --jobs 99 --ray {cluster.address}".split()
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    try:
        with subprocess.Popen([sys.executable, *command], cwd=tmp_path, env=environment, **pipes) as process:
            while len(list((tmp_path / "results" / "runs").glob("*/progress.jsonl"))) < 2 and process.poll() is None:
                time.sleep(0.2)
            cluster.remove_node(lost, allow_graceful=False)
            printed, _ = process.communicate()
    finally:
        cluster.shutdown()
    assert "2 of 2 runs finished" in printed
