"""Pairs of agents in the two-agent game: a matrix of success."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from lilgym_mp.contrib.report.aggregation import MeanStd
from lilgym_mp.contrib.report.items import Item, table
from lilgym_mp.evaluation.game_partners import SCRIPTED_VERIFIERS
from lilgym_mp.learning.common.run_directory import AGENT_FILE, RUN_FILE, begin_run
from lilgym_mp.scene.arrays import AnyMapping
from lilgym_mp.scene.grouping import grouped

Result = AnyMapping  # of a pair, as `lilgym-mp evaluate --out` writes it
SHARED = ("configuration", "protocol", "split", "corpus", "actions", "messages")  # by all pairs of a matrix
NOTE = (
    "Rows: proposers; columns: verifiers. Brackets: 95 % intervals; statements are resampled with all of their games."
)


def game_runs(paths: Iterable[Path]) -> list[Path]:
    """The runs of `train game` with a trained agent in these directories."""
    files = sorted({file for path in paths for file in path.rglob(AGENT_FILE) if file.with_name(RUN_FILE).exists()})
    runs = (begin_run(file.parent, {}, resume=True) for file in files)
    return [run.path for run in runs if run.identity.get("learner") == "game"]


def read_results(path: Path) -> list[Result]:
    """The results of games in a JSON file. Raises ValueError for another file."""
    try:
        results = list(json.loads(path.read_text(encoding="utf-8"))["results"])
        list(pairs(results))
    except (OSError, ValueError, KeyError, TypeError):
        raise ValueError(f"{path}: not results of games, which `lilgym-mp evaluate --out` writes") from None
    return results


def is_of_run(result: Result) -> bool:
    """Whether both agents are those of one run, which play as they have learned."""
    name = result["proposer"]
    return name == result["verifier"] and name not in SCRIPTED_VERIFIERS and not result["messages"]


def success(result: Result) -> MeanStd:
    """The share of successes in per cent."""
    low, high = result["success_interval"]
    return MeanStd(100 * result["success"], None, 1, 100 * low, 100 * high, result["games"])


def pairs(results: Sequence[Result]) -> Iterator[Item]:
    """A matrix for each game, with remarks on its pairs."""
    places = (", ".join(str(each[name]) for name in SHARED if each[name]) for each in results)
    for place, those in grouped(zip(places, results, strict=True)).items():
        cells = {(each["proposer"], each["verifier"]): success(each) for each in those}
        proposers, verifiers = (dict.fromkeys(names) for names in zip(*cells, strict=True))
        rows = [[name, *(cells.get((name, other)) for other in verifiers)] for name in proposers]
        remarks = [f"{each['proposer']} with {each['verifier']}: {each['remark']}." for each in those if each["remark"]]
        yield table("Two agents", f"Success (%), {place}", ("proposer", *verifiers), rows, " ".join((NOTE, *remarks)))
