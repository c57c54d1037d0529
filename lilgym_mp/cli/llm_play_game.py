"""Plays the proposer-verifier game with a language model in one seat, or in both, for `lilgym-mp llm play`."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, TextIO

from lilgym_mp.cli.llm_runs import (
    check_settings,
    default_directory,
    drawn,
    print_calls,
    public,
    read_agent_options,
    stored,
    stored_settings,
)
from lilgym_mp.cli.options import JSON, CommandError, add_number, check_at_least, given_environment
from lilgym_mp.evaluation.files import (
    fresh_file,
    json_line,
    locked,
    read_lines,
    writable_directory,
    write_json,
    write_lines,
)
from lilgym_mp.evaluation.terminal import Progress
from lilgym_mp.scene.choices import choose, flag_name
from lilgym_mp.scene.grouping import grouped

if TYPE_CHECKING:
    from lilgym_mp.contrib.llm import LanguageAgent
    from lilgym_mp.contrib.llm.game_player import LanguagePartner
    from lilgym_mp.contrib.llm.summary import Turn
    from lilgym_mp.envs.proposer_verifier import GameSettings, Partner
    from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv
    from lilgym_mp.envs.proposer_verifier.metrics import GameRecord

TURNS = "turns.jsonl"
GAMES = "transcripts.jsonl"
SUMMARY = "summary.json"
PROTOCOLS = ("veto", "audit", "critique", "joint")
FULL = "full"
BOTH = "both"
GAME_OPTIONS = ("views", "role", "partner", "words")
PARTNER_OPTION = "partner_option"
SEATS = ("proposer", "verifier")
KEY = (*SEATS, "role")  # of stored answers
BEST = {"proposer": ("expert", "expert-deceptive"), "verifier": ("oracle",)}
BEST_GUIDED = {"proposer": ("builder",), "verifier": ("guide",)}
BASELINES = {"proposer": ("random",), "verifier": ("random", "target-only")}  # besides the best


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the two-agent game to those of `lilgym-mp llm play`."""
    group = parser.add_argument_group("two-agent game")
    group.add_argument("--protocol", choices=PROTOCOLS, help="play the proposer-verifier game instead")
    group.add_argument(
        "--views", choices=("guide", FULL), help="guide: only the verifier knows the statement (default: full)"
    )
    group.add_argument("--role", choices=(*SEATS, BOTH), help="the model's seats (default: both)")
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
        for name in (*GAME_OPTIONS, PARTNER_OPTION):
            if getattr(args, name):
                raise CommandError(
                    f"--{flag_name(name)} is for the two-agent game; add --protocol {'|'.join(PROTOCOLS)}"
                )
    return args.protocol is not None


def run(args: argparse.Namespace, agent: LanguageAgent, agent_options: JSON) -> int:
    """Plays games with a language model, and prints and writes a table of all pairs of players."""
    from lilgym_mp.envs.proposer_verifier import GameSettings
    from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv
    from lilgym_mp.evaluation.game_partners import scripted_partners

    check_at_least(args, 0, "words")
    partner_options = read_agent_options(args.partner_option)
    views = {"views": "guide"} if args.views == "guide" else {}
    game = GameSettings(
        args.configuration, protocol=args.protocol, split=args.split, **views, **given_environment(args)
    )
    env = BaseGameEnv(**vars(game))
    model = str(agent_options.get("model", ""))
    models = {f"{args.agent} {model}".rstrip(): agent}
    scripted = {role.name.lower(): known for role, known in scripted_partners(game).items()}
    pairs = _pairs(args, models, scripted, game)
    settings = {
        **stored_settings(args, ("configuration", "protocol", "episodes", *GAME_OPTIONS), env.tasks.provenance.sha256),
        **{name: public(name, value) for name, value in given_environment(args).items()},
        PARTNER_OPTION: public("", partner_options),
    }
    args.out = args.out or default_directory("llm-game", args.configuration, args.protocol, args.agent, model)
    secrets = {**agent_options, PARTNER_OPTION: partner_options}
    with locked(writable_directory(args.out)):
        return _play(args, env, pairs, models, scripted, settings, secrets)


