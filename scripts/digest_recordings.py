"""Print the digest of the episodes recorded in a directory, as docs/results/runs.csv lists it.

    python scripts/digest_recordings.py DIR

Recordings used to contain the phenomena of each statement, so the digest is computed as if they still did.
"""

import gzip
import hashlib
import json
import sys
from pathlib import Path

from lilgym_mp.contrib.report.phenomena import RULES, phenomena
from lilgym_mp.evaluation.files import SUFFIX


def digest(directory: Path) -> str:
    """The first digits of the SHA-256 of all episodes, without the headers."""
    found = hashlib.sha256()
    recordings = [gzip.decompress(file.read_bytes()).decode().splitlines() for file in directory.glob(f"*{SUFFIX}")]
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
