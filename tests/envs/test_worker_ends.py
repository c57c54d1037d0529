"""How workers end: with their environment, with their caller, and with whatever goes wrong while they are started."""

from __future__ import annotations

import gc
import multiprocessing
import os
import re
import signal
import subprocess
import sys
from multiprocessing.connection import Connection
from multiprocessing.popen_fork import Popen

import numpy as np
import pytest

from lilgym_mp.envs.workers import WorkerVectorEnv
from tests.envs.test_workers import SCATTER, TOWER, assert_gone, is_running

pytestmark = pytest.mark.filterwarnings("default:This process.*is multi-threaded:DeprecationWarning")

LONG_STARTS = [pytest.param(method, marks=pytest.mark.long) for method in ("forkserver", "spawn")]
LONG_INTERRUPTS = [("fork", 0.1), ("fork", 0.8), ("spawn", 0.1), ("spawn", 0.4), ("spawn", 0.8)]
THREADS = f"""
import threading
from lilgym_mp.envs.workers import WorkerVectorEnv

made = []
def make():
    env = WorkerVectorEnv({SCATTER!r}, 18, 2, start_method="fork", timeout_seconds=120)
    env.reset(seed=0)
    made.append(env)

threads = [threading.Thread(target=make) for _ in range(4)]
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


def make(id: str = TOWER, **settings: object) -> WorkerVectorEnv:
    env = WorkerVectorEnv(id, 6, 3, **{"start_method": "fork", "timeout_seconds": 5.0, **settings})
    env.reset(seed=0)
    return env


def descriptors() -> int:
    return len(os.listdir("/proc/self/fd"))


@pytest.mark.parametrize("start_method", ["fork", *LONG_STARTS])
def test_an_environment_that_is_dropped__leaves_no_process_and_no_descriptor(start_method: str) -> None:
    make(start_method=start_method).close()  # what Python keeps open for processes is open from here on
    before = descriptors()
    env = make(start_method=start_method)
    pids = env.worker_pids
    del env
    gc.collect()
    assert_gone(pids)
    assert descriptors() == before


@pytest.mark.parametrize("start_method", ["fork", *LONG_STARTS])
def test_workers__exit_if_their_pipe_is_closed(start_method: str) -> None:
    env = make(start_method=start_method)
    pids = env.worker_pids
    env._finalizer.detach()  # nothing tells them to end
    del env
    gc.collect()
    assert_gone(pids)


@pytest.mark.long
def test_threads__may_each_start_workers_at_the_same_time() -> None:
    command = [sys.executable, "-W", "ignore", "-c", THREADS]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert (done.stdout.strip(), done.returncode) == ("4", 0), done.stderr


def test_a_fork_of_the_caller__does_not_keep_workers_alive() -> None:
    with subprocess.Popen([sys.executable, "-c", FORKS], stdout=subprocess.PIPE, text=True) as caller:
        assert caller.stdout is not None
        child, *pids = map(int, caller.stdout.readline().split())
        try:
            caller.kill()
            assert_gone(tuple(pids))
            assert is_running(child)
        finally:
            os.kill(child, signal.SIGKILL)


def _in_fork(env: WorkerVectorEnv, work: str) -> str:
    """What came of using `env` in a forked child: the name and words of the exception."""
    hear, tell = os.pipe()
    child = os.fork()
    if not child:
        said = "nothing"
        try:
            {
                "step": lambda: env.step(np.ones(6, np.int64)),
                "reset": env.reset,
                "states": env.states,
                "masks": env.action_masks,
                "close": env.close,
                "drop": env._finalizer,
            }[work]()
        except BaseException as fault:
            said = f"{type(fault).__name__}: {fault}"
        finally:
            os.write(tell, said.encode())
            os._exit(0)
    os.close(tell)
    os.waitpid(child, 0)
    with open(hear, "rb") as file:
        return file.read().decode()


def test_a_fork_of_the_caller__cannot_harm_the_environment() -> None:
    ours, theirs = make(SCATTER), make(SCATTER)
    for work in ("step", "reset", "states", "masks", "close", "drop"):
        said = _in_fork(ours, work)
        harmless = work in ("close", "drop")
        refused = "ClosedEnvironmentError: this environment belongs to process"
        assert said.startswith("nothing" if harmless else refused), work
        assert all(map(is_running, ours.worker_pids)), work
        for action in (28, 57, 0):
            shown, expected = (env.step(np.full(6, action)) for env in (ours, theirs))
            assert np.array_equal(shown[0]["image"], expected[0]["image"]), work
            assert np.array_equal(shown[1], expected[1]), work
        assert ours.states() == theirs.states(), work
    ours.close()
    theirs.close()


@pytest.mark.parametrize("moment", ["before it is known", "after its start"])
def test_an_interrupt_while_workers_are_started__leaves_none(monkeypatch: pytest.MonkeyPatch, moment: str) -> None:
    pids: list[int] = []

    def interrupted(self: Popen, process: object) -> None:
        launch(self, process)
        pids.append(self.pid)
        if len(pids) == 2 and moment == "before it is known":
            raise KeyboardInterrupt

    def started(self: object) -> None:
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
    [("fork", 0.4), ("spawn", 0.6), *(pytest.param(*each, marks=pytest.mark.long) for each in LONG_INTERRUPTS)],
)
def test_an_interrupt_while_workers_are_started__prints_no_traceback_of_theirs(
    start_method: str, seconds: float
) -> None:
    command = [sys.executable, "-c", INTERRUPTED_START, start_method, str(seconds)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, start_new_session=True)
    assert "KeyboardInterrupt" in done.stderr
    # What shows that a line is a worker's; this process's own traceback may quote a line that names spawn_main, or
    # end in a named tuple's lambda, of line 1 of a text too.
    theirs = r'^Process \w|, in spawn_main|"<string>", line 1, in <module>|forkserver'
    cut_short = "EOFError: Ran out of input" in done.stderr  # while it was told what to do: docs/reliability.md
    assert (start_method == "spawn" and cut_short) or not re.search(theirs, done.stderr, re.MULTILINE), done.stderr


def _make_in_daemon(num_workers: int | str, answers: Connection) -> None:
    try:
        env = WorkerVectorEnv(TOWER, 128, num_workers)
        answers.send(str(env.num_workers))
        env.close()
    except BaseException as fault:
        answers.send(f"{type(fault).__name__}: {fault}")


@pytest.mark.parametrize(("num_workers", "answer"), [(2, "WorkerError: a daemonic process cannot"), ("auto", "1")])
def test_a_daemonic_process__cannot_start_workers(num_workers: int | str, answer: str) -> None:
    answers, theirs = multiprocessing.Pipe(duplex=False)
    context = multiprocessing.get_context("fork")
    daemon = context.Process(target=_make_in_daemon, args=(num_workers, theirs), daemon=True)
    daemon.start()
    assert answers.poll(60)
    assert answers.recv().startswith(answer)
    daemon.join()