def _play(
    args: argparse.Namespace,
    env: BaseGameEnv,
    pairs: Sequence[Mapping[str, str]],
    models: Mapping[str, LanguageAgent],
    scripted: Mapping[str, Mapping[str, Partner]],
    settings: JSON,
    secrets: JSON,
) -> int:
    """Plays the games of all pairs with answers that are not there yet; prints and writes the table."""
    from lilgym_mp.cli.evaluate_game import LEGEND, games_table
    from lilgym_mp.contrib.llm.agents import without_secrets
    from lilgym_mp.contrib.llm.summary import calls
    from lilgym_mp.envs.proposer_verifier import play_games
    from lilgym_mp.wrappers.replies import FAILED

    recalled = _answered(args, settings)
    chosen = drawn(env.tasks, args.episodes, args.seed)
    results: list[JSON] = []
    games: list[JSON] = []
    turns: list[Turn] = []
    with (args.out / TURNS).open("a", encoding="utf-8") as file, Progress(len(pairs), "pairs", prints=False) as bar:
        for pair in pairs:
            notes: dict[int, str] = {}
            talking = {
                seat: _talking(
                    args, models[name], {**pair, "role": seat}, recalled.get((*pair.values(), seat), []), notes, file
                )
                for seat, name in pair.items()
                if name in models
            }
            players = [talking.get(seat) or scripted[seat][name] for seat, name in pair.items()]
            records = play_games(env, *players, tasks=chosen, seed=args.seed)
            errors = {
                task: without_secrets(error, secrets)
                for each in talking.values()
                for task, error in each.errors.items()
            }
            results.append({**pair, **_measured(records, errors)})
            for record in records if talking else ():
                told = {seat: each.messages.get(record.task, []) for seat, each in talking.items()}
                fields = {**record._asdict(), "outcome": str(record.outcome), "error": errors.get(record.task)}
                games.append({**pair, **fields, "messages": told})
            turns += [turn for each in talking.values() for asked in each.turns.values() for turn in asked]
            bar.advance()
    print(
        f"{args.configuration}, {args.protocol}, views {args.views or FULL}, {args.split}, {len(chosen)} games each\n"
    )
    print(games_table(results), LEGEND, sep="\n")
    failed = sum(result["outcomes"].get(FAILED, 0) for result in results)
    told = calls(turns, failed, args.prices and tuple(args.prices))
    print_calls(told)
    write_lines(args.out / GAMES, games)
    write_json(args.out / SUMMARY, {"settings": settings, "failed_games": failed, "results": results, **told})
    print(f"results      {args.out}")
    if failed:
        print(f"failed       {failed} games, not in the rates; the same command plays them again")
    return 0


def _measured(records: Sequence[GameRecord], errors: Mapping[str, str]) -> JSON:
    """Measures of the games that did not fail. Raises CommandError if all did."""
    from lilgym_mp.contrib.llm.game_player import INVALID
    from lilgym_mp.contrib.llm.summary import PROBLEMS
    from lilgym_mp.envs.proposer_verifier.metrics import summarise
    from lilgym_mp.wrappers.replies import FAILED

    played = [record for record in records if record.outcome != FAILED]
    if not played:
        raise CommandError(f"{next(iter(errors.values()))} (all of {len(records)} games failed)")
    measures = asdict(summarise(played))
    outcomes = Counter(str(record.outcome) for record in records)
    unusual = [f"{outcomes[name]} {name}" for name in (*PROBLEMS, INVALID, FAILED) if outcomes[name]]
    success = {"success": measures.pop("success_rate"), "remark": ", ".join(unusual)}
    return {**success, "outcomes": dict(sorted(outcomes.items())), **measures}


def _answered(args: argparse.Namespace, settings: JSON) -> Mapping[tuple[str, ...], list[tuple[str, Turn]]]:
    """The tasks and answers of an unfinished run in the directory, by KEY; its settings must be the same.

    Raises CommandError for a finished run, and for another one's directory.
    """
    from lilgym_mp.contrib.llm.summary import Turn

    path = args.out / SUMMARY
    turns = args.out / TURNS
    known: list[Any] = []
    if (args.resume or path.exists()) and not args.force:
        try:
            summary, before = stored(path)
            known = read_lines(turns) if turns.exists() else []
            answered = grouped(
                (tuple(str(each[name]) for name in KEY), (str(each["task"]), Turn(**each["turn"]))) for each in known
            )
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise CommandError(f"{args.out}: no run to continue ({type(error).__name__}: {error})") from None
        check_settings(args.out, before, settings)
        if "results" in summary and not summary.get("failed_games"):
            raise CommandError(f"{args.out} has this run; --out DIR plays it again, --force overwrites it")
        print(f"continues    {args.out}, {len(known)} answers are there")
    else:
        answered = {}
        for name in (TURNS, GAMES, SUMMARY):
            fresh_file(args.out / name, force=args.force)
        write_json(path, {"settings": settings})
    write_lines(turns, known)
    return answered


