"""Print the digest of the episodes recorded in a directory, or write docs/results/runs.csv with an experiment's runs.

    python scripts/digest_recordings.py DIR
    python scripts/digest_recordings.py --runs DIR

Rows of runs.csv are known by the names of their runs. Recordings used to contain the phenomena of each statement, so
the digest is computed as if they still did.
"""

import argparse
import gzip
import hashlib
import json
from pathlib import Path
from typing import Any

from write_result_tables import read, write

from lilgym_mp.cli.experiment_runs import EPISODES, FINISHED, RUNS
from lilgym_mp.contrib.report.phenomena import RULES, phenomena
from lilgym_mp.evaluation.files import SUFFIX
from lilgym_mp.learning.common.run_directory import PROGRESS_FILE, RUN_FILE, VALIDATIONS_FILE


def digest(directory: Path) -> str:
    """The first digits of the SHA-256 of all episodes, without the headers."""
    found = hashlib.sha256()
    for file in sorted(directory.glob(f"*{SUFFIX}")):
        _, *lines = gzip.decompress(file.read_bytes()).decode().splitlines()
        for line in lines:
            shown = phenomena(json.loads(line)["program"])
            names = json.dumps([name for name in RULES if name in shown], separators=(",", ":"))
            if '"phenomena":' not in line:
                line = line.replace(',"tags":', f',"phenomena":{names},"tags":', 1)
            found.update(line.encode() + b"\n")
    return found.hexdigest()[:12]


def write_runs(directory: Path) -> None:
    """Writes commit, CPU minutes, budget and digest of an experiment's finished runs in place of those in runs.csv."""
    (*head,), *rows = read("runs")
    for row in rows:
        if (directory / FINISHED / f"{row[1]}.json").is_file():
            run, recordings = directory / RUNS / row[1], directory / EPISODES / row[1]
            made, progress = json.loads((run / RUN_FILE).read_text())["made"], last_line(run / PROGRESS_FILE)
            count = last_line(run / VALIDATIONS_FILE).get("best_steps") or progress.get("steps") or progress["updates"]
            commit, _, changes = made["commit"].partition(" ")
            row[2:4] = f"{commit[:7]} {changes}".strip(), f"{progress['cpu_seconds'] / 60:.1f}"
            row[4] = f"{count / 1e6:.2f} million" if count >= 100_000 else f"{count:,}"
            row[5] = digest(recordings) if recordings.is_dir() else ""
    write("runs", [head, *rows])


def last_line(file: Path) -> dict[str, Any]:
    return json.loads(file.read_text().splitlines()[-1]) if file.is_file() else {}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", action="store_true", help="DIR is a results directory of an experiment")
    parser.add_argument("directory", metavar="DIR", type=Path)
    args = parser.parse_args()
    write_runs(args.directory) if args.runs else print(digest(args.directory))
