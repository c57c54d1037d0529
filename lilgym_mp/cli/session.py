"""A person's play: from what is typed to what is shown."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from lilgym_mp.appearances import Scatter
from lilgym_mp.arrays import UInt8Array
from lilgym_mp.cli.commands import VERBS, CommandFault, chosen, command_help, command_of, legal_commands, parsed
from lilgym_mp.envs.single import LilGymEnv
from lilgym_mp.evaluation.film import save_gif
from lilgym_mp.render import text
from lilgym_mp.render.frames import frame
from lilgym_mp.render.ruler import ruled


class Session:
    """Episodes played one after another; `say` shows lines to the person."""

    def __init__(self, env: LilGymEnv, say: Callable[[str], object], *, coloured: bool) -> None:
        self._env = env
        self._say = say
        self._coloured = coloured
        self._news = ""  # what the last action did
        self._episode_over = False
        self._frames: list[UInt8Array] = []
        self._successes: list[bool] = []
        self._rewards: list[float] = []
        self.is_over = False
        self._others: Mapping[str, Callable[[], object]] = {
            "hint": self._hint,
            "legal": self._legal,
            "show": self._show,
            "back": lambda: self.begin(task_id=self._env.task.id),
            "next": self.begin,
            "help": self._help,
            "quit": self._quit,
        }

    def begin(self, seed: int | None = None, task_id: str | None = None) -> None:
        """Starts an episode of the task, or of one drawn. Raises ValueError for an unknown task."""
        self._env.reset(seed=seed, options={} if task_id is None else {"task": task_id})
        self._news, self._episode_over = "", False
        self._film()
        self._show()

    def answer(self, line: str) -> None:
        """Does what a line of input says, and shows it; explains what it cannot make out."""
        words = line.lower().replace(",", " ").split()
        if not words:
            return
        try:
            name = chosen("command", words[0], {name: name for name in (*VERBS, *self._others)})
            if name in VERBS:
                self._act([name, *words[1:]])
            elif len(words) > 1:
                raise CommandFault(f"{name} takes no more words; did you mean add or remove?")
            else:
                self._others[name]()
        except CommandFault as error:
            self._say(f"{error}")

    def _act(self, words: list[str]) -> None:
        if self._episode_over:
            raise CommandFault("this episode is over; type next for another task, back for its start, or quit")
        env = self._env
        action = parsed(words, env.dynamics.appearance)
        _, reward, terminated, truncated, info = env.step(env.dynamics.appearance.encode(action))
        self._rewards.append(float(reward))
        self._news = f"{command_of(action)}: reward {float(reward):+.1f}"
        self._episode_over = terminated or truncated
        if self._episode_over:
            self._successes.append(info["is_success"])
            reason = f" ({info['invalid_reason']})" if "invalid_reason" in info else ""
            outcome = info["outcome"] + reason
            self._news += f", {outcome.replace('_', ' ')}"
        self._film()
        self._show()

    def _lines(self) -> list[str]:
        env = self._env
        task = env.task
        left = env.dynamics.horizon - env.state.steps
        lines = [f'"{task.statement}"', f"Make this {str(task.target).lower()}, then stop. Actions left: {left}."]
        return [*lines, self._news] if self._news else lines

    def _show(self) -> None:
        picture = text(self._env.scene, [], coloured=self._coloured)
        appearance = self._env.dynamics.appearance
        if isinstance(appearance, Scatter):
            picture = ruled(picture, appearance.grid)
        prompt = ["Type next, back or quit."] if self._episode_over else []
        self._say("\n".join([picture, *self._lines(), *prompt]))

    def _film(self) -> None:
        self._frames.append(frame(self._env.scene, self._lines(), self._env.dynamics.appearance))

    @property
    def picture(self) -> UInt8Array:
        """(304, 784, 3) the scene with its lines, as it is now."""
        return self._frames[-1]

    def _hint(self) -> None:
        from lilgym_mp.solver import Expert

        if self._episode_over:
            raise CommandFault("this episode is over; type next or back")
        solution = Expert(self._env).plan()
        if solution.solved:
            self._say(f"try: {command_of(solution.actions[0])}   (actions to go: {solution.steps})")
        else:
            self._say(f"no idea: {solution.reason}")

    def _legal(self) -> None:
        legal = np.flatnonzero(self._env.action_masks())
        self._say("\n".join(legal_commands(self._env.dynamics.appearance, legal.tolist())))

    def _help(self) -> None:
        self._say("\n".join([*command_help(self._env.dynamics.appearance), *HELP]))

    def _quit(self) -> None:
        self.is_over = True

    def save_film(self, path: Path) -> bool:
        """Writes all that was shown as a GIF, if there was anything; gives whether."""
        if self._frames:
            save_gif(path, self._frames)
        return bool(self._frames)

    def score(self) -> str:
        """How it went, in a line."""
        count = len(self._successes)
        ended = "no episode ended" if count == 0 else f"{sum(self._successes)} of {count} episodes succeeded"
        return f"{ended}, reward {sum(self._rewards):+.1f}"


HELP = (
    "stop             say that the statement now is as wanted",
    "hint             one good action",
    "legal            what can be done now",
    "show             the picture again",
    "next             another task",
    "back             this task again, from its start",
    "quit             leave (so does the end of input, or Ctrl-C)",
    "Words may be cut short: a l bla is add left black.",
)
