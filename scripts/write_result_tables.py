"""Write the tables of docs/results.md, and accuracy.csv, paired_tests.csv, phenomena.csv and stops.csv from the others.

    python scripts/write_result_tables.py
    python scripts/write_result_tables.py --row 13 results/episodes/ppo-*/*-greedy.jsonl.gz
    python scripts/write_result_tables.py --runs results

docs/results/outcomes.csv has the runs whose recordings were kept in this form: for each start scene of official dev, in
the order of the file, the number of its episodes that succeeded. Which statement a scene belongs to is read from the
official data, so that the recordings themselves, which contain statements, need not be published. Row 17, the two-agent
game, is in games.csv (`compare_partners.py`). `--row` adds recordings to a row of the table of accuracies. All
recordings of the row in a configuration belong together: returns.csv and behaviour.csv are made of them, too. The rows
`paper`, `paper-sf` and `paper-no-bonus` are C3+BERT with the paper's recipe, whose table is in docs/training.md (the
last without the entropy bonus), `tested` the agents of docs/test_split.md, `default` parse and plan by default, in
docs/agents.md, `included` those agents of that page that have no row here, `separators` agents that can act on
separators, with sampled actions, `sb3` and `sb3-masks` runs of docs/stable_baselines3.md, `reward` and `taught` those
of docs/reward_model.md with and without search, `program-reward` the runs of Figure 4 with this reward.
`--runs` writes commit, processor, CPU minutes, budget and digest of an experiment's finished runs into runs.csv, which
knows them and their commands by name.

A table of the page follows a line `<!-- NAME.csv: N -->`, where N columns hold text.
"""

from __future__ import annotations

import argparse
import csv
import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from itertools import combinations, product
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple, cast

from digest_recordings import digest

from lilgym_mp.cli.experiment_runs import EPISODES, FINISHED, RUNS
from lilgym_mp.contrib.report.aggregation import accuracy_where, holm, mean_where, paired_difference
from lilgym_mp.contrib.report.behaviour import ROLLOUT_STATISTICS, error_kind
from lilgym_mp.contrib.report.items import MISSING
from lilgym_mp.contrib.report.phenomena import shows_phenomenon
from lilgym_mp.corpus import load_tasks
from lilgym_mp.corpus.tasks import TaskSet
from lilgym_mp.envs.registration import CONFIGURATIONS
from lilgym_mp.evaluation.episode_files import read_episodes
from lilgym_mp.evaluation.recording_metadata import read_metadata
from lilgym_mp.evaluation.results import rounded
from lilgym_mp.learning.common.run_directory import PROGRESS_FILE, RUN_FILE, VALIDATIONS_FILE
from lilgym_mp.scene.grouping import grouped

if TYPE_CHECKING:
    from lilgym_mp.contrib.report.aggregation import Difference, MeanStd
    from lilgym_mp.evaluation.episode_files import Recording
    from lilgym_mp.evaluation.episodes import Episode

PAGE = Path(__file__).resolve().parents[1] / "docs" / "results.md"
RESULTS = PAGE.parent / "results"
TABLE = re.compile(r"<!-- (?P<name>\w+)\.csv: (?P<texts>\d) -->\n\n(?:\|.*\n)*")  # how many columns hold text
SMALLEST = 0.0001  # smaller p-values are not printed


class Outcomes(NamedTuple):
    """The successes of a run in one configuration."""

    row: str  # number in the table of accuracies
    run: str
    commit: str  # of the code that played
    configuration: str
    actions: str
    episodes: str  # of each start scene
    successes: str  # a digit for each start scene

    def recording(self) -> Any:
        """A recording, as far as it is needed to compute accuracies and their differences."""
        episodes = (
            SimpleNamespace(statement=task.statement, program=task.program, is_success=success < int(successes))
            for task, successes in zip(tasks(self.configuration), self.successes, strict=True)
            for success in range(int(self.episodes))
        )
        return SimpleNamespace(episodes=tuple(episodes))


def tasks(configuration: str, split: str = "dev") -> TaskSet:
    return load_tasks("lilgym", *CONFIGURATIONS[configuration], split)


def recorded(row: str, file: Path) -> Outcomes:
    """The outcomes of a recording."""
    recording, metadata = read_episodes(file), read_metadata(file)
    header, name = recording.header, recording.header.settings.configuration
    found = Counter(episode.task for episode in recording.episodes if episode.is_success)
    successes = "".join(str(found[task.id]) for task in tasks(name))
    run = header.agent if header.run is None else Path(header.run).name
    return Outcomes(row, run, metadata.get("commit") or "", name, header.actions, str(header.passes), successes)


