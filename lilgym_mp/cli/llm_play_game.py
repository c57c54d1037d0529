"""Plays the proposer-verifier game with a language model in one seat, or in both, for `lilgym-mp llm play`."""

from __future__ import annotations

import argparse
import json
import re
import threading
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.cli.options import RUNS, CommandError, add_number, check_at_least, given_environment
from lilgym_mp.evaluation.files import fresh_file, write_json, write_text
from lilgym_mp.evaluation.terminal import Progress, table
from lilgym_mp.scene.choices import choose

if TYPE_CHECKING:
    from lilgym_mp.contrib.llm import LanguageAgent
    from lilgym_mp.contrib.llm.game_player import LanguagePartner
    from lilgym_mp.contrib.llm.summary import Turn
    from lilgym_mp.envs.proposer_verifier import GameSettings, Partner, Role

TURNS, GAMES, SUMMARY = "turns.jsonl", "transcripts.jsonl", "summary.json"
PROTOCOLS = ("veto", "audit", "critique", "joint")
FULL = "full"
BOTH = "both"
GAME_OPTIONS = ("views", "role", "partner", "words")
Seats = tuple[str, str]  # the names of the proposer and the verifier


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the two-agent game to those of `lilgym-mp llm play`."""
    group = parser.add_argument_group("two-agent game")
    group.add_argument("--protocol", choices=PROTOCOLS, help="play the proposer-verifier game instead")
    group.add_argument(
        "--views", choices=("guide", FULL), help="guide: only the verifier knows the statement (default: full)"
    )
    group.add_argument("--role", choices=("proposer", "verifier", BOTH), help="the model's seats (default: both)")
    group.add_argument(
        "--partner",
        nargs="+",
        metavar="NAME|RUN",
        help="scripted partners, such as oracle or expert, trained agents, or another model's agent, as for --agent"
        " (default: for one seat, the oracle or the experts; with --views guide, guide or builder)",
    )
    group.add_argument(
        "--partner-option", nargs="+", default=[], metavar="KEY=VALUE", help="as --option, of a partner that is a model"
    )
    add_number(group, "--words", 0, "words of the verifier's own that a model may add as a note to the proposer")


def is_asked(args: argparse.Namespace) -> bool:
    """Whether the game is to be played. Raises CommandError for the game's options without it."""
    if args.protocol is None:
        for name in GAME_OPTIONS:
            if getattr(args, name):
                raise CommandError(f"--{name} is for the two-agent game; add --protocol {'|'.join(PROTOCOLS)}")
    return args.protocol is not None


def run(args: argparse.Namespace, agent: LanguageAgent, agent_options: Mapping[str, Any]) -> int:
    """Plays games with a language model, and prints and writes a table of all pairs of players."""
    from lilgym_mp.cli.evaluate_game import LEGEND, row_of
    from lilgym_mp.cli.llm_play import drawn, print_calls
    from lilgym_mp.contrib.llm.summary import calls
    from lilgym_mp.envs.proposer_verifier import GameSettings, play_games
    from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv
    from lilgym_mp.envs.proposer_verifier.metrics import summarise
    from lilgym_mp.wrappers.replies import FAILED

    check_at_least(args, 0, "words")
    views = {"views": "guide"} if args.views == "guide" else {}
    game = GameSettings(
        args.configuration, protocol=args.protocol, split=args.split, **views, **given_environment(args)
    )
    env = BaseGameEnv(**vars(game))
    players = _Players(args, game, agent, agent_options)
    settings = players.settings(env.tasks.provenance.sha256)
    words = ["llm-game", args.configuration, args.protocol, args.agent, str(agent_options.get("model", ""))]
    args.out = args.out or RUNS / re.sub(r"[^\w.-]+", "-", "-".join(filter(None, words)))
    recalled = _recalled(args, settings)
    chosen = drawn(env.tasks, args.episodes, args.seed)
    results: list[dict[str, Any]] = []
    games: list[dict[str, Any]] = []
    turns: list[Turn] = []
    with _TurnFile(args.out / TURNS) as file, Progress(len(players.pairs), "pairs", prints=False) as bar:
        for names in players.pairs:
            seats, models = players.partners(names, recalled, file)
            records = play_games(env, *seats, tasks=chosen, seed=args.seed)
            played = [record for record in records if record.outcome != FAILED]
            errors = {task: error for model in models.values() for task, error in model.errors.items()}
            if not played:
                raise CommandError(f"{next(iter(errors.values()))} (all of {len(records)} games failed)")
            measures = asdict(summarise(played))
            outcomes = Counter(str(record.outcome) for record in records)
            results.append(
                {
                    **dict(zip(("proposer", "verifier"), names, strict=True)),
                    "success": measures.pop("success_rate"),
                    "remark": _remark(outcomes),
                    "outcomes": dict(sorted(outcomes.items())),
                    **measures,
                }
            )
            for record in records if models else ():
                told = {role.name.lower(): models[role].messages.get(record.task, []) for role in models}
                fields = {**record._asdict(), "outcome": str(record.outcome), "error": errors.get(record.task)}
                games.append({"proposer": names[0], "verifier": names[1], **fields, "messages": told})
            turns += [turn for model in models.values() for each in model.turns.values() for turn in each]
            bar.advance()
    rows = [row_of(result) for result in results]
    print(
        f"{args.configuration}, {args.protocol}, views {args.views or FULL}, {args.split}, {len(chosen)} games each\n"
    )
    print(table(list(rows[0]), [list(row.values()) for row in rows]), LEGEND, sep="\n")
    failed = sum(result["outcomes"].get(FAILED, 0) for result in results)
    told = calls(turns, failed, args.prices and tuple(args.prices))
    print_calls(told)
    write_text(args.out / GAMES, "".join(json.dumps(each, ensure_ascii=False, default=list) + "\n" for each in games))
    write_json(args.out / SUMMARY, {"settings": settings, "failed_games": failed, "results": results, **told})
    print(f"results      {args.out}")
    if failed:
        print(f"failed       {failed} games, not in the rates; the same command plays them again")
    return 0


