"""Play in the terminal, alone or as an agent of the two-agent game.

Edit the scene until the statement has the target truth value, then stop; type help for the commands. With --protocol or
--as, play one agent or both of the game of a proposer and a verifier.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from lilgym_mp.cli.options import (
    add_configuration,
    add_settings,
    argument_type,
    given_settings,
    split_of,
)
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.proposer_verifier.protocols import AGENTS, PROTOCOLS
from lilgym_mp.envs.single import LilGymEnv
from lilgym_mp.evaluation.episodes import outcome_words
from lilgym_mp.evaluation.terminal import shows_colours
from lilgym_mp.scene.actions import ActionError, describe
from lilgym_mp.scene.appearances import Appearance
from lilgym_mp.scene.appearances.places import places_of
from lilgym_mp.scene.arrays import AnyDict
from lilgym_mp.scene.choices import choose
from lilgym_mp.scene.render.characters import ruled, text
from lilgym_mp.wrappers.replies import action_on

if TYPE_CHECKING:
    from lilgym_mp.envs.proposer_verifier.engine import BaseGameEnv

PARTNERS = {"proposer": "oracle", "verifier": "helpful", "both": "random"}  # default partner by the person's side
MOST_LISTED = 13  # legal actions shown
SIDES = {"proposer": AGENTS[:1], "verifier": AGENTS[1:], "both": AGENTS}


def add_options(parser: ArgumentParser) -> None:
    """Adds the options of `lilgym-mp play`."""
    add_configuration(parser, nargs="?", default="TowerScratch")
    parser.add_argument("--split", choices=list(SPLITS), help="split of the corpus (default: the task's, else dev)")
    parser.add_argument("--task", metavar="ID", help="begin with this task (default: a random one)")
    parser.add_argument("--seed", type=argument_type(int), metavar="N", help="random seed (default: not seeded)")
    game = parser.add_argument_group("two-agent game")
    game.add_argument("--protocol", choices=list(PROTOCOLS), help="of the game (default with --as: veto)")
    game.add_argument("--as", dest="side", choices=list(SIDES), help="agent to play (default: proposer)")
    game.add_argument(
        "--partner",
        metavar="NAME",
        help="scripted policy of the other agent, such as oracle, helpful, deceptive, random (default: oracle as "
        "verifier, helpful as proposer)",
    )
    add_settings(parser)


def run(args: Namespace) -> int:
    """Lets a person play episodes, or one side of the game, in the terminal."""
    settings = EnvConfig(**given_settings(args))
    split = split_of(settings, args.split, args.task)
    if args.protocol or args.side or args.partner:
        return _play_game(settings, split, args)
    session = Session(settings.make(split))
    with suppress(KeyboardInterrupt):
        session.begin(seed=args.seed, task_id=args.task)
        for line in _input_lines():
            session.answer(line)
    print(session.score())
    return 0


def _input_lines() -> Iterator[str]:
    """Lines of standard input to its end, "quit" or Ctrl-C, echoed unless it is a terminal, which gets line editing."""
    with suppress(ImportError):  # importing it adds editing and a history to `input`
        import readline  # noqa: F401
    while True:
        try:
            line = input("> ").strip()
        except (EOFError, KeyboardInterrupt):
            print()
            return
        if not sys.stdin.isatty():
            print(line)
        if line.lower() in ("quit", "q"):
            return
        yield line


class Session:
    """A person's episodes, one after another, as text."""

    def __init__(self, env: LilGymEnv) -> None:
        self._env = env
        self._last_result = ""  # result of the last action, as text
        self._episode_over = False
        self._successes: list[bool] = []
        self._reward = 0.0  # of all episodes
        self._commands: Mapping[str, Callable[[], object]] = {
            "hint": self._hint,
            "show": self._show,
            "back": lambda: self.begin(task_id=self._env.task.id),
            "next": self.begin,
            "help": self._help,
            "?": self._help,
        }

    def begin(self, seed: int | None = None, task_id: str | None = None) -> None:
        """Starts an episode of the task, by default a random one. Raises ValueError for an unknown task."""
        self._env.reset(seed=seed, options={} if task_id is None else {"task": task_id})
        self._last_result = ""
        self._episode_over = False
        self._show()

    def answer(self, line: str) -> None:
        """Executes a line of input and shows the result, or an error message."""
        line = line.lower()
        try:
            if line in self._commands:
                self._commands[line]()
            elif line:
                self._act(line)
        except ActionError as error:
            print(error)

    def _act(self, line: str) -> None:
        if self._episode_over:
            raise ActionError("this episode is over; type next for another task, back for its start, or quit")
        appearance = self._env.dynamics.appearance
        action = read_action(line, appearance)
        _, reward, terminated, truncated, info = self._env.step(action)
        self._reward += float(reward)
        self._last_result = f"{describe(appearance.decode(action))}: reward {float(reward):+.1f}"
        self._episode_over = terminated or truncated
        if self._episode_over:
            self._successes.append(info["is_success"])
            reason = f" ({info['invalid_reason']})" if "invalid_reason" in info else ""
            self._last_result += f", {outcome_words(info['outcome'] + reason)}"
        self._show()

    def _show(self) -> None:
        env = self._env
        task = self._env.task
        left = env.dynamics.horizon - env.state.steps
        print(f'"{task.statement}"\nMake this {str(task.target).lower()}, then stop. Actions left: {left}.')
        print(ruled(text(env.scene, [], coloured=shows_colours()), env.dynamics.appearance.grid))
        print(LEGEND)
        if self._last_result:
            print(self._last_result)
        if self._episode_over:
            print("Type next, back or quit.")

    def _help(self) -> None:
        print("\n".join([usage(self._env.dynamics.appearance), *HELP]))

    def _hint(self) -> None:
        from lilgym_mp.scene.appearances import UnsupportedAppearance
        from lilgym_mp.solver import Expert

        if self._episode_over:
            raise ActionError("this episode is over; type next or back")
        try:
            expert = Expert(self._env)
        except UnsupportedAppearance as error:
            raise ActionError(str(error)) from None
        solution = expert.plan()
        if solution.solved:
            print(f"try: {describe(solution.actions[0])}   (actions to go: {solution.steps})")
        else:
            print(f"no solution found: {solution.reason}")

    def score(self) -> str:
        """Successes and total reward, in one line."""
        count = len(self._successes)
        ended = "no episode completed" if count == 0 else f"{sum(self._successes)} of {count} episodes succeeded"
        return f"{ended}, reward {self._reward:+.1f}"