def read(name: str) -> list[list[str]]:
    with (RESULTS / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


def write(name: str, rows: Iterable[Sequence[str]]) -> None:
    with (RESULTS / f"{name}.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)


def replace_row(file: str, new: Sequence[str]) -> None:
    """Writes this row in place of the one of the same agent and configuration, or after all others."""
    rows = read(file)
    index = next((index for index, row in enumerate(rows) if row[:2] == list(new[:2])), len(rows))
    write(file, [*rows[:index], new, *rows[index + 1 :]])


def agent_of(row: str, actions: str) -> str:
    """The row's agent as returns.csv and behaviour.csv name it."""
    names = dict(name.split(". ", 1) for name, *_ in read("accuracy")[1:] if ". " in name)
    return f"{names[row]} ({actions})" if [*names.values()].count(names[row]) > 1 else names[row]


def returns(runs: Sequence[Recording]) -> Iterator[str]:
    """The numbers of returns.csv: rewards, accuracy by target and novelty, and how many actions are needless."""

    def text(value: MeanStd | None, places: int = 2, *, interval: bool = False) -> str:
        return MISSING if value is None else (value if interval else value._replace(low=None)).text(places)

    yield text(mean_where(runs, lambda episode: episode.reward))
    has_targets = not all(episode.target for episode in runs[0].episodes)
    for target in (True, False):
        accuracy = accuracy_where(runs, lambda episode, target=target: episode.target == target)
        yield text(accuracy if has_targets else None, 1, interval=True)
    yield text(accuracy_where(runs, lambda episode: episode.statement_seen))
    yield text(accuracy_where(runs, lambda episode: episode.form_seen and not episode.statement_seen))
    yield text(accuracy_where(runs, lambda episode: not episode.form_seen))
    yield text(mean_where(runs, needless, lambda episode: episode.is_success))
    yield text(mean_where(runs, lambda episode: 100.0 * (episode.is_success and needless(episode) == 0)))


def needless(episode: Episode) -> float:
    assert episode.optimal_actions is not None, "record with --optimal"
    return len(episode.actions) - episode.optimal_actions


def behaviour(runs: Sequence[Recording]) -> Iterator[str]:
    """The numbers of behaviour.csv: means over all episodes, and kinds of STOP in percent of the failures."""
    for value in ROLLOUT_STATISTICS.values():
        yield f"{cast('MeanStd', mean_where(runs, value)).mean:.2f}"
    kinds = [kind for run in runs for episode in run.episodes if (kind := error_kind(episode))]
    yield str(len(kinds))
    for kind in ("direct stop", "early stop", "erroneous stop"):
        yield f"{100 * kinds.count(kind) / len(kinds):.2f}" if kinds else MISSING


def stops() -> list[list[str]]:
    """stops.csv with its agents' numbers in behaviour.csv."""
    found = {(agent, name): numbers[-4:] for agent, name, *numbers in read("behaviour")[1:]}
    head, *rows = read("stops")
    own = [row[0] for row in rows if "†" not in row[0]]
    made = [[agent, *found[agent, "ScatterScratch"], *found[agent, "ScatterFlipIt"]] for agent in own]
    return [head, *made, *rows[len(own) :]]


def add(row: str, paths: Sequence[Path]) -> None:
    """Adds runs to outcomes.csv, in place of earlier outcomes of the same runs."""
    head, *known = read("outcomes")
    found = [recorded(row, path) for path in paths]
    replaced = {(each.row, each.run, each.configuration, each.actions) for each in found}
    recordings = [read_episodes(path) for path in paths if row.isdigit()]
    for name in CONFIGURATIONS:
        if runs := [each for each in recordings if each.header.settings.configuration == name]:
            agent = agent_of(row, runs[0].header.actions)
            replace_row("returns", [agent, name, *returns(runs)])
            replace_row("behaviour", [agent, name, *behaviour(runs)])
    rows = [*(each for each in known if (each[0], each[1], each[3], each[4]) not in replaced), *found]
    write("outcomes", [head, *sorted(rows, key=lambda each: (each[0].zfill(9), *each[1:]))])


def write_runs(directory: Path) -> list[str]:
    """Writes an experiment's finished runs into runs.csv; returns the names of those that have no row there."""
    (*head,), *rows = read("runs")
    finished = [file.stem for file in sorted((directory / FINISHED).glob("*.json"))]
    for row in rows:
        if row[1] in finished:
            finished.remove(row[1])
            run, recordings = directory / RUNS / row[1], directory / EPISODES / row[1]
            games = recordings.with_name(f"{row[1]}-dev.csv")
            made, progress = json.loads((run / RUN_FILE).read_text())["made"], last_line(run / PROGRESS_FILE)
            count = last_line(run / VALIDATIONS_FILE).get("best_steps") or progress.get("steps") or progress["updates"]
            commit, _, changes = made["commit"].partition(" ")
            row[3:5] = f"{commit[:7]} {changes}".strip(), made["machine"].partition(",")[0]
            row[5] = f"{progress['cpu_seconds'] / 60:.1f}"
            row[6] = f"{count / 1e6:.2f} million" if count >= 100_000 else f"{count:,}"
            row[7] = next((digest(path) for path in (recordings, games) if path.exists()), "")
    write("runs", [head, *rows])
    return finished


def last_line(file: Path) -> dict[str, Any]:
    return json.loads(file.read_text().splitlines()[-1]) if file.is_file() else {}


def outcomes() -> list[Outcomes]:
    """All of outcomes.csv, and row 17: the pairs of games.csv that learned together."""
    found = [Outcomes(*line) for line in read("outcomes")[1:]]
    for experiment, proposer, verifier, configuration, commit, games in read("games")[1:]:
        if experiment == "joint" and proposer == verifier:
            successes = "".join(game[0] for game in games.split())
            found.append(Outcomes("17", proposer, commit, configuration, "greedy", "1", successes))
    return found


def runs_by_row() -> dict[tuple[str, str], list[Any]]:
    """The recordings of each row of the table of accuracies and configuration."""
    return grouped(((each.row, each.configuration), each.recording()) for each in outcomes() if each.row.isdigit())


def paper_cells() -> Iterator[str]:
    """The cells of docs/training.md for each run with the paper's recipe: accuracy with sampled and greedy actions."""
    order = [*CONFIGURATIONS]
    known = sorted(outcomes(), key=lambda each: (order.index(each.configuration), each.row, each.run))
    for runs in grouped((each.run, each) for each in known if each.row.startswith("paper")).values():
        of_mode = {each.actions: accuracy_where([each.recording()]) for each in runs}
        yield " | ".join(cast("MeanStd", of_mode[mode]).text(1) for mode in ("sampled", "greedy"))


def pairs() -> Iterable[list[str]]:
    """The names of an appearance's two configurations, for each appearance."""
    return grouped((appearance, name) for name, (appearance, _) in CONFIGURATIONS.items()).values()


def by_novelty(row: str, configuration: str) -> list[MeanStd]:
    """The accuracy of a row of outcomes.csv on all statements, on those of train, and on the others."""
    runs = [each.recording() for each in outcomes() if (each.row, each.configuration) == (row, configuration)]
    seen = {task.statement for task in tasks(configuration, "train")}
    predicates = (None, lambda episode: episode.statement in seen, lambda episode: episode.statement not in seen)
    return [cast("MeanStd", accuracy_where(runs, predicate)) for predicate in predicates]


def default_cells() -> Iterator[str]:
    """The cells of docs/agents.md for parse and plan by default: accuracy on all and on unseen statements."""
    everywhere, _, unseen = zip(*(by_novelty("default", name) for name in CONFIGURATIONS), strict=True)
    for found in (everywhere, unseen):
        yield " | ".join(each._replace(low=None).text(1) for each in found)


def imitation_cells() -> Iterator[str]:
    """The cells of docs/imitation.md."""
    yield from _novelty_cells("3")


def reward_model_cells() -> Iterator[str]:
    """The cells of docs/reward_model.md: for each appearance, those with search and without."""
    for cells in zip(_novelty_cells("reward"), _novelty_cells("taught"), strict=True):
        yield from cells


def _novelty_cells(row: str) -> Iterator[str]:
    """For each appearance that has runs: accuracy on all statements, and on seen and unseen ones."""
    names = {each.configuration for each in outcomes() if each.row == row}
    for pair in (pair for pair in pairs() if {*pair} <= names):
        found = [by_novelty(row, name) for name in pair]
        yield " | ".join(
            f"{everywhere._replace(low=None).text(1)} ({rounded(seen.mean, 1)} / {rounded(unseen.mean, 1)})"
            for everywhere, seen, unseen in found
        )


def ppo_cells() -> Iterator[str]:
    """The cells of docs/training.md for PPO: accuracy with greedy and sampled actions, and on unseen statements."""
    for pair in pairs():
        found = [zip(by_novelty("4", name), by_novelty("5", name), strict=True) for name in pair]
        everywhere, _, unseen = zip(*found, strict=True)
        yield " | ".join(map(_greedy_and_sampled, everywhere))
        yield " | ".join(map(_greedy_and_sampled, unseen))
    alone = zip(by_novelty("11", "ScatterScratch"), by_novelty("12", "ScatterScratch"), strict=True)
    yield _greedy_and_sampled(next(alone))


def sb3_cells() -> Iterator[str]:
    """The cells of docs/stable_baselines3.md: accuracy of each seed with greedy and sampled actions."""
    modes = ("greedy", "sampled")
    for row, name in product(("sb3", "sb3-masks"), CONFIGURATIONS):
        runs = grouped((each.run, each) for each in outcomes() if (each.row, each.configuration) == (row, name))
        seeds = [{each.actions: accuracy_where([each.recording()]) for each in run} for run in runs.values()]
        if seeds:
            yield " | ".join(_greedy_and_sampled([cast("MeanStd", seed[mode]) for mode in modes]) for seed in seeds)


def separators_cells() -> Iterator[str]:
    """The accuracies on Scatter, in docs/results.md, of agents that can act on separators."""
    _, scatter = pairs()
    yield " and ".join(by_novelty("separators", name)[0]._replace(low=None).text(1) for name in scatter)


def figure_4_cells() -> Iterator[str]:
    """The accuracies on Scratch, in docs/results.md, of agents that learn from the program reward."""
    for name in ("TowerScratch", "ScatterScratch"):
        yield by_novelty("program-reward", name)[0]._replace(low=None).text(1)


def _greedy_and_sampled(pair: Sequence[MeanStd]) -> str:
    greedy, sampled = pair
    return f"{rounded(greedy.mean, 1)} / {rounded(sampled.mean, 1)}"


def accuracies() -> list[list[str]]:
    """accuracy.csv with the accuracies of all rows in outcomes.csv."""
    (*head,), *rows = read("accuracy")
    for (number, configuration), runs in runs_by_row().items():
        row = next(row for row in rows if row[0].startswith(f"{number}. "))
        column = next(index for index, name in enumerate(head) if name.startswith(configuration))
        row[column] = cast("MeanStd", accuracy_where(runs)).text(1)
    return [head, *rows]


def differences() -> list[list[str]]:
    """paired_tests.csv with all pairs of rows in outcomes.csv, in points; p is corrected for their number."""
    found = runs_by_row()
    numbers = list(dict.fromkeys(row for row, _ in found))
    places = [
        (pair, name)
        for pair in combinations(numbers, 2)
        for name in CONFIGURATIONS
        if {(row, name) for row in pair} <= found.keys()
    ]
    tests = [cast("Difference", paired_difference(*(found[row, name] for row in pair))) for pair, name in places]
    corrected = holm([test.p_value for test in tests])
    cells: dict[tuple[str, str], dict[str, str]] = {}
    for (pair, name), test, p_value in zip(places, tests, corrected, strict=True):
        p_text = f"{p_value:.2f}" if p_value >= 0.01 else f"{p_value:.1g}" if p_value >= SMALLEST else f"< {SMALLEST}"
        cells.setdefault(pair, {})[name] = f"{test.points:.1f} [{test.low:.1f}, {test.high:.1f}] ({p_text})"
    head, *rows = read("paired_tests")
    rows = [row for row in rows if (row[0], row[1]) not in cells]
    rows += [[*pair, *(row.get(name, "–") for name in CONFIGURATIONS)] for pair, row in cells.items()]
    return [head, *sorted(rows, key=lambda row: (int(row[0]), int(row[1])))]


def by_phenomenon() -> list[list[str]]:
    """phenomena.csv with the numbers of start scenes, and accuracies of rows in outcomes.csv."""
    found = runs_by_row()
    agents = {agent_of(number, "greedy"): number for number, _ in reversed(found)}  # of two, the greedy row
    (*head,), *rows = read("phenomena")
    for row in rows:
        shows = partial(shows_phenomenon, row[0])
        for column, title in enumerate(head):
            configuration, _, name = title.partition(": ")
            if name in agents:
                accuracy = accuracy_where(found[agents[name], configuration], shows)
                row[column] = MISSING if accuracy is None else f"{accuracy.mean:.2f}"
            elif configuration in CONFIGURATIONS:
                row[column] = str(sum(map(shows, tasks(configuration))))
    return [head, *rows]


def text(page: str) -> str:
    """The page with its tables made again."""
    return TABLE.sub(_table, page)


def _table(match: re.Match[str]) -> str:
    head, *rows = read(match["name"])
    texts = int(match["texts"])
    rule = "|---" * texts + "|---:" * (len(head) - texts) + "|\n"
    first, *lines = (f"| {' | '.join(row)} |\n" for row in (head, *rows))
    return match[0].split("\n", 1)[0] + "\n\n" + "".join([first, rule, *lines])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--row", help="row of the table of accuracies that the paths belong to")
    parser.add_argument("paths", nargs="*", type=Path)
    parser.add_argument("--runs", type=Path, metavar="DIR", help="results directory of an experiment, for runs.csv")
    args = parser.parse_args()
    if args.runs is not None:
        if not (args.runs / FINISHED).is_dir():
            parser.error(f"{args.runs}: not the results directory of an experiment")
        for name in write_runs(args.runs):
            print(f"{name}: has no row in runs.csv; add one with its name")
    add(args.row, args.paths)
    write("accuracy", accuracies())
    write("paired_tests", differences())
    write("phenomena", by_phenomenon())
    write("stops", stops())
    PAGE.write_text(text(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