def _remark(outcomes: Mapping[str, int]) -> str:
    """The games that ended for another reason than the rules'."""
    from lilgym_mp.contrib.llm.game_player import INVALID
    from lilgym_mp.contrib.llm.summary import PROBLEMS
    from lilgym_mp.wrappers.replies import FAILED

    return ", ".join(f"{outcomes[name]} {name}" for name in (*PROBLEMS, INVALID, FAILED) if outcomes.get(name))


class _TurnFile:
    """Adds turns to a file as they come, from threads, for a run that is continued."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()

    def __enter__(self) -> _TurnFile:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._file = self._path.open("a", encoding="utf-8")
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def add(self, names: Seats, role: Role, task: str, turns: Sequence[Turn]) -> None:
        key = {"proposer": names[0], "verifier": names[1], "role": role.name.lower(), "task": task}
        with self._lock:
            for turn in turns:
                self._file.write(json.dumps({**key, "turn": asdict(turn)}, ensure_ascii=False) + "\n")
            self._file.flush()


Recalled = Mapping[tuple[str, str, str], Mapping[str, list["Turn"]]]  # by proposer, verifier and role; then by task


def _recalled(args: argparse.Namespace, settings: Mapping[str, Any]) -> Recalled:
    """The turns of an unfinished run in the directory, whose settings must be the same.

    Raises CommandError for a finished run, and for another one's directory.
    """
    from lilgym_mp.cli.llm_play import check_settings
    from lilgym_mp.contrib.llm.summary import Turn

    found: defaultdict[tuple[str, str, str], defaultdict[str, list[Turn]]] = defaultdict(lambda: defaultdict(list))
    summary, turns = args.out / SUMMARY, args.out / TURNS
    if args.force or not summary.exists():
        for name in (TURNS, GAMES, SUMMARY):
            fresh_file(args.out / name, force=args.force)
        turns.unlink(missing_ok=True)
        write_json(summary, {"settings": settings})
        return found
    before: dict[str, Any] = json.loads(summary.read_text(encoding="utf-8"))
    check_settings(args.out, before.get("settings", {}), settings)
    if "results" in before and not before["failed_games"]:
        raise CommandError(f"{args.out} has this run; --out DIR plays it again, --force overwrites it")
    *lines, cut = turns.read_text(encoding="utf-8").split("\n") if turns.exists() else [""]
    if cut:
        write_text(turns, "".join(f"{line}\n" for line in lines))
    for line in lines:
        each = json.loads(line)
        found[each["proposer"], each["verifier"], each["role"]][each["task"]].append(Turn(**each["turn"]))
    print(f"continues    {args.out}, {len(lines)} answers are there")
    return found


class _Players:
    """Who plays whom, by name."""

    def __init__(
        self, args: argparse.Namespace, game: GameSettings, agent: LanguageAgent, options: Mapping[str, Any]
    ) -> None:
        """Raises CommandError for a partner that cannot play, or a model that does not play games."""
        from lilgym_mp.cli.llm_play import read_agent_options
        from lilgym_mp.contrib.llm.agents import AGENTS, make_agent
        from lilgym_mp.envs.proposer_verifier import Role
        from lilgym_mp.evaluation.game_partners import (
            BUILDER,
            GUIDE,
            TARGET_ONLY,
            can_guide,
            scripted_proposers,
            scripted_verifiers,
        )

        self._args, self._options = args, options
        self._partner_options = read_agent_options(args.partner_option)
        self._name = args.agent if "model" not in options else f"{args.agent} {options['model']}"
        self._models = {self._name: agent}
        dynamics = game.dynamics()
        guides = can_guide(game)
        left_out = () if guides else (GUIDE, BUILDER)
        self._scripted: dict[Role, dict[str, Partner]] = {}
        for role, known in zip(Role, (scripted_proposers(dynamics), scripted_verifiers(dynamics)), strict=True):
            self._scripted[role] = {name: partner for name, partner in known.items() if name not in left_out}
        best = {Role.PROPOSER: (BUILDER,), Role.VERIFIER: (GUIDE,)}
        if not guides:
            best = {Role.PROPOSER: ("expert", "expert-deceptive"), Role.VERIFIER: ("oracle",)}
        role = args.role or BOTH
        seats = list(Role) if role == BOTH else [Role.of(role)]
        named = args.partner or ([] if role == BOTH else best[seats[0].other])
        for name in named:
            if any(name in known for known in self._scripted.values()):
                continue
            if name in AGENTS or ":" in name:
                label = f"{name} {self._partner_options.get('model', '')}".rstrip()
                label = f"{label} (partner)" if label == self._name else label
                self._models[label] = make_agent(name, self._partner_options)
            else:
                self._add_trained(name, game)
        for label, model in self._models.items():
            if hasattr(model, "begin"):
                raise CommandError(
                    f"the agent {label} plays single tasks; as a partner in the game, name a scripted one"
                )
        others = list(self._models)[1:]
        self.pairs: list[Seats] = [(self._name, self._name)] if role == BOTH else []
        for seat in seats:
            partners = [*others, *(name for name in named if name in self._scripted[seat.other])]
            if not partners and role != BOTH:
                choose(f"partner as {seat.other.name.lower()}", named[0], self._scripted[seat.other])
            baselines = ["random", *best[seat][:1]] + ([TARGET_ONLY] if seat is Role.VERIFIER else [])
            for partner in partners:
                players = [self._name, *(baselines if partner in self._scripted[seat.other] else ())]
                self.pairs += [(each, partner) if seat is Role.PROPOSER else (partner, each) for each in players]
        if not args.partner and role == BOTH:
            self.pairs += [(best[Role.PROPOSER][0], best[Role.VERIFIER][0]), ("random", "random")]
        self.pairs = list(dict.fromkeys(self.pairs))

    def _add_trained(self, name: str, game: GameSettings) -> None:
        from lilgym_mp.envs.proposer_verifier import Role
        from lilgym_mp.learning.common.agents import open_agent
        from lilgym_mp.learning.common.learners import shipped_agents

        if not Path(name).exists() and name not in shipped_agents():
            names = ", ".join(dict.fromkeys(each for known in self._scripted.values() for each in known))
            raise CommandError(f"no partner {name!r}; choose a run, from {names}, or an agent as for --agent")
        trained = open_agent(name)
        own = trained.game
        if own is not None and (own.protocol, own.message_sizes()) != (game.protocol, game.message_sizes()):
            told = " and ".join(f"{each.protocol} with {each.message_sizes()} messages" for each in (own, game))
            raise CommandError(f"{name} and this command play different games: {told}")
        for role in Role:
            if (partner := trained.partner(role, game)) is not None:
                self._scripted[role][name] = partner

    def settings(self, tasks_sha256: str | None) -> dict[str, Any]:
        """What determines the games, in clear but for secrets."""
        from lilgym_mp.cli.llm_play import public
        from lilgym_mp.wrappers.replies import THOUGHTS

        names = (
            *("configuration", "protocol", "views", "role", "partner", "words", "agent", "split", "episodes", "scene"),
            *("retries", "history", "seed", "no_legal_actions", "no_system"),
        )
        return {
            **{name: getattr(self._args, name) for name in names},
            **{name: public(name, value) for name, value in sorted(given_environment(self._args).items())},
            "option": {name: public(name, value) for name, value in sorted(self._options.items())},
            "partner_option": {name: public(name, value) for name, value in sorted(self._partner_options.items())},
            "thoughts": list(self._args.thoughts or THOUGHTS),
            "tasks_sha256": tasks_sha256,
        }

    def partners(
        self, names: Seats, recalled: Recalled, file: _TurnFile
    ) -> tuple[list[Partner], dict[Role, LanguagePartner]]:
        """Both partners, and those of them that are language models."""
        from lilgym_mp.envs.proposer_verifier import Role

        notes: dict[int, str] = {}
        models = {
            role: self._model(role, names, recalled, file, notes)
            for role, name in zip(Role, names, strict=True)
            if name in self._models
        }
        return [models.get(role) or self._scripted[role][names[role]] for role in Role], models

    def _model(
        self, role: Role, names: Seats, recalled: Recalled, file: _TurnFile, notes: dict[int, str]
    ) -> LanguagePartner:
        from lilgym_mp.contrib.llm.asking import Asking
        from lilgym_mp.contrib.llm.game_player import LanguagePartner
        from lilgym_mp.wrappers.replies import THOUGHTS

        args, model = self._args, self._models[names[role]]
        return LanguagePartner(
            Asking(model, args.retries, args.history, args.thoughts or THOUGHTS, not args.no_system),
            role,
            scene=args.scene,
            legal_actions=not args.no_legal_actions,
            words=args.words,
            notes=notes,
            concurrency=args.concurrency or getattr(model, "concurrency", None) or 1,
            recalled=recalled.get((*names, role.name.lower())),
            on_turns=lambda task, turns: file.add(names, role, task, turns),
        )
