"""Adds the digests of the installed corpora's dev and test statements to data/held_out_statements.txt.

Training excludes these statements from generated ones. The file's first line says which splits it covers; digests
added before are kept, so the splits of several machines can be collected.
"""

from __future__ import annotations

import re
from pathlib import Path

from lilgym_mp.corpus import CorpusError, load_all_tasks
from lilgym_mp.corpus.held_out import FILE, SPLITS, statement_digest

TARGET = Path(__file__).resolve().parent.parent / "data" / FILE


def main() -> None:
    before = TARGET.read_text(encoding="ascii") if TARGET.exists() else ""
    covered = set(re.findall(r"(?:builtin|lilgym) (?:dev|test)", before.partition("\n")[0]))
    digests = {line for line in before.splitlines() if not line.startswith("#")}
    for corpus in ("builtin", "lilgym"):
        try:
            task_sets = list(load_all_tasks(corpus, splits=SPLITS))
        except CorpusError as error:
            print(f"skipped {corpus}: {error}")
            continue
        covered |= {f"{corpus} {tasks.provenance.split}" for tasks in task_sets}
        digests |= {statement_digest(task.statement) for tasks in task_sets for task in tasks}
    lines = [f"# Digests of statements held out from training: {', '.join(sorted(covered))}", *sorted(digests)]
    TARGET.write_text("".join(f"{line}\n" for line in lines), encoding="ascii")
    print(f"{TARGET}: {len(digests)} statements of {', '.join(sorted(covered))}")


if __name__ == "__main__":
    main()
