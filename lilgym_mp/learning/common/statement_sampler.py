"""A sampler of training tasks for environments, so that any learner has the tasks of `lilgym-mp train ppo`."""

from __future__ import annotations

import os

from lilgym_mp.corpus import Vocabulary
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.registration import configuration_name, read_configuration
from lilgym_mp.learning.common.recipes import UpdateRecipe
from lilgym_mp.learning.common.tasks import TaskSampler, training_tasks
from lilgym_mp.scene.arrays import Rng
from lilgym_mp.scene.choices import checked_count


class StatementSampler:
    """Draws training tasks, as the `sampler` of environments: `gymnasium.make_vec(id, num_envs=N, sampler=sampler)`.

    Environments k n .. k n + n - 1, with n = `same_statement`, play one statement, until each has begun
    `statement_episodes` of it on average: learners that encode each statement once are much faster. It counts these
    episodes, so that each batch needs its own, and `num_workers` should divide the groups. `recolour`: also tasks with
    colours exchanged in words and scenes alike. `empty_starts`: the fraction of a FlipIt run's episodes that begin with
    the empty scene.
    """

    def __init__(
        self,
        id: str,
        corpus: str = "builtin",
        *,
        same_statement: int = 1,
        statement_episodes: int = 2,
        recolour: bool = False,
        empty_starts: float = 0.0,
    ) -> None:
        """`id`: of the environment, or its configuration. Raises ValueError naming the value and its bounds."""
        settings = EnvConfig(configuration_name(*read_configuration(id)), os.fspath(corpus))
        options = {"same_statement": same_statement, "recolour": recolour, "empty_starts": empty_starts}
        recipe = UpdateRecipe(envs=same_statement, rollout=same_statement, batch_size=1, held_out=0.0, **options)
        training = training_tasks(settings, recipe)
        self.tasks = training.tasks  # played instead of those of the environment's corpus
        self.vocabulary = Vocabulary.from_statements(training.statements)
        self._draws = TaskSampler(training, recipe)
        self.same_statement = same_statement
        self._episodes = same_statement * checked_count("statement_episodes", statement_episodes)
        self._left: dict[int, tuple[int, int]] = {}  # by group: its statement, and how many more episodes play it

    def __call__(self, generator: Rng, env_id: int) -> str:
        """The id of the next task."""
        group = env_id // self.same_statement
        statement, left = self._left.get(group, (0, 0))
        if not left:
            statement = int(self._draws.draw_statements(1, generator)[0])
            left = self._episodes
        self._left[group] = statement, left - 1
        return self.tasks[self._draws.draw_task(statement, generator)].id
