"""A corpus of two statements whose episodes can be followed by hand, and environments of every kind."""

from contextlib import ExitStack, closing

import gymnasium as gym
import pytest

from lilgym_mp.corpus import write_corpus
from lilgym_mp.envs.workers import WorkerVectorEnv
from tests.corpora import BLUE, ROUND

KINDS = {
    "single": gym.make,
    "batch": lambda id, **settings: gym.make_vec(id, num_envs=2, **settings),
    "workers": lambda id, **settings: WorkerVectorEnv(id, 2, **settings),
}


@pytest.fixture(scope="session")
def own_corpus(tmp_path_factory):
    """Tower: "Blue is here." (starts blue-yes, blue-no). Scatter: "Something round." (starts round-yes, round-no)."""
    path = tmp_path_factory.mktemp("corpus") / "own.jsonl"
    write_corpus(path, "own", "MIT", [BLUE, ROUND])
    return path


@pytest.fixture(params=KINDS)
def make(request):
    """`make(id, **settings)`: a single environment, a batch or workers; closed after the test."""
    with ExitStack() as made:
        yield lambda id, **settings: made.enter_context(closing(KINDS[request.param](id, **settings)))
