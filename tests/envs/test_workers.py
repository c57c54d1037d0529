import os
import signal
import subprocess
import sys
import time
from contextlib import closing, suppress
from functools import partial
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from lilgym_mp.envs import shared_memory
from lilgym_mp.envs.engine import Engine, ResetRequest
from lilgym_mp.envs.machine import usable_cores
from lilgym_mp.envs.processes import checked_worker_count
from lilgym_mp.envs.shared_memory import SharedMemory, SharedMemoryError
from lilgym_mp.envs.workers import WorkerError, WorkerVectorEnv
from lilgym_mp.testing import assert_same
from tests.command_line import python

TOWER, SCATTER = "lilgym_mp/TowerFlipIt-v0", "lilgym_mp/ScatterFlipIt-v0"
STARTED = ("forkserver", "spawn")  # start methods of new interpreters
LOOP = """
import signal
import sys
import numpy as np
from lilgym_mp.envs.workers import WorkerVectorEnv

if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    env = WorkerVectorEnv("lilgym_mp/TowerScratch-v0", 6, 3, start_method=sys.argv[1])
    env.reset(seed=0)
    print(*env.worker_pids, flush=True)
    while sys.argv[2] == "forever":
        env.step(np.zeros(6, np.int64))
    raise OSError("the caller's own trouble")
"""

pytestmark = pytest.mark.filterwarnings("default:This process.*is multi-threaded:DeprecationWarning")


def shared_files():
    """Files of shared memory, without semaphores, of which workers have none."""
    return {name for name in os.listdir("/dev/shm") if not name.startswith("sem.")}


def is_running(pid):
    """False for a process that has ended, be it still in the table."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


def assert_gone(pids, seconds=10.0):
    end = time.monotonic() + seconds
    while any(map(is_running, pids)) and time.monotonic() < end:
        time.sleep(0.02)
    assert not [pid for pid in pids if is_running(pid)]


def step_on(env):
    """A few steps: a worker may die just after it has carried out one."""
    for _ in range(3):
        env.step(np.zeros(env.num_envs, np.int64))


@pytest.fixture(scope="module")
def compiled():
    """Loads compiled code before workers are forked: on a busy machine that takes longer than a timeout of theirs."""
    env = gym.make_vec(SCATTER, num_envs=8)
    env.reset(seed=0)
    env.step(np.zeros(8, np.int64))
    env.close()


@pytest.fixture
def workers(compiled):
    env = WorkerVectorEnv(SCATTER, 8, 3, start_method="fork", timeout_seconds=2.0)
    env.reset(seed=0)
    env.step(np.zeros(8, np.int64))
    yield env
    env.close()


@pytest.mark.parametrize("copied", [True, False])
def test_workers__show_scenes_and_tasks_as_one_batch_does(copied):
    theirs = gym.make_vec(SCATTER, num_envs=5, copy=copied)
    with closing(WorkerVectorEnv(SCATTER, 5, 2, start_method="fork", copy=copied)) as ours:
        assert_same(ours.reset(seed=5), theirs.reset(seed=5))
        for actions in np.arange(20).reshape(4, 5):
            assert_same(ours.step(actions), theirs.step(actions))
            assert_same(ours.scene_array(), theirs.scene_array())
            assert_same(ours.task_indices, theirs.task_indices)


def test_copies__any_number_and_views_of_them_can_be_kept():
    kept = []  # every second a view of an image that nobody else holds
    with closing(WorkerVectorEnv(SCATTER, 4, 2, start_method="fork")) as env:
        first = env.reset(seed=0)[0]["image"]
        copies = []
        for step in range(8):
            image = env.step(np.full(4, 28 * step + 28))[0]["image"]
            kept.append(image if step % 2 else image[1:][:2, 5:])
            copies.append(kept[-1].copy())
        first[:] = 7
        assert not (env.step(np.ones(4, np.int64))[0]["image"] == 7).any()
    assert_same(kept, copies)


@pytest.mark.parametrize("start_method", ["fork", *(pytest.param(each, marks=pytest.mark.long) for each in STARTED)])
def test_a_worker_that_dies__is_named_with_its_signal(start_method):
    env = WorkerVectorEnv(TOWER, 6, 3, start_method=start_method)
    env.reset(seed=0)
    pids = env.worker_pids
    os.kill(pids[1], signal.SIGKILL)
    with pytest.raises(WorkerError, match=r"worker 2 \(environments 4 to 5\) died by signal SIGKILL"):
        step_on(env)
    assert_gone(pids)
    with pytest.raises(gym.error.ClosedEnvironmentError, match="make a new one"):
        env.step(np.zeros(6, np.int64))


@pytest.mark.long
def test_a_worker_that_hangs__is_named_after_the_timeout(workers):
    pids = workers.worker_pids
    os.kill(pids[0], signal.SIGSTOP)
    begun = time.monotonic()
    with pytest.raises(WorkerError, match="worker 1 has not responded for 2 seconds"):
        workers.step(np.zeros(8, np.int64))
    assert time.monotonic() - begun < 10
    assert_gone(pids)


def test_a_worker_that_raises__passes_on_its_traceback(workers):
    pids, no_such_task = workers.worker_pids, len(workers._indexed)
    with pytest.raises(WorkerError, match=r"(?s)worker 2 raised:.*Traceback.*IndexError"):
        workers._everywhere(Engine.reset, ResetRequest(np.arange(8), [0] * 8, [0] * 7 + [no_such_task], True))
    assert_gone(pids)


def test_an_interrupt_in_the_caller__ends_the_workers(workers):
    def interrupted(env_ids):
        raise KeyboardInterrupt

    workers._engine.core.step = interrupted
    pids = workers.worker_pids
    with pytest.raises(KeyboardInterrupt):
        workers.step(np.zeros(8, np.int64))
    assert_gone(pids)


@pytest.mark.parametrize(
    ("how", "start_method"),
    [
        ("Ctrl-C", "fork"),
        ("SIGTERM", "fork"),
        ("exception", "fork"),
        pytest.param("killed", "spawn", marks=pytest.mark.long),
        pytest.param("Ctrl-C", "forkserver", marks=pytest.mark.long),
    ],
)
def test_a_caller_that_ends__leaves_no_process_and_no_memory(tmp_path, how, start_method):
    script = tmp_path / "loop.py"
    script.write_text(LOOP)
    before = shared_files()
    command = [sys.executable, script, start_method, "once" if how == "exception" else "forever"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as caller:
        try:
            pids = tuple(map(int, caller.stdout.readline().split()))
            assert len(pids) == 2
            if how == "Ctrl-C":
                os.killpg(caller.pid, signal.SIGINT)
            elif how == "SIGTERM":
                os.killpg(caller.pid, signal.SIGTERM)
            elif how == "killed":
                caller.kill()
            _, complaint = caller.communicate(timeout=60)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(caller.pid, signal.SIGKILL)
    assert_gone(pids)
    assert shared_files() <= before
    assert "lilgym_mp worker" not in complaint  # no traceback of a worker
    if how != "killed":
        assert complaint.strip().splitlines()[-1].startswith("OSError" if how == "exception" else "KeyboardInterrupt")


@pytest.mark.long
def test_workers__work_in_an_interactive_session():
    session = f"""
