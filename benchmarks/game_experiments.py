"""The tables and pictures of docs/game_experiments.md, from the runs of experiments/game.toml.

    lilgym-mp experiment experiments/game.toml --out results/game
    python benchmarks/game_experiments.py results/game --corpus lilgym --pictures docs/pictures

Every game of the split is played once in each pair. Intervals are 95 %, resampling runs and statements.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from lilgym_mp.choices import choose
from lilgym_mp.corpus import load_tasks
from lilgym_mp.envs.proposer_verifier import (
    ALWAYS_ACCEPT,
    OracleVerifier,
    Partner,
    Role,
    TargetOnlyVerifier,
    parallel_env,
)
from lilgym_mp.envs.proposer_verifier.metrics import GameRecord, Metrics, play_games, summarise
from lilgym_mp.envs.proposer_verifier.partners import BatchTurn, encode_answers
from lilgym_mp.envs.proposer_verifier.protocols import STOP_ACTION
from lilgym_mp.envs.proposer_verifier.rewards import Intent
from lilgym_mp.evaluation.game_partners import ExpertProposer
from lilgym_mp.evaluation.settings import CONFIGURATIONS
from lilgym_mp.learning.agents import open_agent
from lilgym_mp.plotting import new_figure, save
from lilgym_mp.report.aggregation import accuracy_where, paired_difference

SAMPLES = 8
FAILURES = {  # and their cures, with their protocols
    "lazy": "veto",
    "common": "veto",
    "veto-both": "veto",
    "correctness": "veto",
    "paranoid": "audit",
    "hidden": "audit",
    "base-rate": "audit",
    "audit": "audit",
}


class Episode(NamedTuple):
    """What `report.aggregation` needs of a game."""

    statement: str
    target: bool
    is_success: bool


@dataclass(frozen=True)
class RandomRefusal:
    """Refuses a share of the claims, whatever they are, and accepts every edit."""

    share: float

    def __call__(self, turn: Any) -> int:
        raise NotImplementedError("for batches")

    def batch(self, turn: BatchTurn) -> Any:
        is_edit = turn.games.proposals[turn.indices] > STOP_ACTION
        return encode_answers(turn.game, is_edit | (turn.uniform() >= self.share))


@dataclass(frozen=True)
class StrongDoubts:
    """Refuses the claims that a judge thinks improbable, and accepts every edit."""

    judge: Callable[[BatchTurn], Any]
    below: float = 0.1

    def __call__(self, turn: Any) -> int:
        raise NotImplementedError("for batches")

    def batch(self, turn: BatchTurn) -> Any:
        accepts = turn.games.proposals[turn.indices] > STOP_ACTION
        claims = np.flatnonzero(~accepts)
        if len(claims):
            accepts[claims] = self.judge(replace(turn, indices=turn.indices[claims])) >= self.below
        return encode_answers(turn.game, accepts)


class Scorer:
    """Accepts everything, and notes how probable each judge thinks it that a claim holds."""

    def __init__(self, judges: Sequence[Callable[[BatchTurn], Any]]) -> None:
        self._judges = judges
        self.scores: dict[int, list[float]] = {}  # by game

    def __call__(self, turn: Any) -> int:
        raise NotImplementedError("for batches")

    def batch(self, turn: BatchTurn) -> Any:
        claims = np.flatnonzero(turn.games.proposals[turn.indices] == STOP_ACTION)
        if len(claims):
            at_claims = replace(turn, indices=turn.indices[claims])
            found = np.stack([judge(at_claims) for judge in self._judges], 1)
            for episode, scores in zip(turn.episodes[claims].tolist(), found.tolist(), strict=True):
                self.scores[episode] = scores
        return encode_answers(turn.game, np.ones(len(turn.indices), np.bool_))


class Experiments:
    """The runs of one results directory."""

    def __init__(
        self,
        results: Path,
        corpus: str,
        split: str,
        pictures: Path | None,
        reward_model: Path | None,
        configuration: str = "TowerFlipIt",
    ) -> None:
        self.runs, self.corpus, self.split, self.pictures = results / "runs", corpus, split, pictures
        self.configuration, self.appearance = configuration, choose("configuration", configuration, CONFIGURATIONS)[0]
        self.reward_model: Any = None if reward_model is None else open_agent(reward_model, "cpu")
        train = (load_tasks(corpus, self.appearance, start, "train") for start in ("scratch", "flipit"))
        self.seen = {task.statement for tasks in train for task in tasks}

    def paths(self, name: str) -> list[Path]:
        """The finished runs of all seeds."""
        found = sorted(
            self.runs.glob(f"{name}-{self.configuration}-*"), key=lambda path: int(path.name.rsplit("-", 1)[1])
        )
        return [path for path in found if (path / "agent.safetensors").exists()]

    def sides(self, paths: Iterable[Path], role: Role, *, sampled: bool = False) -> list[Any]:
        return [open_agent(path, "cpu").partner(role, sampled=sampled) for path in paths]  # pyright: ignore[reportAttributeAccessIssue]

    def game(self, protocol: str, start: str = "flipit") -> Any:
        return parallel_env(
            protocol=protocol, appearance=self.appearance, start=start, corpus=self.corpus, split=self.split
        )

    def experts(self, protocol: str) -> tuple[ExpertProposer, ExpertProposer]:
        """An honest one and one that lies."""
        dynamics = self.game(protocol).engine.game.config.dynamics
        return ExpertProposer(dynamics), ExpertProposer(dynamics, Intent.SNEAKY)

    def play(
        self, protocol: str, proposer: Partner, verifier: Partner, start: str = "flipit", repeats: int = 1
    ) -> list[GameRecord]:
        game = self.game(protocol, start)
        return play_games(game, proposer, verifier, tasks=list(game.tasks.ids) * repeats)

    # Sections

    def joint(self) -> None:
        """Both sides from scratch, with their own and with oracle verifiers."""
        paths = self.paths("joint")
        sides = list(zip(self.sides(paths, Role.PROPOSER), self.sides(paths, Role.VERIFIER), strict=True))
        rows: list[list[str]] = []
        for start in ("scratch", "flipit"):
            played: dict[str, list[list[GameRecord]]] = {}
            for proposer, own in sides:
                for name, verifier in (
                    ("the learned one", own),
                    ("an oracle", OracleVerifier()),
                    ("an oracle with 10 % errors", OracleVerifier(0.1)),
                ):
                    played.setdefault(name, []).append(self.play("joint", proposer, verifier, start))
            for name, games in played.items():
                rows.append([start, name, by_seed(games), interval(games), *map(interval, self.by_seen(games))])
            difference = compare(played["an oracle"], played["the learned one"])
            print(f"\n{start}: an oracle gains {difference}")
        table(["start", "verifier", "by seed", "mean", "seen", "unseen"], rows)
        start_seconds = time.process_time()
        games = [len(self.play("joint", *pair)) for pair in sides]
        print(f"\nevaluation: {sum(games) / (time.process_time() - start_seconds):,.0f} games per CPU second")
        for path in paths:
            last = json.loads((path / "progress.jsonl").read_text().splitlines()[-1])
            print(f"{path.name}: {last['steps'] / last['cpu_seconds']:,.0f} turns per CPU second, both sides learning")

    def by_seen(self, games: Sequence[Sequence[GameRecord]]) -> list[list[list[GameRecord]]]:
        return [
            [[one for one in run if (one.statement in self.seen) is seen] for run in games] for seen in (True, False)
        ]

    def matrix(self, name: str, protocol: str, value: str, picture: str) -> None:
        """Every seed's proposer, and the experts, with every seed's verifier."""
        paths = self.paths(name)
        proposers: dict[str, Any] = {f"seed {n}": one for n, one in enumerate(self.sides(paths, Role.PROPOSER))}
        verifiers: dict[str, Any] = {f"seed {n}": one for n, one in enumerate(self.sides(paths, Role.VERIFIER))}
        verifiers |= {"oracle": OracleVerifier(), "oracle, 10 % errors": OracleVerifier(0.1)}
        if self.reward_model is not None:
            verifiers["reward model"] = self.reward_model.verifier()
        verifiers["target only"] = TargetOnlyVerifier()
        expert = self.experts(protocol)
        cells = np.full((len(proposers) + 1, len(verifiers)), np.nan)
        details: list[list[str]] = []
        for row, proposer in enumerate(proposers.values()):
            for column, (judge, verifier) in enumerate(verifiers.items()):
                measured = summarise(self.play(protocol, proposer, verifier))
                found = measured.success_rate if value == "success" else measured.j
                cells[row, column] = np.nan if found is None else 100 * found
                if judge.startswith(("seed", "reward")):
                    details.append([f"seed {row}", judge, *judged(measured)])
        for column, (judge, verifier) in enumerate(verifiers.items()):
            games = [record for one in expert for record in self.play(protocol, one, verifier)]
            measured = summarise(games if value == "j" else games[: len(games) // 2])
            found = measured.success_rate if value == "success" else measured.j
            cells[-1, column] = np.nan if found is None else 100 * found
            if judge.startswith(("seed", "reward")):
                details.append(["expert, honest and lying" if value == "j" else "expert", judge, *judged(measured)])
        names = [*proposers, "expert, honest\nand lying" if value == "j" else "expert"]
        print(f"\n{name}: {value} by proposer (rows) and verifier (columns)")
        table(
            ["proposer", *verifiers],
            [[n.replace("\n", " "), *(f"{cell:.0f}" for cell in row)] for n, row in zip(names, cells, strict=True)],
        )
        table(["proposer", "verifier", "success", "complete, target true / false", "sound", "J"], details)
        title = "games won, %" if value == "success" else "J of the verifier"
        self.heat_map(picture, cells, names, list(verifiers), f"{name}: {title}")

    def filters(self) -> None:
        """A verifier in the training loop, at test, both and neither; random refusal, and another seed's verifier."""
        alone, both = self.paths("veto-alone"), self.paths("veto-both")
        verifiers = self.sides(both, Role.VERIFIER)
        rows: list[list[str]] = []
        results: dict[str, list[list[GameRecord]]] = {}
        for label, paths in (("alone", alone), ("with a verifier", both)):
            proposers = self.sides(paths, Role.PROPOSER)
            kinds: dict[str, list[Any]] = {
                "none": [ALWAYS_ACCEPT] * len(paths),
                "an oracle": [OracleVerifier()] * len(paths),
            }
            if len(verifiers) > 1:
                others = [verifiers[(n + 1) % len(verifiers)] for n in range(len(paths))]
                kinds["another seed's"] = others
                kinds["another seed's, strong doubts"] = [StrongDoubts(one.acceptance) for one in others]
            if self.reward_model is not None:
                kinds["a reward model"] = [self.reward_model.verifier()] * len(paths)
                kinds["a reward model, strong doubts"] = [StrongDoubts(self._by_reward_model)] * len(paths)
            if paths is both:
                kinds["its own"] = verifiers
            for name, judges in list(kinds.items()):
                games = [self.play("veto", one, judge) for one, judge in zip(proposers, judges, strict=True)]
                results[f"{label}, {name}"] = games
                if name not in ("none", "an oracle"):
                    controls = [RandomRefusal(refusal_share(one)) for one in games]
                    results[f"{label}, random like {name}"] = [
                        self.play("veto", one, judge) for one, judge in zip(proposers, controls, strict=True)
                    ]
        for name, games in results.items():
            by_seen = map(interval, self.by_seen(games))
            rows.append([*name.split(", ", 1), by_seed(games), interval(games), refused(games), *by_seen])
        table(["proposer trained", "verifier at test", "by seed", "success", "claims refused", "seen", "unseen"], rows)
        baseline = results.get("alone, none")
        for name, games in results.items():
            if baseline and name != "alone, none":
                print(f"- {name}, minus the proposer alone: {compare(games, baseline)}")

    def failures(self) -> None:
        """Verifiers that fail, and their cures, with their own proposers and with experts."""
        rows: list[list[str]] = []
        for name, protocol in FAILURES.items():
            for path in self.paths(name)[:1]:
                (proposer,), (verifier,) = (self.sides([path], role) for role in Role)
                own = self.play(protocol, proposer, verifier)
                experts = [game for one in self.experts(protocol) for game in self.play(protocol, one, verifier)]
                number_of_claims = sum(len(game.judgements) for game in own)
                rows.append(
                    [name, *judged(summarise(own)), str(number_of_claims), *list(judged(summarise(experts)))[1:]]
                )
        claims = ["complete, target true / false", "sound", "J"]
        table(["run", "success", *claims, "claims", *(f"experts: {one}" for one in claims)], rows)

    def samples(self) -> None:
        """The best of several sampled plans, chosen by verifiers, by an oracle and at random."""
        verifiers = self.sides(self.paths("veto-both"), Role.VERIFIER)
        rows: list[list[str]] = []
        for seed, path in enumerate(self.paths("veto-alone")[: len(verifiers)]):
            judges = [verifiers[seed].acceptance, verifiers[(seed + 1) % len(verifiers)].acceptance]
            if self.reward_model is not None:
                judges.append(self._by_reward_model)
            scorer = Scorer(judges)
            games = self.play("veto", self.sides([path], Role.PROPOSER, sampled=True)[0], scorer, repeats=SAMPLES)
            won = np.array([one.outcome.value == "success" for one in games]).reshape(SAMPLES, -1)
            unclaimed = [-1.0] * len(judges)
            scores = np.array([scorer.scores.get(n, unclaimed) for n in range(len(games))]).reshape(*won.shape, -1)
            choices = [scores[..., 0], scores[..., :2].mean(2), scores[..., -1]]
            chosen = [np.take_along_axis(won, each.argmax(0)[None], 0).mean() for each in choices]
            greedy = summarise(self.play("veto", self.sides([path], Role.PROPOSER)[0], ALWAYS_ACCEPT)).success_rate
            rows.append([str(seed), *(f"{100 * x:.1f}" for x in (greedy, won.mean(), *chosen, won.any(0).mean()))])
        last = "another verifier" if self.reward_model is None else "a reward model"
        header = ["seed", "most probable plan", f"mean of {SAMPLES}", "best by a verifier", "by the mean of two"]
        table([*header, f"by {last}", "by an oracle"], rows)

    def _by_reward_model(self, turn: BatchTurn) -> Any:
        return np.array([self.reward_model.success_probability(state.mdp) for state in turn.states()])

    def rounds(self) -> None:
        """Exploitability by round: each sneaky best response against each round's verifier."""
        for path in self.paths("rounds"):
            count = len(list(path.glob("sneak-*")))
            verifiers = self.sides([path / f"verifier-{n}" for n in range(count)], Role.VERIFIER)
            sneaks = self.sides([path / f"sneak-{n}" for n in range(count)], Role.PROPOSER)
            honest = self.sides(self.paths("audit")[:1], Role.PROPOSER)[0]
            expert = self.experts("audit")[1]
            lies = np.array(
                [
                    [summarise(self.play("audit", sneak, judge)).accepted_false_claims for judge in verifiers]
                    for sneak in sneaks
                ]
            )
            rows: list[list[str]] = []
            for n, judge in enumerate(verifiers):
                scripted = summarise(self.play("audit", expert, judge))
                own = summarise(self.play("audit", honest, judge))
                rows.append(
                    [
                        str(n + 1),
                        f"{lies[n, n]:.2f}",
                        f"{lies[:n, n].max():.2f}" if n else "-",
                        percent(scripted.soundness),
                        percent(own.completeness),
                        number(own.j),
                    ]
                )
            print(f"\n{path.name}")
            table(
                [
                    "round",
                    "exploitability",
                    "worst of earlier sneaks",
                    "sound: scripted expert",
                    "complete: honest proposer",
                    "J, honest proposer",
                ],
                rows,
            )
            names = [f"round {n + 1}" for n in range(count)]
            self.heat_map(
                f"game_{path.name.split('-')[0]}",
                100 * lies,
                [f"sneak, {n}" for n in names],
                [f"verifier, {n}" for n in names],
                "lies accepted, % of games",
            )

    # Pictures

    def heat_map(self, name: str, cells: Any, rows: Sequence[str], columns: Sequence[str], title: str) -> None:
        if self.pictures is None:
            return
        figure: Any = new_figure(170 + 75 * len(columns), 110 + 42 * len(rows))
        axes: Any = figure.subplots()
        axes.imshow(cells, cmap="Blues", aspect="auto", vmin=min(0, np.nanmin(cells)), vmax=max(100, np.nanmax(cells)))
        for row, column in np.ndindex(cells.shape):
            if not np.isnan(cells[row, column]):
                colour = "white" if cells[row, column] > 60 else "black"
                axes.text(column, row, f"{cells[row, column]:.0f}", ha="center", va="center", color=colour)
        axes.set_xticks(range(len(columns)), [one.replace(", ", "\n") for one in columns], fontsize=8)
        axes.set_yticks(range(len(rows)), rows, fontsize=8)
        axes.set_xlabel("verifier", fontsize=8)
        axes.set_ylabel("proposer", fontsize=8)
        axes.set_title(title, fontsize=9)
        save(figure, self.pictures / f"{name}.svg", "svg")

    def curves(self) -> None:
        """Success and J of training games by CPU time, mean and range over seeds."""
        names = {"joint": "joint", "veto-alone": "proposer alone (veto)", "veto-both": "veto", "audit": "audit"}
        figure: Any = new_figure(900, 300)
        panels = dict(zip(("success", "j"), figure.subplots(1, 2), strict=True))
        for index, (name, label) in enumerate(names.items()):
            for key, axes in panels.items():
                lines = [curve(path, key) for path in self.paths(name)]
                if not lines or any(line is None for line in lines):
                    continue
                end = min(line[0][-1] for line in lines)
                minutes = np.linspace(0, end, 60)
                values = 100 * np.array([np.interp(minutes, *line) for line in lines])
                if not values.any():  # J of a verifier that accepts everything
                    continue
                axes.plot(
                    minutes,
                    values.mean(0),
                    color=f"C{index}",
                    label=f"{label}, {len(lines)} seed{'s' * (len(lines) > 1)}",
                )
                axes.fill_between(minutes, values.min(0), values.max(0), color=f"C{index}", alpha=0.2, linewidth=0)
        for axes, title in zip(
            panels.values(), ("training games won, %", "J of the verifier on training claims"), strict=True
        ):
            axes.set_title(title, fontsize=9)
            axes.set_xlabel("CPU minutes", fontsize=8)
            axes.grid(alpha=0.3)
            axes.tick_params(labelsize=8)
        panels["success"].legend(fontsize=7)
        if self.pictures is not None:
            save(figure, self.pictures / "game_curves.svg", "svg")


