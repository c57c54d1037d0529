"""Records evaluated episodes, with facts from their tasks, the training tasks and the expert; checks recordings."""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from lilgym_mp.corpus.tasks import TaskSet, contexts
from lilgym_mp.corpus.tokens import statement_form
from lilgym_mp.envs.rules import Dynamics, Outcome, State
from lilgym_mp.evaluation.comparison import Result, training_statements
from lilgym_mp.evaluation.decisions import Decision
from lilgym_mp.evaluation.episodes import Header, RecordedEpisode, Recording, write_episodes
from lilgym_mp.evaluation.files import SUFFIX, EpisodesError, writable_directory
from lilgym_mp.evaluation.policies import GREEDY, NamedPolicy
from lilgym_mp.evaluation.recording_metadata import software
from lilgym_mp.evaluation.runs import Episode, scenes
from lilgym_mp.evaluation.settings import Settings
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import Action, ActionError
from lilgym_mp.solver import Solver

MAX_NAME_LENGTH = 90  # characters of a file's name without its suffix
TOLERANCE = 1e-9  # of a reward that is played again


def episodes_file(directory: Path, named: NamedPolicy, settings: Settings, split: str, seed: int) -> Path:
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
        settings: Settings,
        split: str,
        training_statements: Collection[str],
        *,
        with_expert: bool = False,
        judges_decisions: bool = False,
    ) -> None:
        """`with_expert`: solve each task; `judges_decisions`: judge the action of each recorded decision."""
        env = settings.make(split)
        self._tasks: TaskSet = env.tasks
        self._dynamics: Dynamics = env.dynamics
        self._training_statements = set(training_statements)
        self._training_forms = set(map(statement_form, self._training_statements))
        self._solver = Solver(self._dynamics) if with_expert else None
        self._judge = Solver(self._dynamics) if judges_decisions else None
        self._solution_lengths: dict[tuple[str, Scene], int | None] = {}  # cache by task and scene; None: unsolved

    def write(self, directory: Path, result: Result) -> Path:
        """Writes the result's episodes to a file in the directory; returns its path. Raises OutputError."""
        plan = result.plan
        path = episodes_file(writable_directory(directory), result.named, plan.settings, plan.split, plan.seed)
        write_episodes(path, self._header(result), [self._recorded(episode) for episode in result.episodes])
        return path

    def _header(self, result: Result) -> Header:
        named, plan = result.named, result.plan
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
            expert=self._solver is not None,
            run=details.get("run"),
            recipe=details.get("recipe", {}),
            training=details.get("training", {}),
        )

    def _recorded(self, episode: Episode) -> RecordedEpisode:
        task = self._tasks.by_id(episode.task_id)
        actions = [self._dynamics.appearance.decode(action) for action in episode.actions]
        return RecordedEpisode(
            task=task.id,
            outcome=episode.outcome,
            invalid_reason=episode.invalid_reason,
            actions=tuple(actions),
            rewards=rewards(self._dynamics, episode),
            stop_probabilities=episode.stop_probabilities,
            decisions=self._decisions(task, episode, actions),
            **self.facts(task, actions, episode.outcome),
        )

    def facts(self, task: Task, actions: Sequence[Action], outcome: str) -> dict[str, Any]:
        """The fields of a `RecordedEpisode` that follow from its task, the training tasks and the expert."""
        return {
            "statement": task.statement,
            "program": task.program,
            "target": task.target,
            "statement_seen": task.statement in self._training_statements,
            "form_seen": statement_form(task.statement) in self._training_forms,
            "tags": self._tasks.tags(task.id),
            "start": task.start,
            "optimal_actions": self._actions_to_success(task, task.start),
            "actions_left": self._actions_left(task, actions, outcome),
        }

    def _decisions(self, task: Task, episode: Episode, actions: Sequence[Action]) -> tuple[Decision, ...] | None:
        """The episode's decisions, with the expert's judgement if requested."""
        judge = self._judge
        if episode.decisions is None or judge is None:
            return episode.decisions
        states = [State(task, scene, step) for step, scene in enumerate(scenes(self._dynamics, task.start, actions))]
        return tuple(
            replace(
                decision,
                optimal=_is_optimal(judge, state, action),
                steps_to_go=judge.optimal_actions(state).steps or None,
            )
            for decision, state, action in zip(episode.decisions, states, actions, strict=False)
        )

    def _actions_left(self, task: Task, actions: Sequence[Action], outcome: str) -> int | None:
        if outcome != Outcome.WRONG_STOP:
            return None
        return self._actions_to_success(task, scenes(self._dynamics, task.start, actions)[-1])

    def _actions_to_success(self, task: Task, scene: Scene) -> int | None:
        """Length of the expert's solution with the whole horizon left, None if not asked or unsolved."""
        if self._solver is None:
            return None
        key = task.id, scene
        if key not in self._solution_lengths:
            solution = self._solver.solve_from(State(task, scene, 0))
            self._solution_lengths[key] = solution.steps if solution.solved else None
        return self._solution_lengths[key]


