"""The table of a language model on any server with OpenAI's chat API: single tasks, both seats of the game, and plans.

python examples/table_language_model.py --url http://localhost:8000/v1 --model NAME --episodes 50 --prices 0.1 0.4

Says the calls and the cost before it starts; --yes starts without asking. The same command continues the table.
Without --model it prints the rows of the expert, random actions, the best constant and the agents of the package.
"""

from __future__ import annotations

import argparse
import json
import random
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import islice
from multiprocessing.pool import ThreadPool
from pathlib import Path
from typing import Any, cast

import numpy as np

from lilgym_mp.cli import main as lilgym_mp
from lilgym_mp.cli.llm_play import drawn
from lilgym_mp.cli.llm_runs import check_settings, public, read_agent_options
from lilgym_mp.cli.options import CommandError
from lilgym_mp.contrib.llm import Answer, make_agent
from lilgym_mp.contrib.llm.agents import ModelError
from lilgym_mp.contrib.rlvr import Row, expert_reply, messages_of, rows, score
from lilgym_mp.contrib.rlvr.rows import dynamics_of
from lilgym_mp.envs.proposer_verifier import Partner, Role, env, play_games
from lilgym_mp.envs.proposer_verifier.metrics import summarise
from lilgym_mp.evaluation import Settings, evaluate
from lilgym_mp.evaluation.files import read_json, write_json
from lilgym_mp.evaluation.game_partners import scripted_proposers, scripted_verifiers
from lilgym_mp.evaluation.policies import FunctionPolicy, Policy, built_in_policy
from lilgym_mp.learning.common.agents import AgentError, load_agent
from lilgym_mp.learning.common.learners import shipped_agents
from lilgym_mp.scene.actions import describe

CONFIGURATIONS = ("TowerScratch", "TowerFlipIt", "ScatterScratch", "ScatterFlipIt")
GAME, PROTOCOL = "TowerFlipIt", "audit"
JUDGED = ("expert", "expert-deceptive")  # whose claims a verifier judges
LEVELS = (1, 2, 3, 4, 5)
GROUPS = {
    "Tower Scratch/FlipIt": CONFIGURATIONS[:2],
    "Scatter Scratch/FlipIt": CONFIGURATIONS[2:],
    "proposer/verifier": ("proposer", "verifier"),
    "plans of levels 1/2/3/4/5": tuple(f"level {level}" for level in LEVELS),
}
COLUMNS = tuple(column for columns in GROUPS.values() for column in columns)
SCENES = ("list", "image")
CONSTANTS = 20  # first actions of the constant plans
CALLS = {"proposer": 5, "verifier": len(JUDGED), "level": 1}  # about, in an episode; others 5
READ, WRITTEN = 1_500, 100  # tokens of a call, about
FINISH_REASONS = {"cut": "length", "filtered": "content_filter", "refused": "refusal"}

Figures = dict[str, float]  # by column


def calls(episodes: int, scenes: Sequence[str]) -> int:
    """About how many calls the model's rows take."""
    return len(scenes) * episodes * sum(CALLS.get(name.split()[0], 5) for name in COLUMNS)


def constant(action: int) -> Policy:
    """An action, then STOP."""
    return FunctionPolicy(lambda observations, legal, rng: np.where(observations.steps == 0, action, 0))


def success(policy: Policy, name: str, args: argparse.Namespace) -> float:
    """The share of solved tasks of a configuration."""
    settings = Settings(name, corpus=args.corpus)
    tasks = drawn(settings.tasks("dev"), args.episodes, 0)
    return statistics.mean(episode.is_success for episode in evaluate(policy, settings, "dev", task_ids=tasks))


def seat(role: Role, partner: Partner, args: argparse.Namespace) -> float:
    """A proposer's success with an oracle, or a verifier's J: true claims accepted minus false ones."""
    game: Any = env(GAME, protocol=PROTOCOL, corpus=args.corpus, split="dev")
    tasks = drawn(game.unwrapped.tasks, args.episodes, 0)
    if role is Role.PROPOSER:
        oracle = scripted_verifiers(game.unwrapped.dynamics)["oracle"]
        return summarise(play_games(game, partner, oracle, tasks=tasks)).success_rate
    experts = scripted_proposers(game.unwrapped.dynamics)
    true, false = (summarise(play_games(game, experts[name], partner, tasks=tasks)) for name in JUDGED)
    return (true.true_accept_rate or 0.0) - (false.false_accept_rate or 0.0)


