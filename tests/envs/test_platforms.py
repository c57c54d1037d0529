"""What Windows or macOS lacks is used only where the system is asked for it, and there is a way without it."""

import re
from contextlib import closing
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import lilgym_mp
from lilgym_mp.envs import processes, shared_memory
from lilgym_mp.envs.workers import WorkerError, WorkerVectorEnv
from lilgym_mp.testing import assert_same

PACKAGE = Path(lilgym_mp.__file__).parent
TOWER = "lilgym_mp/TowerFlipIt-v0"
# Modules, and functions and constants of `os` and `signal`
POSIX = """
posix_fallocate register_at_fork sysconf sched_yield sched_getaffinity memfd_create MFD_CLOEXEC pidfd_open fork forkpty
O_CLOEXEC O_NONBLOCK getuid geteuid getgid nice getloadavg killpg setsid getpgid mkfifo pread pwrite chown fchmod
statvfs wait4 uname posix_spawn sched_setaffinity fchdir getpriority set_blocking pthread_sigmask SIGKILL SIGALRM SIGHUP
SIGUSR1 setitimer fcntl resource termios pwd grp readline syslog pty tty
"""
ASKED_FOR = {
    ("cli/play.py", "readline"),
    ("envs/machine.py", "sched_getaffinity"),
    ("envs/processes.py", "pthread_sigmask"),
    ("envs/shared_memory.py", "memfd_create"),
    ("envs/shared_memory.py", "sysconf"),
    ("envs/workers.py", "register_at_fork"),
    ("evaluation/files.py", "fcntl"),
}


def test_posix_functions__are_used_only_where_the_system_is_asked_for_them():
    used = {
        (path.relative_to(PACKAGE).as_posix(), name)
        for path in PACKAGE.rglob("*.py")
        for name in re.findall(r"(?:\bos\.|\bsignal\.|^ *import |^ *from )(\w+)", path.read_text(), re.MULTILINE)
    }
    assert {(path, name) for path, name in used if name in POSIX.split()} == ASKED_FOR


def test_without_posix__workers_are_refused_but_one_process_plays(monkeypatch):
    monkeypatch.setattr(processes, "HAS_POSIX", False)
    with pytest.raises(WorkerError, match="workers need Linux or macOS; use num_workers=1"):
        WorkerVectorEnv(TOWER, 2, num_workers=2)
    WorkerVectorEnv(TOWER, 2, num_workers=1).reset(seed=0)


@pytest.mark.filterwarnings("default:This process.*is multi-threaded:DeprecationWarning")
@pytest.mark.parametrize("start_method", ["fork", pytest.param("spawn", marks=pytest.mark.long)])
def test_without_memfd__workers_share_a_temporary_file(start_method, monkeypatch):
    monkeypatch.setattr(shared_memory, "HAS_MEMFD", False)
    batch = gym.make_vec(TOWER, num_envs=4)
    with closing(WorkerVectorEnv(TOWER, 4, num_workers=2, start_method=start_method)) as envs:
        assert_same(envs.reset(seed=0), batch.reset(seed=0))
        assert_same(envs.step(np.ones(4, np.int64)), batch.step(np.ones(4, np.int64)))