def read_action(line: str, appearance: Appearance) -> int:
    """The index of an action as it is shown, or in words. Raises ActionError."""
    action = action_on(line, appearance)
    if action is None or action < 0:
        raise ActionError(f"{line!r} is not an action; {usage(appearance)}; help lists the commands")
    return action


def usage(appearance: Appearance) -> str:
    """How edits are written."""
    places = places_of(appearance.grid)
    remove, add = (" ".join(fields).upper() for fields in (places.fields, appearance.example._fields))
    forms = f"write stop, remove {remove} or add {add}, such as: {describe(appearance.example)}"
    return "; ".join((forms, *places.limits))


LEGEND = "o circle, # square, ^ triangle; y yellow, k black, b blue. q quits, ? helps."
HELP = (
    "stop             end the episode, once the statement has the target value",
    "hint             show an optimal action",
    "show             show the picture again",
    "next             go to another task",
    "back             restart this task",
    "quit             leave (as do q, the end of input and Ctrl-C)",
    "Brackets and commas may be left out: add left black is ADD(LEFT, BLACK).",
)


def _play_game(settings: EnvConfig, split: str, args: Namespace) -> int:
    """Plays one game of the person and a scripted partner to its end."""
    from lilgym_mp.envs.proposer_verifier import SCRIPTED, PartnerTurn, parallel_env

    side = args.side or "proposer"
    partner = choose("partner", args.partner or PARTNERS[side], SCRIPTED)
    game = parallel_env(settings.id, protocol=args.protocol or "veto", **settings.arguments(split))
    game.reset(seed=args.seed, options={} if args.task is None else {"task": args.task})
    engine = game.engine
    lines = _input_lines()
    rng = np.random.default_rng(args.seed)
    rewards = np.zeros(len(AGENTS))
    info: AnyDict = {}
    print(f'"{game.task.statement}"\nMake this {str(game.task.target).lower()}. You are {" and ".join(SIDES[side])}.')
    while engine.movers:
        print(text(game.scene, [], coloured=shows_colours()))
        actions: list[int | None] = [None, None]
        for role in engine.movers:
            turn = PartnerTurn(engine.games, role, rng)
            agent = AGENTS[role]
            if agent in SIDES[side]:
                actions[role] = _read_action(game, agent, np.flatnonzero(turn.action_mask).tolist(), lines)
                if actions[role] is None:
                    print("quit before the end of the game")
                    return 0
            else:
                chosen = actions[role] = int(partner(turn))
                print(f"{agent}: {game.describe_action(agent, chosen)}")
        earned, _, _, (info, _) = engine.step(*actions)
        rewards += earned
    print(text(game.scene, [], coloured=shows_colours()))
    totals = ", ".join(f"{agent} {reward:+.1f}" for agent, reward in zip(AGENTS, rewards, strict=True))
    print(f"{outcome_words(info['outcome'])}; {totals}")
    return 0


def _read_action(game: BaseGameEnv, agent: str, legal: Sequence[int], lines: Iterator[str]) -> int | None:
    """The index of the person's action; None if they quit."""
    names = [game.describe_action(agent, index) for index in legal]
    print(f"{agent}, one of: {', '.join(names[:MOST_LISTED])}{', ...' if len(names) > MOST_LISTED else ''}")
    for line in lines:
        try:
            action = game.read_action(agent, line)
        except ActionError as error:
            print(error)
            continue
        if action in legal:
            return action
        print(f"{line} is not legal now")
    return None