def _is_optimal(solver: Solver, state: State, action: Action) -> bool | None:
    """Whether the action begins a shortest solution; None if unknown to the expert."""
    optimal, dynamics = solver.optimal_actions(state), solver.dynamics
    if dynamics.appearance.encode(action) in optimal.actions:
        return True
    if not optimal.actions:
        return None
    transition = dynamics.step(state, action)
    if optimal.complete or transition.outcome is not Outcome.CONTINUES:
        return False
    return True if solver.solve_from(transition.state).steps == optimal.steps - 1 else None


def rewards(dynamics: Dynamics, episode: Episode) -> tuple[float, ...]:
    """The reward of each of the episode's actions."""
    signals = dynamics.rules.signals
    before = (signals[Outcome.CONTINUES].reward,) * (len(episode.actions) - 1)
    return (*before, signals[Outcome(episode.outcome)].reward)


def check_recording(recording: Recording) -> None:
    """Raises EpisodesError naming the file and what is wrong, unless the results and the facts about tasks are true.

    The tasks must be those of the installed corpus, each played as often as the header says, and the actions must have
    the recorded rewards, outcome and reason of invalidity. Seen statements and forms, tags and, if the
    header says `expert`, the lengths of the expert's solutions are computed again; without `expert` there must be none.
    Not checked are the header's `package`, `agent`, `supervision`, `actions`, `mask`, `seed`, `training_seed`, `run`,
    `recipe` and `training`, and the episodes' `stop_probabilities` and `decisions`.
    """
    header = recording.header
    tasks = header.settings.make(header.split).tasks
    found = tasks.provenance.sha256
    if header.tasks_sha256 != found:
        raise _error(recording, f"its tasks have the checksum {header.tasks_sha256[:10]}, those installed {found[:10]}")
    played = Counter(episode.task for episode in recording.episodes)
    for task in tasks:
        if played.pop(task.id, 0) != header.passes:
            raise _error(recording, f"the task {task.id} must be played {header.passes} times")
    if played:
        raise _error(recording, f"the split {header.split} has no task {next(iter(played))}")
    if header.stop_forcing:
        raise _error(recording, "STOP was forced, which evaluations must not do")
    counted = {"start_scenes": len(tasks), "contexts": contexts(tasks), "corpus": tasks.provenance.name}
    for name, value in counted.items():
        if getattr(header, name) != value:
            raise _error(recording, f"its {name} is {getattr(header, name)!r:.80}, not {value!r:.80}")
    dynamics = header.settings.dynamics()
    seen = training_statements(header.settings)
    recorder = Recorder(header.settings, header.split, seen, with_expert=header.expert)
    for index, episode in enumerate(recording.episodes):
        task = tasks.by_id(episode.task)
        fault = _fault(dynamics, task, episode) or _false_fact(recorder, task, episode)
        if fault is not None:
            raise _error(recording, f"episode {index} ({episode.task}): {fault}")


def _false_fact(recorder: Recorder, task: Task, episode: RecordedEpisode) -> str | None:
    for name, value in recorder.facts(task, episode.actions, episode.outcome).items():
        if getattr(episode, name) != value:
            return f"its {name} is {getattr(episode, name)!r:.80}, but {value!r:.80} when computed again"
    return None


def _fault(dynamics: Dynamics, task: Task, episode: RecordedEpisode) -> str | None:
    recorded = episode.statement, episode.program, episode.target, episode.start
    if recorded != (task.statement, task.program, task.target, task.start):
        return "its statement, program, target or start scene is not the task's"
    state = dynamics.start(task)
    outcome, reason = Outcome.CONTINUES, None
    for action, reward in zip(episode.actions, episode.rewards, strict=True):
        if outcome is not Outcome.CONTINUES:
            return f"it has actions after {outcome}"
        try:
            dynamics.appearance.encode(action)
        except ActionError as error:
            return str(error)
        transition = dynamics.step(state, action)
        state, outcome = transition.state, transition.outcome
        reason = None if transition.invalid is None else str(transition.invalid)
        if abs(transition.reward - reward) > TOLERANCE:
            return f"its reward {reward:g} is {transition.reward:g} when played again"
    if outcome != episode.outcome:
        return f"its outcome {episode.outcome} is {outcome} when played again"
    if reason != episode.invalid_reason:
        return f"its invalid_reason {episode.invalid_reason} is {reason} when played again"
    return None


def _error(recording: Recording, problem: str) -> EpisodesError:
    return EpisodesError(f"{recording.path}: {problem}")