def _talking(
    args: argparse.Namespace,
    model: LanguageAgent,
    seat: Mapping[str, str],
    recalled: Sequence[tuple[str, Turn]],
    notes: dict[int, str],
    file: TextIO,
) -> LanguagePartner:
    """A language model in a seat, whose new answers are added to the file as they come, from threads."""
    from lilgym_mp.contrib.llm.asking import Asking
    from lilgym_mp.contrib.llm.game_player import LanguagePartner
    from lilgym_mp.envs.proposer_verifier import Role
    from lilgym_mp.wrappers.replies import THOUGHTS

    lock = Lock()

    def keep(task: str, turns: Sequence[Turn]) -> None:
        with lock:
            file.write("".join(json_line({**seat, "task": task, "turn": asdict(turn)}) for turn in turns))
            file.flush()

    return LanguagePartner(
        Asking(model, args.retries, args.history, args.thoughts or THOUGHTS, not args.no_system),
        Role.of(seat["role"]),
        scene=args.scene,
        legal_actions=not args.no_legal_actions,
        words=args.words,
        notes=notes,
        concurrency=args.concurrency or getattr(model, "concurrency", None) or 1,
        recalled=grouped(recalled),
        on_turns=keep,
    )


def _pairs(
    args: argparse.Namespace,
    models: dict[str, LanguageAgent],
    scripted: Mapping[str, dict[str, Partner]],
    game: GameSettings,
) -> list[dict[str, str]]:
    """The names of who plays whom, by seat. Adds partners to the models, or to the scripted ones if they are trained.

    Raises CommandError for a partner that cannot play, or a model that does not play games.
    """
    (own,) = models
    best = BEST_GUIDED if "guide" in scripted["verifier"] else BEST
    seats = [seat for seat in SEATS if args.role in (None, BOTH, seat)]
    others = [seat for seat in SEATS if seat not in seats]
    named = args.partner or [name for seat in others for name in best[seat]]
    for name in named:
        if not any(name in known for known in scripted.values()):
            _add_partner(name, models, scripted, game, args)
    for label, model in models.items():
        if hasattr(model, "begin"):
            raise CommandError(f"the agent {label} plays single tasks; as a partner in the game, name a scripted one")
    pairs = [] if others else [(own, own)]
    for seat in seats:
        (other,) = {*SEATS} - {seat}
        fitting = [name for name in named if name in scripted[other]]
        partners = [*list(models)[1:], *fitting]
        if others and not partners:
            choose(f"partner as {other}", named[0], scripted[other])
        for partner in partners:
            beside = (*BASELINES[seat], best[seat][0]) if partner in fitting else ()
            pairs += [(each, partner) if seat == SEATS[0] else (partner, each) for each in (own, *beside)]
    if not args.partner and not others:
        pairs += [(best["proposer"][0], best["verifier"][0]), ("random", "random")]
    return [dict(zip(SEATS, pair, strict=True)) for pair in dict.fromkeys(pairs)]


def _add_partner(
    name: str,
    models: dict[str, LanguageAgent],
    scripted: Mapping[str, dict[str, Partner]],
    game: GameSettings,
    args: argparse.Namespace,
) -> None:
    """Adds another model, or a trained agent in the seats that it can take."""
    from lilgym_mp.contrib.llm.agents import AGENTS, make_agent
    from lilgym_mp.envs.proposer_verifier import Role
    from lilgym_mp.learning.common.agents import open_agent
    from lilgym_mp.learning.common.learners import shipped_agents

    if name in AGENTS or ":" in name:
        options = read_agent_options(args.partner_option)
        label = f"{name} {options.get('model', '')}".rstrip()
        models[f"{label} (partner)" if label in models else label] = make_agent(name, options)
        return
    if not Path(name).exists() and name not in shipped_agents():
        names = ", ".join(dict.fromkeys(each for known in scripted.values() for each in known))
        raise CommandError(f"no partner {name!r}; choose a run, from {names}, or an agent as for --agent")
    trained = open_agent(name)
    own = trained.game
    if own is not None and (own.protocol, own.message_sizes()) != (game.protocol, game.message_sizes()):
        told = " and ".join(f"{each.protocol} with {each.message_sizes()} messages" for each in (own, game))
        raise CommandError(f"{name} and this command play different games: {told}")
    for role in Role:
        if (partner := trained.partner(role, game)) is not None:
            scripted[role.name.lower()][name] = partner
