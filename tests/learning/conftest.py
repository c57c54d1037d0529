"""One thread for torch, small corpora and recipes, and what tests ask of runs and agents."""

import signal
from contextlib import contextmanager
from pathlib import Path

import pytest
import torch

from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.evaluation import evaluate
from lilgym_mp.learning.common.model_file import load_model
from lilgym_mp.learning.game.recipe import GameRecipe
from lilgym_mp.learning.ppo.learner import PPORecipe
from lilgym_mp.programs.compiler import Program
from lilgym_mp.scene.actions import Stop
from tests.corpora import write_three_statements

SMALL_PPO = PPORecipe(
    envs=4, same_statement=1, rollout=32, batch_size=16, epochs=1, held_out=0, recolour=False, empty_starts=0
)
SMALL_GAME = GameRecipe(
    envs=8, same_statement=2, rollout=64, batch_size=64, epochs=1, recolour=False, empty_starts=0, width=16
)


@pytest.fixture(autouse=True)
def _single_thread():
    torch.set_num_threads(1)


@pytest.fixture(scope="session")
def three(tmp_path_factory):
    """The path of a corpus of three statements."""
    return str(write_three_statements(tmp_path_factory.mktemp("three") / "three.jsonl"))


@contextmanager
def counted_stops():
    """The lengths of all episodes that end with a STOP; within the block no program may be evaluated but by them."""
    lengths = []
    playing = False
    step, truth = Dynamics.step, Program.__call__

    def counted(dynamics, state, action):
        nonlocal playing
        playing = isinstance(action, Stop)
        lengths.extend([state.steps + 1] * playing)
        transition = step(dynamics, state, action)
        playing = False
        return transition

    def truth_in_play(program, scene):
        assert playing, "a truth was read outside of a STOP"
        return truth(program, scene)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Dynamics, "step", counted)
        patched.setattr(Program, "__call__", truth_in_play)
        yield lengths


def accuracy(agent, settings, split="dev", **options):
    """The share of successes in one episode of each task of the split."""
    episodes = evaluate(agent.policy(settings, **options), settings, split)
    return sum(episode.is_success for episode in episodes) / len(episodes)


def weights(run):
    return load_model(run / "agent.safetensors")[1]


def equal(one, other):
    """Whether the agents of two runs, or two tables of weights, are the same."""
    first, second = (weights(each) if isinstance(each, Path) else each for each in (one, other))
    return first.keys() == second.keys() and all(torch.equal(first[name], second[name]) for name in first)


class Trap:
    """Creates a file when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def interrupt_at_64_steps(progress):
    if progress.steps == 64:
        signal.raise_signal(signal.SIGINT)
