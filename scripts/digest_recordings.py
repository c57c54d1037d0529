"""Print the digest of a run's evaluation, as docs/results/runs.csv lists it.

    python scripts/digest_recordings.py DIR
    python scripts/digest_recordings.py results/episodes/joint-TowerFlipIt-0-dev.csv

DIR has recordings of episodes; the file is the table of an evaluation of the two-agent game, in which agents are
identified by the names of their runs. Recordings used to contain the phenomena of each statement, so the digest is
computed as if they still did.
"""

import gzip
import hashlib
import json
import re
import sys
from pathlib import Path

from lilgym_mp.contrib.report.phenomena import RULES, phenomena
from lilgym_mp.evaluation.files import SUFFIX


def digest(path: Path) -> str:
    """The first digits of the SHA-256 of all episodes, without the headers, or of a table of games."""
    found = hashlib.sha256()
    if path.is_file():
        return hashlib.sha256(re.sub("[^,\n]*/", "", path.read_text()).encode()).hexdigest()[:12]
    recordings = [gzip.decompress(file.read_bytes()).decode().splitlines() for file in path.glob(f"*{SUFFIX}")]
    for _, *lines in sorted(recordings, key=_kind):  # names of files can be shortened
        for line in lines:
            shown = phenomena(json.loads(line)["program"])
            names = json.dumps([name for name in RULES if name in shown], separators=(",", ":"))
            if '"phenomena":' not in line:
                line = line.replace(',"tags":', f',"phenomena":{names},"tags":', 1)
            found.update(line.encode() + b"\n")
    return found.hexdigest()[:12]


def _kind(recording: list[str]) -> tuple[str, str, str]:
    header = json.loads(recording[0])
    return header["agent"], header["actions"], header["settings"]["configuration"]


if __name__ == "__main__":
    print(digest(Path(sys.argv[1])))
