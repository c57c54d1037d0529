"""A person's play, as text in and text out."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from lilgym_mp.envs.single import LilGymEnv
from lilgym_mp.scene.actions import ActionError, describe
from lilgym_mp.scene.appearances import Appearance
from lilgym_mp.scene.render.characters import ruled, text
from lilgym_mp.wrappers.replies import action_on


class Session:
    """Plays episodes one after another; `say` shows text to the person."""

    def __init__(self, env: LilGymEnv, say: Callable[[str], object], *, coloured: bool) -> None:
        self._env = env
        self._say = say
        self._coloured = coloured
        self._last_result = ""  # result of the last action, as text
        self._episode_over = False
        self._successes: list[bool] = []
        self._rewards: list[float] = []
        self.is_over = False
        self._commands: Mapping[str, Callable[[], object]] = {
            "hint": self._hint,
            "show": self._show,
            "back": lambda: self.begin(task_id=self._env.task.id),
            "next": self.begin,
            "help": lambda: self._say("\n".join([usage(self._env.dynamics.appearance), *HELP])),
            "quit": self._quit,
        }

    def begin(self, seed: int | None = None, task_id: str | None = None) -> None:
        """Starts an episode of the task, by default a random one. Raises ValueError for an unknown task."""
        self._env.reset(seed=seed, options={} if task_id is None else {"task": task_id})
        self._last_result, self._episode_over = "", False
        self._show()

    def answer(self, line: str) -> None:
        """Executes a line of input and shows the result, or an error message."""
        line = line.strip().lower()
        try:
            if line in self._commands:
                self._commands[line]()
            elif line:
                self._act(line)
        except ActionError as error:
            self._say(str(error))

    def _act(self, line: str) -> None:
        if self._episode_over:
            raise ActionError("this episode is over; type next for another task, back for its start, or quit")
        env = self._env
        action = read_action(line, env.dynamics.appearance)
        _, reward, terminated, truncated, info = env.step(action)
        self._rewards.append(float(reward))
        self._last_result = f"{describe(env.dynamics.appearance.decode(action))}: reward {float(reward):+.1f}"
        self._episode_over = terminated or truncated
        if self._episode_over:
            self._successes.append(info["is_success"])
            reason = f" ({info['invalid_reason']})" if "invalid_reason" in info else ""
            outcome = info["outcome"] + reason
            self._last_result += f", {outcome.replace('_', ' ')}"
        self._show()

    def _lines(self) -> list[str]:
        env = self._env
        task = env.task
        left = env.dynamics.horizon - env.state.steps
        lines = [f'"{task.statement}"', f"Make this {str(task.target).lower()}, then stop. Actions left: {left}."]
        return [*lines, self._last_result] if self._last_result else lines

    def _show(self) -> None:
        picture = text(self._env.scene, [], coloured=self._coloured)
        picture = ruled(picture, self._env.dynamics.appearance.grid)
        prompt = ["Type next, back or quit."] if self._episode_over else []
        self._say("\n".join([picture, *self._lines(), *prompt]))

    def _hint(self) -> None:
        from lilgym_mp.solver import Expert

        if self._episode_over:
            raise ActionError("this episode is over; type next or back")
        solution = Expert(self._env).plan()
        if solution.solved:
            self._say(f"try: {describe(solution.actions[0])}   (actions to go: {solution.steps})")
        else:
            self._say(f"no solution found: {solution.reason}")

    def _quit(self) -> None:
        self.is_over = True

    def score(self) -> str:
        """Successes and total reward, in one line."""
        count = len(self._successes)
        ended = "no episode completed" if count == 0 else f"{sum(self._successes)} of {count} episodes succeeded"
        return f"{ended}, reward {sum(self._rewards):+.1f}"


def read_action(line: str, appearance: Appearance) -> int:
    """The index of an action as it is shown, or in words. Raises ActionError."""
    action = action_on(line, appearance)
    if action is None or action < 0:
        raise ActionError(f"{line!r} is not an action; {usage(appearance)}; help lists the commands")
    return action


def usage(appearance: Appearance) -> str:
    """How edits are written."""
    example = f"such as: {describe(appearance.example)}"
    if appearance.grid is None:
        return f"write stop, remove BOX or add BOX COLOUR, {example}"
    columns, rows = appearance.grid
    cell = f"COLUMN, 0 .. {columns - 1}, and ROW, 0 .. {rows - 1}"
    return f"write stop, remove COLUMN ROW or add COLUMN ROW SHAPE COLOUR SIZE, {example}; {cell}"


HELP = (
    "stop             end the episode, once the statement has the target value",
    "hint             show an optimal action",
    "show             show the picture again",
    "next             go to another task",
    "back             restart this task",
    "quit             leave (as do the end of input and Ctrl-C)",
    "Brackets and commas may be left out: add left black is ADD(LEFT, BLACK).",
)
