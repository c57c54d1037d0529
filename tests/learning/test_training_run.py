"""Training runs: stop signals, a full disk, and checkpoints that are not ours."""

import fcntl
import os
import pickle
import random
import resource
import signal
from contextlib import suppress

import pytest
import torch

from lilgym_mp.cli import FAILED
from lilgym_mp.cli.training import _board
from lilgym_mp.evaluation.files import LOCK_FILE, OutputError, locked
from lilgym_mp.learning.common.run import stop_on_signals
from lilgym_mp.learning.common.run_directory import CHECKPOINT_FILE, TrainingRunError, begin_run
from tests.command_line import lilgym
from tests.learning.conftest import Trap


@pytest.fixture
def full_disk():
    """Files of more than 20 kB cannot be written."""
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    signal.signal(signal.SIGXFSZ, handler)


def test_checkpoint__that_does_not_fit_leaves_the_old_one(tmp_path, full_disk):
    run = begin_run(tmp_path, {})
    run.save_checkpoint({"step": 1})
    with pytest.raises(OSError, match="File too large") as error:
        run.save_checkpoint({"weights": torch.zeros(10_000)})
    assert error.value.filename == str(tmp_path / CHECKPOINT_FILE)
    with run.checkpoint() as state:
        assert state == {"step": 1}
    assert sorted(os.listdir(tmp_path)) == [CHECKPOINT_FILE, "run.json"]


@pytest.mark.long
def test_training__on_a_full_disk_prints_one_line(tmp_path, full_disk, capsys):
    out = tmp_path / "run"
    small = "--envs 2 --same-statement 1 --rollout 32 --batch-size 16 --epochs 1"
    assert lilgym(f"train ppo TowerScratch --no-recolour --steps 1 {small} --out", out) == FAILED
    assert capsys.readouterr().err.splitlines()[-1] == f"lilgym-mp train: {out / CHECKPOINT_FILE}: File too large"


@pytest.mark.parametrize("protocol", [0, pickle.HIGHEST_PROTOCOL])
@pytest.mark.parametrize("by_torch", [False, True])
def test_checkpoint__pickled_objects_are_never_built(by_torch, protocol, tmp_path):
    run, opened = begin_run(tmp_path / "run", {}), tmp_path / "opened"
    path = run.path / CHECKPOINT_FILE
    if by_torch:
        torch.save({"trap": Trap(opened)}, path, pickle_protocol=max(2, protocol))
    else:
        path.write_bytes(pickle.dumps(Trap(opened), protocol))
    with pytest.raises(TrainingRunError, match="damaged, or not a checkpoint of this run"), run.checkpoint():
        pass
    assert not opened.exists()


def test_checkpoint__damage_of_any_kind_is_one_error(tmp_path):
    run, rng = begin_run(tmp_path, {}), random.Random(0)
    run.save_checkpoint({"weights": {"a": torch.zeros(3)}, "step": 3, "text": "abc", "numbers": [1, 2.5]})
    path = run.path / CHECKPOINT_FILE
    whole, loaded = path.read_bytes(), 0
    for _ in range(200):
        damaged = bytearray(whole)
        for _ in range(rng.choice([1, 2, 5, 40])):
            damaged[rng.randrange(len(whole))] = rng.randrange(256)
        path.write_bytes(damaged)
        with suppress(TrainingRunError), run.checkpoint():  # any other error fails the test
            loaded += 1
    assert loaded < 120


def test_run__is_trained_by_one_process_at_a_time(tmp_path):
    with locked(tmp_path):
        with pytest.raises(OutputError, match=f"in use by process {os.getpid()}"), locked(tmp_path):
            pass
        assert (tmp_path / LOCK_FILE).read_text() == str(os.getpid())
    with locked(tmp_path):
        pass
    assert not (tmp_path / LOCK_FILE).exists()


def test_run__is_locked_anew_if_the_last_owner_ends_meanwhile(tmp_path, monkeypatch):
    path = tmp_path / LOCK_FILE

    def lock_too_late(*how):
        path.unlink()
        monkeypatch.undo()
        fcntl.flock(*how)

    monkeypatch.setattr(fcntl, "flock", lock_too_late)
    with locked(tmp_path):
        assert path.read_text() == str(os.getpid())
        with pytest.raises(OutputError, match="in use by process"), locked(tmp_path):
            pass


def test_run__the_lock_of_a_killed_process_is_free(tmp_path):
    child = os.fork()
    if child == 0:
        with locked(tmp_path):
            os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)
    assert (tmp_path / LOCK_FILE).exists()
    with locked(tmp_path):
        pass


@pytest.mark.parametrize("first", [[signal.SIGINT], [signal.SIGTERM] * 3])
def test_stop__first_signal_requests_and_second_ctrl_c_interrupts_until_the_old_handlers_are_back(first):
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with stop_on_signals() as stop:
        for one in first:
            signal.raise_signal(one)
        assert stop.requested
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


def test_tensorboard__of_a_resumed_run_discards_what_came_after_the_checkpoint(tmp_path):
    (tmp_path / "progress.jsonl").write_text('{"steps": 32}\n{"steps": 64}\n')  # the second is being reported
    opened = []
    for unit in ("steps", None):
        _board(lambda path, purge_step: opened.append(purge_step), tmp_path, unit)
    assert opened == [33, None]