from lilgym_mp.envs.workers import WorkerVectorEnv
env = WorkerVectorEnv({TOWER!r}, 4, 2, start_method="spawn")
env.reset(seed=0)[0]["image"].shape
env.close()
"""
    done = python("-i", input=session, timeout=60)
    assert "(4, 50, 190, 3)" in done.stdout, done.stderr


def test_memory__more_than_the_machine_has_is_refused():
    with pytest.raises(SharedMemoryError, match=r"MB: this machine has [\d,.]+ MB of memory"):
        WorkerVectorEnv(TOWER, 50_000_000, 2)


def test_memory__on_a_full_disk_is_refused(monkeypatch):
    monkeypatch.setattr(shared_memory, "HAS_MEMFD", False)
    monkeypatch.setattr(shared_memory.tempfile, "TemporaryFile", partial(open, "/dev/full", "r+b"))
    descriptors = len(os.listdir("/proc/self/fd"))
    with pytest.raises(SharedMemoryError, match=r"file of 1\.0 MB to share: No space left on device"):
        SharedMemory(1_000_000)
    assert len(os.listdir("/proc/self/fd")) == descriptors


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"num_workers": "two"}, "'auto' or a positive whole number, not 'two'"),
        ({"num_workers": 5}, "5 workers for 4 environments"),
        ({"start_method": "thread"}, "'thread'; choose from fork, forkserver, spawn"),
        ({"timeout_seconds": 0}, "positive number, not 0"),
    ],
)
def test_make__names_the_value_and_the_choices(settings, message):
    with pytest.raises(ValueError, match=message):
        WorkerVectorEnv(**{"id": TOWER, "num_envs": 4, "num_workers": 2, **settings})


def test_auto__uses_one_process_for_few_environments():
    assert checked_worker_count("auto", 1) == 1
    assert checked_worker_count("auto", 64) == 1
    assert checked_worker_count("auto", 100_000) == usable_cores()


def test_close__after_a_failed_constructor_does_nothing():
    """Gymnasium before 1.3 closes whatever is collected."""
    env = WorkerVectorEnv.__new__(WorkerVectorEnv)
    with pytest.raises(ValueError, match="'tran'"):
        WorkerVectorEnv.__init__(env, TOWER, 2, split="tran")
    env.close()