def curve(path: Path, key: str) -> Any:
    """CPU minutes and smoothed values of a run's progress; None without any."""
    lines = [json.loads(line) for line in (path / "progress.jsonl").read_text().splitlines()]
    points = [(line["cpu_seconds"] / 60, line[key]) for line in lines if line[key] is not None]
    if len(points) < 2:
        return None
    minutes, values = np.array(points).T
    width = max(1, len(values) // 20)
    smooth = np.convolve(np.pad(values, (width - 1, 0), "edge"), np.full(width, 1 / width), "valid")
    return minutes, smooth


def as_runs(games: Sequence[Sequence[GameRecord]]) -> list[Any]:
    """Runs as `report.aggregation` takes them."""
    return [
        SimpleNamespace(episodes=[Episode(one.statement, one.target, one.outcome.value == "success") for one in run])
        for run in games
    ]


def interval(games: Sequence[Sequence[GameRecord]]) -> str:
    found = accuracy_where(as_runs(games))
    return "-" if found is None else f"{found.mean:.1f} [{found.low:.1f}, {found.high:.1f}]"


def by_seed(games: Sequence[Sequence[GameRecord]]) -> str:
    return ", ".join(f"{100 * summarise(run).success_rate:.1f}" for run in games)


def compare(first: Sequence[Sequence[GameRecord]], second: Sequence[Sequence[GameRecord]]) -> str:
    found = paired_difference(as_runs(first), as_runs(second))
    assert found is not None
    return f"{found.points:+.1f} [{found.low:+.1f}, {found.high:+.1f}] points"


def judged(measured: Metrics) -> Iterator[str]:
    yield percent(measured.success_rate)
    targets = [measured.by_target.get(name) for name in ("true", "false")]
    yield " / ".join(percent(one and one.completeness, 0) for one in targets)
    yield " / ".join(percent(one and one.soundness, 0) for one in targets)
    limits = measured.j_interval
    yield number(measured.j) + (f" [{100 * limits[0]:.0f}, {100 * limits[1]:.0f}]" if limits else "")


def refusal_share(games: Sequence[GameRecord]) -> float:
    return float(np.mean([not judgement.accepted for one in games for judgement in one.judgements] or [0.0]))


def refused(games: Sequence[Sequence[GameRecord]]) -> str:
    return " / ".join(percent(refusal_share(run), 0) for run in games)


def percent(share: float | None, digits: int = 1) -> str:
    return "-" if share is None else f"{100 * share:.{digits}f}"


def number(j: float | None) -> str:
    return "-" if j is None else f"{100 * j:.0f}"


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    print()
    for row in (header, ["---"] * len(header), *rows):
        print(f"| {' | '.join(row)} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, metavar="RESULTS")
    parser.add_argument("--corpus", default="builtin")
    parser.add_argument("--split", default="dev")
    parser.add_argument("--configuration", default="TowerFlipIt")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="draw the pictures into this directory")
    parser.add_argument("--reward-model", type=Path, metavar="RUN", help="a run of `train reward-model`: a verifier")
    parser.add_argument(
        "--only",
        nargs="+",
        metavar="SECTION",
        help="joint, cross-play, audit, filters, samples, failures, rounds, curves",
    )
    args = parser.parse_args()
    found = Experiments(args.results, args.corpus, args.split, args.pictures, args.reward_model, args.configuration)
    sections: Mapping[str, Any] = {
        "joint": found.joint,
        "cross-play": lambda: found.matrix("joint", "joint", "success", "game_cross_play"),
        "audit": lambda: found.matrix("audit", "audit", "j", "game_audit_j"),
        "filters": found.filters,
        "samples": found.samples,
        "failures": found.failures,
        "rounds": found.rounds,
        "curves": found.curves,
    }
    for name in args.only or sections:
        print(f"\n## {name}", flush=True)
        sections[name]()


if __name__ == "__main__":
    main()