def plans(level: int, count: int) -> list[Row]:
    """Dev plans of a level."""
    return list(islice(rows("plan", "tower", level, seed=8, split="dev"), count))


def random_plan(row: Row, rng: random.Random) -> str:
    """Random legal actions up to STOP."""
    dynamics = dynamics_of(row.appearance)
    state, names = dynamics.start(row.task), list[str]()
    while len(names) < dynamics.horizon and "STOP" not in names:
        action = dynamics.appearance.decode(rng.choice(np.flatnonzero(dynamics.legal_mask(state)).tolist()))
        names.append(describe(action))
        state = dynamics.step(state, action).state
    return "\n".join(names)


def baselines(args: argparse.Namespace) -> Mapping[str, Figures]:
    """The rows of the expert, random legal actions and the best constant."""
    found: dict[str, Figures] = {"expert": {}, "random": {}, "best constant": {}}
    for name in CONFIGURATIONS:
        settings = Settings(name, corpus=args.corpus)
        for row, policy in (("expert", "expert"), ("random", "random-legal")):
            found[row][name] = success(built_in_policy(policy).policy(settings), name, args)
        count = settings.dynamics().appearance.action_count
        tried = random.Random(0).sample(range(1, count), min(CONSTANTS, count - 1))
        found["best constant"][name] = max(success(constant(action), name, args) for action in tried)
    dynamics = dynamics_of("tower")
    proposers, verifiers = scripted_proposers(dynamics), scripted_verifiers(dynamics)
    for role, known, best in ((Role.PROPOSER, proposers, "expert"), (Role.VERIFIER, verifiers, "oracle")):
        for row, name in (("expert", best), ("random", "random")):
            found[row][role.name.lower()] = seat(role, known[name], args)
    found["best constant"]["verifier"] = seat(Role.VERIFIER, verifiers["target-only"], args)
    edits = [describe(dynamics.appearance.decode(index)) for index in range(1, dynamics.appearance.action_count)]
    for level in LEVELS:
        prompts, rng = plans(level, args.episodes), random.Random(0)
        for row, reply in (("expert", expert_reply), ("random", lambda each, rng=rng: random_plan(each, rng))):
            found[row][f"level {level}"] = rate(prompts, reply)
        best_edit = max(rate(prompts, lambda each, edit=edit: f"{edit}\nSTOP") for edit in edits)
        found["best constant"][f"level {level}"] = best_edit
    return found


def rate(prompts: list[Row], reply: Callable[[Row], str]) -> float:
    """The share of prompts that the replies solve."""
    return statistics.mean(score(reply(row), row).reward for row in prompts)


def shipped(args: argparse.Namespace) -> Mapping[str, Figures]:
    """The rows of the agents of the package, where they play."""
    found: dict[str, Figures] = {}
    for agent_name in shipped_agents():
        agent, figures = load_agent(agent_name, "cpu"), Figures()
        for name in agent.description.configurations:
            if name in CONFIGURATIONS:
                figures[name] = success(agent.policy(Settings(name, corpus=args.corpus)), name, args)
        for role in Role:
            try:
                game: Any = env(GAME, corpus=args.corpus).unwrapped
                partner = agent.partner(role, game.engine.game.settings)
            except AgentError:
                continue
            if partner is not None:
                figures[role.name.lower()] = seat(role, partner, args)
        found[agent_name] = figures
    return found


def model_row(args: argparse.Namespace, scene: str) -> Figures:
    """The model's row with one kind of prompts; what is done already is read from --out."""
    figures = Figures()
    for name in CONFIGURATIONS:
        figures[name] = played(args, name, scene)["success"]
    for role, partners in ((Role.PROPOSER, ("oracle",)), (Role.VERIFIER, JUDGED)):
        words = ["--protocol", PROTOCOL, "--role", role.name.lower(), "--partner", *partners]
        results = played(args, GAME, scene, *words)["results"]
        own = [result for result in results if result[role.name.lower()].startswith("openai")]
        if role is Role.PROPOSER:
            figures["proposer"] = own[0]["success"]
        else:
            figures["verifier"] = (own[0]["true_accept_rate"] or 0) - (own[1]["false_accept_rate"] or 0)
    for level in LEVELS:
        figures[f"level {level}"] = statistics.mean(answered(args, level, scene))
    return figures


