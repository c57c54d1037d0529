"""Mutation testing: breaks one rule after another in a copy of the project, and checks that tests fail.

Each of BREAKS changes one piece of code and names the tests of which one must fail. They are run until the first
failure. With LILGYM_DATA and LILGYM_GOLDEN, they include tests of official tasks and recorded behaviour.
Run from the root of a checkout: python -m tests.stress.broken_rules [--only "reward of a step"]
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent.parent
IGNORED = shutil.ignore_patterns(".*", "build", "dist", "*.egg-info")
_FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+?::[^\s\[]+|\S+\.py)", re.MULTILINE)


class Break(NamedTuple):
    """A rule and how to break it: `right`, which occurs exactly once in the file, is replaced by `wrong`."""

    rule: str
    file: str
    right: str
    wrong: str
    tests: tuple[str, ...]


APPEARANCES, ENVS, GAME = "lilgym_mp/appearances", "lilgym_mp/envs", "lilgym_mp/envs/proposer_verifier"
LEARNING, PROGRAMS = "lilgym_mp/learning", "lilgym_mp/programs"
BREAKS = (
    Break("reward of a step", "lilgym_mp/rules.py", "STEP_COST = 0.1", "STEP_COST = 0.2", ("tests/test_rules.py",)),
    Break(
        "STOP succeeds if the statement has the target value",
        "lilgym_mp/task.py",
        "compile_program(self.program)(scene) == self.target",
        "compile_program(self.program)(scene)",
        ("tests/test_task.py", "tests/test_rules.py"),
    ),
    Break(
        "last action before the horizon",
        "lilgym_mp/rules.py",
        "result = self._of_edit[invalid is None][steps >= self.horizon]",
        "result = self._of_edit[invalid is None][steps > self.horizon]",
        ("tests/test_rules.py",),
    ),
    Break(
        "flags of an invalid action under the release rules",
        "lilgym_mp/rules.py",
        "Outcome.INVALID_ACTION: OutcomeSignal(-1.0, terminated=False, truncated=True)",
        "Outcome.INVALID_ACTION: OutcomeSignal(-1.0, terminated=True, truncated=False)",
        ("tests/fidelity", "tests/test_rules.py"),
    ),
    Break(
        "an item snaps to the first of several equally near items",
        f"{APPEARANCES}/placement.py",
        "if code < smallest:",
        "if code <= smallest:",
        ("tests/appearances/test_scatter.py",),
    ),
    Break(
        "maximum snapping distance",
        f"{APPEARANCES}/placement.py",
        "frame_x = box_index * BOX_PITCH if rules.rounds_in_image else 0",
        "frame_x = 0\n    if placement_tables().closest(footprint, x, y, [closest])[0] > SNAP_REACH:"
        "\n        return x, y",
        ("tests/appearances/test_scatter.py",),
    ),
    Break(
        "nearest points are truncated in the image under the release rules",
        f"{APPEARANCES}/placement.py",
        "frame_x = box_index * BOX_PITCH if rules.rounds_in_image else 0",
        "frame_x = 0",
        ("tests/appearances", "tests/fidelity"),
    ),
    Break(
        "touching items do not overlap",
        f"{APPEARANCES}/placement.py",
        "closest(footprint, x, y, items)[0] != OVERLAPPING",
        "closest(footprint, x, y, items)[0] > OVERLAPPING + 1",
        ("tests/appearances/test_scatter.py",),
    ),
    Break(
        "search order in a cell",
        f"{APPEARANCES}/placement.py",
        "divmod((free & -free).bit_length() - 1, pitch)",
        "divmod(free.bit_length() - 1, pitch)",
        ("tests/appearances/test_scatter.py",),
    ),
    Break(
        "mask of REMOVE in one cell",
        f"{APPEARANCES}/legality.py",
        "            here |= covers\n        return found",
        "            here |= covers\n        found[-1, -1] = False\n        return found",
        ("tests/appearances/test_masks.py",),
    ),
    Break(
        "mask of ADD for one item type in one cell",
        f"{APPEARANCES}/legality.py",
        "    in_cell[:, 0, 0] = True",
        "    in_cell[:8, 0, 0] = True",
        ("tests/appearances/test_masks.py",),
    ),
    Break(
        "an empty tower has nothing to remove",
        f"{APPEARANCES}/tower.py",
        "heights[action.box] > 0",
        "heights[action.box] >= 0",
        ("tests/appearances/test_tower.py", "tests/appearances/test_masks.py"),
    ),
    Break(
        "the compiled core snaps to the first of several equally near items",
        f"{ENVS}/cores/kernels.py",
        "            if code < smallest:",
        "            if code <= smallest:",
        ("tests/envs/test_cores.py",),
    ),
    Break(
        "later items are drawn over earlier ones",
        "lilgym_mp/render/drawing.py",
        "        for item in box.items:\n            _paint",
        "        for item in reversed(box.items):\n            _paint",
        ("tests/render", "tests/fidelity/test_images.py"),
    ),
    Break(
        "NEXT_STEP autoreset",
        f"{ENVS}/engine.py",
        "if self._autoreset is AutoresetMode.NEXT_STEP and len(waiting):",
        "if self._autoreset is AutoresetMode.NEXT_STEP and len(waiting) > 1:",
        ("tests/envs/test_batched.py",),
    ),
    Break(
        "final observation of an episode",
        f"{ENVS}/engine.py",
        "buffers.last_image[env_id] = buffers.image[env_id]",
        "buffers.last_image[env_id] = buffers.image[0]",
        ("tests/envs/test_batched.py",),
    ),
    Break(
        "evaluation tasks of a worker's environments",
        f"{ENVS}/engine.py",
        "global_id = self._first + env_id",
        "global_id = env_id",
        ("tests/envs/test_workers.py",),
    ),
    Break(
        "comparison in a compiled program",
        f"{ENVS}/cores/kernels.py",
        "value = int(values[a] < values[b])",
        "value = int(values[a] <= values[b])",
        ("tests/envs/test_program_evaluator.py",),
    ),
    Break(
        "position test in a compiled program",
        f"{ENVS}/cores/kernels.py",
        "programs.places[item_type % SIZE_COUNT, x, y]",
        "programs.places[item_type % SIZE_COUNT, y, x]",
        ("tests/envs/test_program_evaluator.py",),
    ),
    Break(
        "comparison in a program word",
        f"{PROGRAMS}/functions/items.py",
        "all(y.top <= x.top for y in x.box.members)",
        "all(y.top < x.top for y in x.box.members)",
        ("tests/programs/test_functions.py", "tests/programs/test_words.py"),
    ),
    Break(
        "a word counts distinct objects",
        f"{PROGRAMS}/functions/collections.py",
        "return len({words.identity_key(x) for x in s})",
        "return len(s)",
        ("tests/programs",),
    ),
    Break(
        "canonical form of comparisons",
        f"{PROGRAMS}/canonical.py",
        '(">=", bound + 1) if operator == ">"',
        '(">=", bound) if operator == ">"',
        ("tests/programs/test_canonical.py",),
    ),
    Break(
        "a verifier's cost of a false accept",
        f"{GAME}/rewards.py",
        "return -costs.false_accept if judgement.accepted else -costs.false_reject",
        "return -costs.false_reject if judgement.accepted else -costs.false_accept",
        ("tests/envs/proposer_verifier",),
    ),
    Break(
        "message cost in a batch of games",
        f"{GAME}/game_arrays.py",
        "self.rewards[role] -= game.message_cost * (message > SILENCE)",
        "self.rewards[role] -= game.message_cost * (message >= SILENCE)",
        ("tests/envs/proposer_verifier/test_batched.py",),
    ),
    Break(
        "only the proposer sees the intent",
        f"{GAME}/views.py",
        "if role is Role.PROPOSER and game.rewards.draws_intent:",
        "if game.rewards.draws_intent:",
        ("tests/web/test_game.py", "tests/envs/proposer_verifier"),
    ),
    Break(
        "an augmentation permutes the boxes of scenes",
        "lilgym_mp/augmentation.py",
        "return Scene((left, middle, right)).permuted(self.boxes)",
        "return Scene((left, middle, right))",
        ("tests/test_augmentation.py",),
    ),
    Break(
        "position of an item read from an image",
        "lilgym_mp/perception.py",
        "return Item(x, row * self._shrink + template.odd_y, template.shape",
        "return Item(x, row * self._shrink, template.shape",
        ("tests/test_perception.py",),
    ),
    Break(
        "the search finds the shortest solution",
        "lilgym_mp/solver/tower_search.py",
        "for edits in range(max_edits + 1):",
        "for edits in range(2, max_edits + 1):",
        ("tests/solver/test_tower_search.py", "tests/solver/test_expert.py"),
    ),
    Break(
        "cap of the probability ratio in PPO's loss",
        f"{LEARNING}/ppo/update.py",
        "torch.where(capped, float(np.log(ratio_cap)), torch.inf)",
        "torch.where(capped, torch.inf, torch.inf)",
        ("tests/learning/ppo/test_update.py",),
    ),
    Break(
        "advantages end with their episode",
        f"{LEARNING}/ppo/update.py",
        "continues = ~ended[step]",
        "continues = np.ones_like(ended[step])",
        ("tests/learning/ppo/test_update.py",),
    ),
    Break(
        "STOP is forced where it succeeds",
        f"{LEARNING}/ppo/rollout.py",
        "actions[forced] = STOP",
        "actions[~forced] = STOP",
        ("tests/learning/ppo/test_training.py",),
    ),
    Break(
        "own turns of the two-agent game end with it",
        f"{LEARNING}/game/rollout.py",
        "continues & ~over, known | over",
        "continues, known | over",
        ("tests/learning/game/test_rollout.py",),
    ),
    Break(
        "random state of a resumed run",
        f"{LEARNING}/ppo/training.py",
        'self._rng.bit_generator.state = json.loads(state["random"])',
        'json.loads(state["random"])',
        ("tests/learning/ppo/test_training.py",),
    ),
    Break(
        "imitation loss over sets of actions",
        f"{LEARNING}/imitation/update.py",
        "torch.logaddexp(types[..., 0] + added, types[..., 1] + removed)",
        "types[..., 0] + added",
        ("tests/learning/imitation",),
    ),
    Break(
        "mask of stop forcing",
        "wrappers/stop_forcing.py",
        "legal[success] = False",
        "legal[~success] = False",
        ("tests/wrappers/test_stop_forcing.py",),
    ),
    Break(
        "terminal observations for Stable-Baselines3",
        "lilgym_mp/sb3.py",
        'step_infos[env_id]["terminal_observation"] = final_obs[env_id]',
        'step_infos[env_id]["terminal_observation"] = final_obs[ended[0]]',
        ("tests/test_sb3.py",),
    ),
    Break(
        "a reply whose thought does not end",
        "wrappers/replies.py",
        'end = tag.end() if tag["end"] else None',
        "end = tag.end()",
        ("tests/wrappers/test_text.py",),
    ),
    Break(
        "return of an evaluated episode",
        "lilgym_mp/evaluation/runs.py",
        "        rewards += reward\n",
        "        rewards = reward\n",
        ("tests/evaluation",),
    ),
    Break(
        "standard deviation over runs in a report",
        "lilgym_mp/report/aggregation.py",
        "stdev(values) if len(values) > 1",
        "stdev([*values, mean(values)]) if len(values) > 1",
        ("tests/report",),
    ),
)


@contextmanager
def broken(copy: Path, chosen: Break) -> Iterator[None]:
    """Breaks the rule in `copy`, and restores it afterwards. Raises ValueError unless `right` occurs exactly once."""
    path = copy / chosen.file
    text = path.read_text()
    if text.count(chosen.right) != 1:
        raise ValueError(f"{chosen.rule}: {chosen.right!r} must occur exactly once in {chosen.file}")
    path.write_text(text.replace(chosen.right, chosen.wrong))
    try:
        yield
    finally:
        path.write_text(text)


def first_failure(copy: Path, tests: tuple[str, ...]) -> str | None:
    """The first test that fails in the copy, without its parameters; None if all pass."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    done = subprocess.run(
        command, cwd=copy, env={**os.environ, "PYTHONPATH": str(copy)}, capture_output=True, text=True, check=False
    )
    if done.returncode == 0:
        return None
    found = _FAILED.search(done.stdout)
    return found[1] if found else f"pytest ended with {done.returncode}: {(done.stdout + done.stderr)[-500:]}"


def main() -> int:
    """Prints a table row for each broken rule; the exit code is 1 if tests pass in spite of one."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--only", nargs="+", metavar="RULE", choices=[rule for rule, *_ in BREAKS])
    only = parser.parse_args().only
    missed = 0
    with tempfile.TemporaryDirectory() as directory:
        copy = shutil.copytree(ROOT, Path(directory) / "project", ignore=IGNORED)
        print("| broken rule | failing test | seconds |\n|---|---|---:|")
        for chosen in BREAKS:
            if only and chosen.rule not in only:
                continue
            began = perf_counter()
            with broken(copy, chosen):
                failure = first_failure(copy, chosen.tests)
            missed += failure is None
            print(f"| {chosen.rule} | {failure or 'NONE'} | {perf_counter() - began:.0f} |", flush=True)
    print(f"{missed} not detected")
    return int(missed > 0)


if __name__ == "__main__":
    raise SystemExit(main())
