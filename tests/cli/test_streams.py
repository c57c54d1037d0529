"""Closed or full standard streams, Ctrl-C and disk errors cause no traceback."""

import contextlib
import io
import os
import signal
import subprocess
import sys
import time
from argparse import Namespace
from concurrent.futures import ThreadPoolExecutor

import pytest

from lilgym_mp.cli import FAILED, INTERRUPTED, main

CHECK = "explain --program 'exist(all_items)'"
MESSAGES = {
    ">/dev/full": "lilgym-mp explain: cannot write results: No space left on device\n",
    ">&-": "lilgym-mp: standard output is closed; send it to a file or to /dev/null\n",
    "<&- >&- 2>&-": "",
}
RUN = f"{sys.executable} -c 'import sys; from lilgym_mp.cli import main; sys.exit(main())'"


def shell(line):
    return subprocess.run(line, shell=True, capture_output=True, text=True, timeout=120, check=False)


def test_main__runs_on_a_stream_without_reconfigure(monkeypatch):
    written = io.StringIO()
    monkeypatch.setattr(sys, "stdout", written)
    monkeypatch.setattr(sys, "argv", ["lilgym-mp", "explain", "--program", "exist(all_items)"])
    with ThreadPoolExecutor() as threads:  # signals are for the main thread alone
        assert threads.submit(main).result() == 0
    assert "all_items" in written.getvalue()


@pytest.mark.parametrize(
    ("words", "redirection"), [(CHECK, ">/dev/full"), (CHECK, ">&-"), (CHECK, "<&- >&- 2>&-"), ("trian", "2>&-")]
)
def test_streams__closed_or_full_give_no_traceback(words, redirection):
    done = shell(f"{RUN} {words} {redirection}")
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr
    assert done.returncode in (0, 1, 2), done
    if redirection in MESSAGES:
        assert (done.returncode, done.stderr) == (FAILED, MESSAGES[redirection])


def test_interrupt__converted_by_a_library_is_still_reported_as_interrupt(monkeypatch, capsys):
    def interrupted(*words):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as interrupt:
            raise RuntimeError("half imported") from interrupt

    monkeypatch.setattr("lilgym_mp.cli.make_parser", interrupted)
    assert main(["bench"]) == INTERRUPTED
    assert capsys.readouterr().err == "interrupted\n"


@pytest.mark.parametrize(
    ("stop", "seconds"), [(signal.SIGINT, 0.05), pytest.param(signal.SIGTERM, 0.3, marks=pytest.mark.long)]
)
def test_interrupt__soon_after_the_start_prints_one_word(stop, seconds):
    program = "import sys; from lilgym_mp.cli import main; print('begun', flush=True); sys.exit(main())"
    command = [sys.executable, "-c", program, "bench", "--quick"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "begun\n"
        time.sleep(seconds)
        output = _interrupted(process, stop)
    assert process.returncode == INTERRUPTED
    assert "interrupted" in output


def _interrupted(process, stop):
    """What it prints on stderr when interrupted, a few times if need be: llvmlite's callbacks lose an interrupt."""
    for _ in range(5):
        process.send_signal(stop)
        with contextlib.suppress(subprocess.TimeoutExpired):
            return process.communicate(timeout=10)[1]
    process.kill()
    return process.communicate()[1]


def test_disk_error__is_reported_in_one_line(tmp_path, monkeypatch, capsys):
    def full(*_):
        raise OSError(28, "No space left on device", str(tmp_path / "file"))

    monkeypatch.setattr("lilgym_mp.cli.parse_args", lambda argv: Namespace(command="test", run=full))
    assert main([]) == FAILED
    assert capsys.readouterr().err == f"lilgym-mp test: {tmp_path / 'file'}: No space left on device\n"


@pytest.mark.parametrize("corpus", ["a" * 5_000_000, "no\x1b[31mwhere"])
def test_odd_names__are_reported_in_one_printable_line(corpus, capsys):
    assert main(["data", "check", corpus]) in (1, 2)
    output = capsys.readouterr()
    assert "\x1b[31m" not in output.out + output.err
    assert len(output.err) < 3_000
    assert output.err.count("\n") == 1
    assert "Traceback" not in output.err


@pytest.mark.skipif(os.geteuid() == 0, reason="root can read every directory")
def test_forbidden_directory__is_reported_in_one_line(tmp_path, capsys):
    tmp_path.chmod(0)
    try:
        assert main(["data", "check", str(tmp_path)]) in (1, 2)
    finally:
        tmp_path.chmod(0o700)
    assert "Traceback" not in capsys.readouterr().err
