"""How workers end: with their environment, with their caller, and with whatever goes wrong while they are started."""

import gc
import multiprocessing
import os
import re
import signal
import subprocess
import sys
from functools import partial
from multiprocessing.popen_fork import Popen

import numpy as np
import pytest

from lilgym_mp.envs.workers import WorkerError, WorkerVectorEnv
from lilgym_mp.testing import assert_same
from tests.command_line import python
from tests.envs.test_workers import SCATTER, TOWER, assert_gone, is_running
from tests.stress.program_language import run_limited

pytestmark = pytest.mark.filterwarnings("default:This process.*is multi-threaded:DeprecationWarning")

LONG_STARTS = [pytest.param(method, marks=pytest.mark.long) for method in ("forkserver", "spawn")]
LONG_INTERRUPTS = [("fork", 0.1), ("spawn", 0.2), ("spawn", 0.8)]
THREADS = f"""
import threading
from lilgym_mp.envs.workers import WorkerVectorEnv

made = []
def make():
    env = WorkerVectorEnv({SCATTER!r}, 18, 2, start_method="fork", timeout_seconds=120)
    env.reset(seed=0)
    made.append(env)

threads = [threading.Thread(target=make) for _ in range(2)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
for env in made:
    env.close()
print(len(made))
"""
FORKS = f"""
import os, signal, time
from lilgym_mp.envs.workers import WorkerVectorEnv

env = WorkerVectorEnv({TOWER!r}, 4, 3, start_method="fork")
env.reset(seed=0)
child = os.fork()  # which has every descriptor of its parent's
if not child:
    time.sleep(60)
print(child, *env.worker_pids, flush=True)
time.sleep(60)
"""
INTERRUPTED_START = """
import os, signal, sys, threading, time
import lilgym_mp.envs.workers as workers

if __name__ == "__main__":
    signal.signal(signal.SIGALRM, lambda *_: os.killpg(0, signal.SIGINT))
    signal.setitimer(signal.ITIMER_REAL, float(sys.argv[2]))
    workers.WorkerVectorEnv("lilgym_mp/TowerScratch-v0", 4, 3, start_method=sys.argv[1])
    time.sleep(30)
"""


def make(id=TOWER, **settings):
    env = WorkerVectorEnv(id, 6, 3, **{"start_method": "fork", "timeout_seconds": 5.0, **settings})
    env.reset(seed=0)
    return env


def descriptors():
    return len(os.listdir("/proc/self/fd"))


@pytest.mark.parametrize("start_method", ["fork", *LONG_STARTS])
def test_an_environment_that_is_closed_or_dropped__leaves_no_process_and_no_descriptor(start_method):
    make(start_method=start_method).close()  # what Python keeps open for processes is open from here on
    before = descriptors()
    make(start_method=start_method).close()
    assert descriptors() == before
    env = make(start_method=start_method)
    pids = env.worker_pids
    del env
    gc.collect()
    assert_gone(pids)
    assert descriptors() == before


@pytest.mark.parametrize("start_method", ["fork", *LONG_STARTS])
def test_workers__exit_if_their_pipe_is_closed(start_method):
    env = make(start_method=start_method)
    pids = env.worker_pids
    env._finalizer.detach()  # nothing tells them to end
    del env
    gc.collect()
    assert_gone(pids)


@pytest.mark.long
def test_threads__may_each_start_workers_at_the_same_time():
    done = python("-W", "ignore", "-c", THREADS, timeout=600)
    assert (done.stdout.strip(), done.returncode) == ("2", 0), done.stderr


def test_a_fork_of_the_caller__does_not_keep_workers_alive():
    with subprocess.Popen([sys.executable, "-c", FORKS], stdout=subprocess.PIPE, text=True) as caller:
        child, *pids = map(int, caller.stdout.readline().split())
        try:
            caller.kill()
            assert_gone(tuple(pids))
            assert is_running(child)
        finally:
            os.kill(child, signal.SIGKILL)


def test_a_fork_of_the_caller__cannot_harm_the_environment():
    ours, theirs = make(), make()
    stops = np.zeros(6, np.int64)
    for use in (partial(ours.step, stops), ours.reset, ours.states, ours.action_masks):
        assert run_limited(use).startswith("ClosedEnvironmentError: this environment belongs to process"), use
    for use in (ours.close, ours._finalizer):
        assert run_limited(use) is None
    assert all(map(is_running, ours.worker_pids))
    assert_same(ours.step(stops), theirs.step(stops))
    ours.close()
    theirs.close()


@pytest.mark.parametrize("moment", ["before it is known", "after its start"])
def test_an_interrupt_while_workers_are_started__leaves_none(monkeypatch, moment):
    pids = []

    def interrupted(self, process):
        launch(self, process)
        pids.append(self.pid)
        if len(pids) == 2 and moment == "before it is known":
            raise KeyboardInterrupt

    def started(self):
        start(self)
        if len(pids) == 2:
            raise KeyboardInterrupt

    process = multiprocessing.get_context("fork").Process
    launch, start = Popen._launch, process.start
    monkeypatch.setattr(Popen, "_launch", interrupted)
    monkeypatch.setattr(process, "start", started)
    before = descriptors()
    with pytest.raises(KeyboardInterrupt):
        make()
    gc.collect()
    assert len(pids) == 2
    assert_gone(tuple(pids))
    if moment == "after its start":
        assert descriptors() == before


@pytest.mark.parametrize(
    ("start_method", "seconds"),
    [("fork", 0.4), *(pytest.param(*each, marks=pytest.mark.long) for each in LONG_INTERRUPTS)],
)
def test_an_interrupt_while_workers_are_started__prints_no_traceback_of_theirs(start_method, seconds):
    done = python("-c", INTERRUPTED_START, start_method, str(seconds), timeout=60, start_new_session=True)
    assert "KeyboardInterrupt" in done.stderr
    # What shows that a line is a worker's; this process's own traceback may quote a line that names spawn_main, or
    # end in a named tuple's lambda, of line 1 of a text too.
    theirs = r'^Process \w|, in spawn_main|"<string>", line 1, in <module>|forkserver'
    cut_short = "EOFError: Ran out of input" in done.stderr  # while it was told what to do: docs/reliability.md
    assert (start_method == "spawn" and cut_short) or not re.search(theirs, done.stderr, re.MULTILINE), done.stderr


def test_a_daemonic_process__cannot_start_workers(monkeypatch):
    monkeypatch.setitem(multiprocessing.current_process()._config, "daemon", True)
    with pytest.raises(WorkerError, match="a daemonic process cannot start workers"):
        WorkerVectorEnv(TOWER, 128, 2)
    assert WorkerVectorEnv(TOWER, 128, "auto").num_workers == 1
