"""What runs without the functions that Windows, or macOS, does not have, and on newer versions of NumPy."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
WINDOWS = """
import os, signal, sys
import gymnasium, multiprocessing.reduction, numba, numpy, PIL.Image, rich.console  # these know their platform
NAMES = (
    "posix_fallocate register_at_fork sysconf sched_yield sched_getaffinity memfd_create MFD_CLOEXEC pidfd_open fork"
    " forkpty O_CLOEXEC O_NONBLOCK getuid geteuid getgid nice getloadavg killpg setsid getpgid mkfifo pread pwrite"
    " chown fchmod statvfs wait4 uname posix_spawn sched_setaffinity fchdir getpriority set_blocking"
).split()
for module, names in ((os, NAMES), (signal, "pthread_sigmask SIGKILL SIGALRM SIGHUP SIGUSR1 setitimer".split())):
    for name in names:
        if hasattr(module, name):
            delattr(module, name)
del multiprocessing.reduction.DupFd
for name in "fcntl resource termios pwd grp readline syslog pty tty".split():
    sys.modules[name] = None
"""
MACOS = """
import os
for name in "posix_fallocate memfd_create MFD_CLOEXEC pidfd_open sched_getaffinity sched_setaffinity".split():
    if hasattr(os, name):
        delattr(os, name)
"""
PLAY = """
if __name__ == "__main__":
    import gymnasium as gym
    import numpy as np
    import lilgym_mp
    for id in ("lilgym_mp/TowerFlipIt-v0", "lilgym_mp/ScatterScratch-v0"):
        single = gym.make(id, render_mode="rgb_array")
        single.reset(seed=0)
        single.step(0)
        single.render()
        envs = lilgym_mp.wrappers.action_mask_v0(gym.make_vec(id, num_envs=8))
        envs.reset(seed=0)
        envs.step(np.zeros(8, np.int64))
    print(lilgym_mp.solver.Expert)
    lilgym_mp.cli.make_parser()
    lilgym_mp.corpus.load_tasks({corpus!r}, "tower", "flipit", "train")
"""
SB3 = """
    for backend in ("batched", "dummy"):
        lilgym_mp.sb3.make_vec_env(id, 2, backend).reset()
"""
NO_WORKERS = """
    from lilgym_mp.envs.workers import WorkerError, WorkerVectorEnv
    WorkerVectorEnv(id, 2, num_workers=1).reset(seed=0)
    try:
        WorkerVectorEnv(id, 2, num_workers=2)
    except WorkerError as error:
        print(error)
"""
WORKERS = """
if __name__ == "__main__":
    import numpy as np, gymnasium as gym
    from lilgym_mp.envs.workers import WorkerVectorEnv
    envs = WorkerVectorEnv("lilgym_mp/TowerFlipIt-v0", 4, num_workers=2, start_method="spawn")
    batch = gym.make_vec("lilgym_mp/TowerFlipIt-v0", num_envs=4)
    assert envs.reset(seed=0)[0]["statement"] == batch.reset(seed=0)[0]["statement"]
    for _ in range(3):
        assert np.array_equal(envs.step(np.ones(4, np.int64))[0]["image"], batch.step(np.ones(4, np.int64))[0]["image"])
    envs.close()
    print("stepped")
"""


def run(tmp_path: Path, script: str) -> str:
    path = tmp_path / "script.py"
    path.write_text(f"import sys\nsys.path.insert(0, {str(ROOT)!r})\n{script}")
    finished = subprocess.run([sys.executable, path], capture_output=True, text=True, timeout=300, check=False)
    assert finished.returncode == 0, finished.stderr
    return finished.stdout


def test_without_posix__all_but_workers_run(tmp_path: Path, own_corpus: Path) -> None:
    script = WINDOWS + PLAY.replace("{corpus!r}", repr(str(own_corpus)))
    if find_spec("stable_baselines3") is not None:
        script = f"import stable_baselines3\n{script}{SB3}"
    assert "workers need Linux or macOS; use num_workers=1" in run(tmp_path, script + NO_WORKERS)


def test_without_linux__workers_run_with_spawn(tmp_path: Path) -> None:
    assert run(tmp_path, MACOS + WORKERS) == "stepped\n"
