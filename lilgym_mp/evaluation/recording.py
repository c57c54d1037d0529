"""Records evaluated episodes, with facts from their tasks, the training tasks and the expert."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path

from lilgym_mp.corpus.tasks import contexts
from lilgym_mp.corpus.tokens import statement_form
from lilgym_mp.envs.config import EnvConfig
from lilgym_mp.envs.rules import Outcome, State
from lilgym_mp.evaluation.decisions import Decision
from lilgym_mp.evaluation.episode_files import Header, write_episodes
from lilgym_mp.evaluation.episodes import Episode, scenes
from lilgym_mp.evaluation.files import SUFFIX, writable_directory
from lilgym_mp.evaluation.policies import GREEDY, NamedPolicy
from lilgym_mp.evaluation.recording_metadata import software
from lilgym_mp.evaluation.results import Result
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.solver import Solver

MAX_NAME_LENGTH = 90  # characters of a file's name without its suffix


def episodes_file(directory: Path, named: NamedPolicy, settings: EnvConfig, split: str, seed: int) -> Path:
    """The path of a recording, unique by policy, configuration, split and seed."""
    name = re.sub(r"[^A-Za-z0-9]+", "-", f"{named.name} {settings.configuration} {split} {seed}").strip("-")
    if len(name) > MAX_NAME_LENGTH:
        digest = hashlib.sha256(name.encode()).hexdigest()[:8]
        name = f"{name[-MAX_NAME_LENGTH + 9 :].strip('-')}-{digest}"
    return directory / (name + SUFFIX)


class Recorder:
    """Records results of one configuration and split; the expert's solutions are cached across policies."""

    def __init__(
        self,
        settings: EnvConfig,
        split: str,
        training_statements: Collection[str],
        *,
        with_expert: bool = False,
        judges_decisions: bool = False,
    ) -> None:
        """`with_expert`: solve each task; `judges_decisions`: judge the action of each recorded decision."""
        self._tasks = settings.tasks(split)
        self._dynamics = settings.dynamics()
        self._set_seen(training_statements)
        self._with_expert = with_expert
        self._judges_decisions = judges_decisions
        self._solution_lengths: dict[tuple[str, Scene], int | None] = {}  # cache by task and scene; None: unsolved

    def _set_seen(self, training_statements: Collection[str]) -> None:
        self._training_statements = set(training_statements)
        self._training_forms = set(map(statement_form, self._training_statements))

    @cached_property
    def _solver(self) -> Solver:
        return Solver(self._dynamics)

    def write(self, directory: Path, result: Result, training_statements: Collection[str] | None = None) -> Path:
        """Writes the result's episodes to a file in the directory; returns its path. Raises OutputError.

        `training_statements`: of this policy and those after it, if others than before.
        """
        if training_statements is not None:
            self._set_seen(training_statements)
        plan = result.plan
        path = episodes_file(writable_directory(directory), result.named, plan.settings, plan.split, plan.seed)
        write_episodes(path, self._header(result), [self.recorded(episode) for episode in result.episodes])
        return path

    def _header(self, result: Result) -> Header:
        named = result.named
        plan = result.plan
        details = named.details
        provenance = self._tasks.provenance
        return Header(
            package=software().get("lilgym-mp", "unknown"),
            settings=plan.settings,
            split=plan.split,
            agent=details.get("label", named.name),
            supervision=named.supervision,
            actions=details.get("actions", GREEDY),
            mask=result.mask,
            stop_forcing=False,
            seed=plan.seed,
            training_seed=details.get("training_seed"),
            passes=plan.passes,
            episodes=len(result.episodes),
            start_scenes=len(self._tasks),
            contexts=contexts(self._tasks),
            corpus=provenance.name,
            tasks_sha256=provenance.sha256,
            expert=self._with_expert,
            run=details.get("run"),
            recipe=details.get("recipe", {}),
            training=details.get("training", {}),
        )

    def recorded(self, episode: Episode) -> Episode:
        """The episode with the facts that follow from its task, the training tasks and the expert."""
        task = self._tasks.by_id(episode.task)
        visited = scenes(self._dynamics, task.start, episode.actions)
        is_wrong = self._with_expert and episode.outcome == Outcome.WRONG_STOP
        return replace(
            episode,
            statement_seen=task.statement in self._training_statements,
            form_seen=statement_form(task.statement) in self._training_forms,
            tags=task.tags,
            optimal_actions=self._actions_to_success(task, task.start) if self._with_expert else None,
            actions_left=self._actions_to_success(task, visited[-1]) if is_wrong else None,
            decisions=self._judged(episode, task, visited),
        )

    def _judged(self, episode: Episode, task: Task, visited: Sequence[Scene]) -> tuple[Decision, ...] | None:
        """The episode's decisions, if requested with the judgement of the expert.

        An action is optimal if a shortest solution is one action shorter after it.
        """
        if episode.decisions is None or not self._judges_decisions:
            return episode.decisions
        left = [self._actions_to_success(task, scene) for scene in visited[:-1]]
        after = [*left[1:], 0 if episode.is_success else None]
        return tuple(
            replace(decision, optimal=None if steps is None else remaining == steps - 1, steps_to_go=steps)
            for decision, steps, remaining in zip(episode.decisions, left, after, strict=True)
        )

    def _actions_to_success(self, task: Task, scene: Scene) -> int | None:
        """Length of the expert's solution with the whole horizon left, None if unsolved."""
        key = task.id, scene
        if key not in self._solution_lengths:
            self._solution_lengths[key] = self._solver.distance(State(task, scene, 0))
        return self._solution_lengths[key]