def check_run(args: argparse.Namespace) -> None:
    """Stores the settings in --out, or ends with an error if a table with other settings was begun there."""
    options = {"url": args.url, "model": args.model, **read_agent_options(args.option)}
    settings = {"option": public("", options), "episodes": args.episodes, "corpus": args.corpus}
    path = args.out / "settings.json"
    if path.exists():
        check_settings(args.out, read_json(path), settings)
    else:
        args.out.mkdir(parents=True, exist_ok=True)
        write_json(path, settings)


def played(args: argparse.Namespace, name: str, scene: str, *more: str) -> dict[str, Any]:
    """The summary of `lilgym-mp llm play`, which is run if needed."""
    out = args.out / "-".join((name, scene, *more[3:4]))
    summary = out / "summary.json"
    before: dict[str, Any] = json.loads(summary.read_text()) if summary.exists() else {}
    if "answers" not in before or before.get("failed_games") or before.get("failed_episodes"):
        options = [f"url={args.url}", f"model={args.model}", *args.option]
        words = ["llm", "play", name, "--agent", "openai", "--option", *options, "--episodes", str(args.episodes)]
        words += ["--scene", scene, "--corpus", args.corpus, "--out", str(out), *more]
        words += ["--no-legal-actions"] if scene == "image" else []
        words += ["--resume"] if before and not more else []
        if lilgym_mp(words):
            raise SystemExit("the same command continues the table")
    return json.loads(summary.read_text())


def answered(args: argparse.Namespace, level: int, scene: str) -> Iterable[float]:
    """The rewards of the model's plans of a level; each is kept as soon as it is known."""
    out = args.out / f"level-{level}-{scene}.json"
    rewards: dict[str, float] = json.loads(out.read_text()) if out.exists() else {}
    prompts = [row for row in plans(level, args.episodes) if row.id not in rewards]
    if prompts:
        agent = make_agent("openai", {"url": args.url, "model": args.model, **read_agent_options(args.option)})
        try:
            with ThreadPool(32) as pool:
                answers = pool.imap(lambda row: agent.answer(messages_of(row, scene)), prompts)
                for row, answer in zip(prompts, cast("Iterable[Answer]", answers), strict=True):
                    rewards[row.id] = reward(answer, row)
                    out.write_text(json.dumps(rewards))
        except ModelError as error:
            raise SystemExit(f"{error}; the same command continues the table") from None
    return rewards.values()


def reward(answer: Answer, row: Row) -> float:
    """That of a plan; an answer that is not the model's has none."""
    return score(answer.text, row, finish_reason=FINISH_REASONS.get(answer.problem or "")).reward


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url", help="of the server (default: OpenAI's)")
    parser.add_argument("--model")
    parser.add_argument("--option", nargs="+", default=[], metavar="KEY=VALUE", help="others of the agent openai")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=SCENES, help="list alone for a model of texts")
    parser.add_argument("--episodes", type=int, default=50, help="in each cell (default: 50)")
    parser.add_argument("--corpus", default="builtin")
    parser.add_argument("--prices", type=float, nargs=2, metavar=("READ", "WRITTEN"), help="of a million tokens")
    parser.add_argument("--out", type=Path, default=Path("runs/table"))
    parser.add_argument("--yes", action="store_true", help="start without asking")
    args = parser.parse_args()
    args.url = args.url or "https://api.openai.com/v1"
    if args.model:
        count = calls(args.episodes, args.scenes)
        told = f"about {count:,} calls, {count * READ / 1e6:.2g} M tokens read, {count * WRITTEN / 1e6:.2g} M written"
        cost = count * (READ * args.prices[0] + WRITTEN * args.prices[1]) / 1e6 if args.prices else None
        print(told if cost is None else f"{told}: {cost:.4g} at these prices")
        if not args.yes and input("Start? [y/N] ").strip().lower() not in ("y", "yes"):
            return
        try:
            check_run(args)
        except CommandError as error:
            raise SystemExit(str(error)) from None
    found = {**baselines(args), **shipped(args)}
    for scene in args.scenes if args.model else ():
        found[f"{args.model}, {'text' if scene == 'list' else 'image'}"] = model_row(args, scene)
    print(f"\n| player | {' | '.join(GROUPS)} |\n|---|{'---:|' * len(GROUPS)}")
    for name, figures in found.items():
        shown = {column: f"{100 * figures[column]:.0f}" if column in figures else "-" for column in COLUMNS}
        print(f"| {name} | {' | '.join('/'.join(map(shown.__getitem__, group)) for group in GROUPS.values())} |")


if __name__ == "__main__":
    main()
