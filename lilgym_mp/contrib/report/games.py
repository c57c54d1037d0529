"""Pairs of agents in the two-agent game: a matrix of success, and the measures of each pair."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from lilgym_mp.contrib.report.aggregation import MeanStd
from lilgym_mp.contrib.report.items import Item, table
from lilgym_mp.evaluation.game_partners import SCRIPTED_VERIFIERS
from lilgym_mp.learning.common.run_directory import AGENT_FILE, RUN_FILE
from lilgym_mp.scene.grouping import grouped

ITEM = "Two agents"
NOTE = "Brackets: 95 % intervals; statements, with all of their games, are resampled."


class PlayedPair(NamedTuple):
    """What `lilgym-mp evaluate --out` writes of a pair, fractions in per cent."""

    proposer: str
    verifier: str
    place: str  # game, split, corpus and actions, for titles
    key: tuple[str, str, str]  # configuration, split and corpus
    actions: str
    messages: str | None  # what replaced them
    success: MeanStd
    j: MeanStd | None
    games: int
    lies: float
    remark: str

    @property
    def is_run(self) -> bool:
        """Whether both agents are those of one run, which play as they learned."""
        return self.proposer == self.verifier and self.proposer not in SCRIPTED_VERIFIERS and not self.messages


def game_runs(paths: Iterable[Path]) -> list[Path]:
    """The runs of `train game` with a trained agent in these directories."""
    files = sorted({file for path in paths if path.is_dir() for file in path.rglob(RUN_FILE)})
    return [file.parent for file in files if file.with_name(AGENT_FILE).exists() and _learner(file) == "game"]


def _learner(file: Path) -> str | None:
    try:
        return json.loads(file.read_text(encoding="utf-8"))["identity"]["learner"]
    except (OSError, ValueError, KeyError, TypeError):
        return None


def read_results(path: Path) -> list[Mapping[str, Any]]:
    """The results of games in a JSON file. Raises ValueError for another file."""
    try:
        results = json.loads(path.read_text(encoding="utf-8"))["results"]
        for result in results:
            read_pair(result)
        return list(results)
    except (OSError, ValueError, KeyError, TypeError):
        raise ValueError(f"{path}: not results of games, which `lilgym-mp evaluate --out` writes") from None


def read_pair(result: Mapping[str, Any]) -> PlayedPair:
    """A pair of a file of results. Raises KeyError, TypeError or ValueError for anything else."""
    key = str(result["configuration"]), str(result["split"]), str(result["corpus"])
    names = (key[0], result["protocol"], key[1], Path(key[2]).name, f"{result['actions']} actions")
    messages = [f"messages {result['messages']}"] if result["messages"] else []
    j = result["j"]
    return PlayedPair(
        str(result["proposer"]),
        str(result["verifier"]),
        ", ".join((*map(str, names), *messages)),
        key,
        str(result["actions"]),
        result["messages"],
        _percent(result["success"], result["success_interval"], int(result["games"])),
        None if j is None else _percent(j, result["j_interval"], int(result["games"])),
        int(result["games"]),
        100 * float(result["accepted_false_claims"]),
        str(result["remark"]),
    )


def _percent(share: float, interval: Sequence[float], games: int) -> MeanStd:
    low, high = interval
    return MeanStd(100 * share, None, 1, 100 * low, 100 * high, episodes=games)


def pairs(played: Sequence[PlayedPair]) -> Iterator[Item]:
    """For each game, the matrix and the measures of its pairs."""
    for (place, _), those in grouped(((pair.place, pair.key), pair) for pair in played).items():
        found = {(pair.proposer, pair.verifier): pair.success for pair in those}
        proposers, verifiers = (list(dict.fromkeys(names)) for names in zip(*found, strict=True))
        cells = {name: [found.get(pair) for pair in product([name], verifiers)] for name in proposers}
        remarks = [f"{pair.proposer} with {pair.verifier}: {pair.remark}." for pair in those if pair.remark]
        matrix = [(name, *row) for name, row in cells.items()]
        note = " ".join((f"Rows: proposers; columns: verifiers. {NOTE}", *remarks))
        yield table(ITEM, f"Success (%), {place}", ("proposer", *verifiers), matrix, note)
        columns = ("proposer", "verifier", "games", "success (%)", "J (points)", "lies accepted (%)", "remark")
        measures = [
            (pair.proposer, pair.verifier, pair.games, pair.success, pair.j, pair.lies, pair.remark or None)
            for pair in those
        ]
        note = f"J: share of true claims accepted minus share of false ones, averaged over the target values. {NOTE}"
        yield table(ITEM, f"Pairs of agents, {place}", columns, measures, note)
