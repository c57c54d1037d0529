"""A training run from its beginning, or from where it stopped, to a number of steps."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from sb3_contrib import MaskablePPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.utils import set_random_seed

from lilgym_mp.appearances import make_appearance
from lilgym_mp.augmentation import write_recoloured
from lilgym_mp.corpus import TaskSet, Vocabulary, load_tasks
from lilgym_mp.corpus.matching import solvable_matching_corpus
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.files import writable_directory, write_whole
from lilgym_mp.evaluation.metrics import ENDS
from lilgym_mp.learning.dev_evaluation import DevEvaluator, LearningCurve, TrainingClock
from lilgym_mp.learning.environments import TRAINING_SPLIT, make_training_envs
from lilgym_mp.learning.interrupts import StopRequest, stop_on_signals
from lilgym_mp.learning.network import ActorCritic
from lilgym_mp.learning.policy import Agent, MaskedActorCritic
from lilgym_mp.learning.recipe import Recipe
from lilgym_mp.learning.run_directory import Checkpoint, Identity, RunDirectory, RunError, refuse_other
from lilgym_mp.wrappers.tokens import default_length


class Progress(NamedTuple):
    """What happened between two updates."""

    steps: int  # of the whole run
    episodes: int  # of the whole run
    seconds: float  # of training, of the whole run
    steps_per_second: float
    accuracy: float | None  # of the episodes that ended in between; None if there were none
    mean_reward: float | None
    mean_length: float | None
    outcomes: dict[str, float]  # shares of those episodes


@dataclass(frozen=True)
class Run:
    """A training run and all that it needs."""

    directory: RunDirectory
    identity: Identity
    vocabulary: Vocabulary
    tasks: TaskSet
    checkpoint: Checkpoint | None  # None at the beginning

    @property
    def steps(self) -> int:
        """Steps taken so far."""
        return 0 if self.checkpoint is None else self.checkpoint.steps

    def make_network(self) -> ActorCritic:
        settings = self.identity.settings
        return ActorCritic(make_appearance(settings.appearance, settings.grid), len(self.vocabulary))

    def agent(self, *, greedy: bool = True) -> Agent:
        """The network as it is now; before the first step, as the seed makes it."""
        set_random_seed(self.identity.recipe.seed)
        network = self.make_network()
        if self.checkpoint is not None:
            _restore(network, self.checkpoint, self.directory)
        return Agent(network.eval(), self.vocabulary, self.identity.length, greedy)


def begin_run(path: Path, settings: Settings, recipe: Recipe) -> Run:
    """A new run in an empty or new directory, nothing trained yet.

    Raises OutputError where nothing can be written, RunError when a run is there already, and what
    `Settings.make` raises.
    """
    directory = RunDirectory(path)
    if directory.exists:
        raise RunError(f"{path} holds a training run already; resume it with --resume, or choose another directory")
    origin = load_tasks(settings.corpus, settings.appearance, settings.start, TRAINING_SPLIT)
    if recipe.nlvr_reward:
        solvable_matching_corpus(origin)
    ActorCritic.check(make_appearance(settings.appearance, settings.grid))
    settings.make(TRAINING_SPLIT)
    writable_directory(path)
    if recipe.recolour:
        write_whole(directory.tasks_file, lambda unfinished: write_recoloured(unfinished, origin))
    tasks = _training_tasks(directory, settings, recipe)
    statements = {task.statement for task in tasks}
    vocabulary = Vocabulary.from_statements(statements)
    identity = Identity(settings, recipe, default_length(statements), origin.provenance.sha256)
    directory.begin(identity, vocabulary)
    return Run(directory, identity, vocabulary, tasks, None)


def open_run(path: Path, asked: Mapping[str, Any], *, untrained: bool = False) -> Run:
    """The run in a directory, with its latest checkpoint; `untrained`: one without will do.

    `asked`: settings of the environment and the recipe, by name, that the run must have. Raises RunError where it has
    others, naming both, when there is no run or no sound checkpoint, and when the training tasks have changed since.
    """
    directory = RunDirectory(path)
    identity = directory.identity()
    refuse_other({**asdict(identity.settings), **asdict(identity.recipe)}, asked, path)
    origin = load_tasks(
        identity.settings.corpus, identity.settings.appearance, identity.settings.start, TRAINING_SPLIT
    ).provenance
    if origin.sha256 != identity.tasks_sha256:
        raise RunError(
            f"{origin.path} is not the file that the run in {path} was trained on:"
            f" its SHA-256 is {origin.sha256[:12]}..., it was {identity.tasks_sha256[:12]}..."
        )
    tasks = _training_tasks(directory, identity.settings, identity.recipe)
    checkpoint = None if untrained and not directory.checkpoint_file.exists() else directory.load()
    return Run(directory, identity, directory.vocabulary(), tasks, checkpoint)


def _training_tasks(directory: RunDirectory, settings: Settings, recipe: Recipe) -> TaskSet:
    corpus = str(directory.tasks_file) if recipe.recolour else settings.corpus
    return load_tasks(corpus, settings.appearance, settings.start, TRAINING_SPLIT)


def train(
    run: Run,
    steps: int,
    *,
    backend: str,
    save_every: int,
    evaluate_every: int | None = None,
    threads: int = 1,
    on_update: Callable[[Progress], object] = lambda progress: None,
) -> Run:
    """The run after `steps` steps in all, rounded up to whole rollouts; saved every `save_every` steps and at the end.

    With `evaluate_every` it plays dev at the beginning, after that many steps again and again, and at the end, actions
    drawn (`DevEvaluation`, a line each in the run's evaluations_file); what is learnt stays the same.

    Ctrl-C and SIGTERM end it early, saved, at the next step; a second one at once (main thread only). `threads` compute
    the network; more than one help only where as many processors have nothing else to do. `on_update` hears of each
    update. Raises RunError when the run has that many steps already.
    """
    if steps <= run.steps:
        raise RunError(f"the run in {run.directory.path} has {run.steps:,} steps already; ask for more with --steps")
    evaluator = DevEvaluator(run.identity.settings, run.identity.recipe.seed) if evaluate_every else None
    envs = make_training_envs(
        run.identity.settings,
        run.identity.recipe,
        run.vocabulary,
        run.identity.length,
        run.tasks.provenance.corpus,
        backend,
    )
    try:
        with _torch_threads(threads), stop_on_signals() as stop:
            learner = _learner(run, envs)
            watcher = _Watcher(run, stop, save_every, on_update)
            callbacks: list[BaseCallback] = [watcher]
            if evaluator is not None and evaluate_every:
                policy = partial(_drawing_agent, run, _policy(learner).network)
                file = run.directory.evaluations_file
                callbacks.append(LearningCurve(evaluator, evaluate_every, file, policy, watcher.clock))
            learner.learn(steps - run.steps, callback=callbacks, reset_num_timesteps=False)
            learner.logger.close()
            checkpoint = watcher.save()
            for curve in callbacks:
                if isinstance(curve, LearningCurve) and not stop.requested:
                    curve.add_point()
    finally:
        envs.close()
    return Run(run.directory, run.identity, run.vocabulary, run.tasks, checkpoint)


def _learner(run: Run, envs: Any) -> MaskablePPO:
    recipe = run.identity.recipe
    learner = MaskablePPO(
        MaskedActorCritic,
        envs,
        learning_rate=_falling(recipe.learning_rate) if recipe.anneal else recipe.learning_rate,
        n_steps=recipe.rollout // recipe.envs,
        batch_size=recipe.batch_size,
        n_epochs=recipe.epochs,
        gamma=recipe.gamma,
        gae_lambda=recipe.gae_lambda,
        clip_range=recipe.clip,
        ent_coef=recipe.entropy,
        vf_coef=recipe.value,
        max_grad_norm=recipe.gradient_norm,
        policy_kwargs={"make_network": run.make_network},
        seed=_seed_at(recipe.seed, run.steps),
        device="cpu",
    )
    learner.set_logger(configure(str(run.directory.tensorboard), ["tensorboard"]))
    if run.checkpoint is not None:
        _restore(_policy(learner).network, run.checkpoint, run.directory)
        try:
            learner.policy.optimizer.load_state_dict(run.checkpoint.optimiser)
        except (ValueError, KeyError, TypeError, AttributeError, RuntimeError) as fault:
            raise RunError(f"{run.directory.checkpoint_file}: its optimiser cannot be used: {fault}") from None
        learner.num_timesteps = run.checkpoint.steps
        learner._n_updates = run.checkpoint.updates
    return learner


def _drawing_agent(run: Run, network: ActorCritic) -> Agent:
    """The network as a policy that draws its actions."""
    return Agent(network, run.vocabulary, run.identity.length, greedy=False)


def _policy(learner: MaskablePPO) -> MaskedActorCritic:
    assert isinstance(learner.policy, MaskedActorCritic)
    return learner.policy


def _falling(start: float) -> Callable[[float], float]:
    """A schedule by the share of training that is left."""
    return lambda left: start * left


def _seed_at(seed: int, steps: int) -> int:
    """The run's seed at its beginning; another one after each number of steps, lest a resumed run repeat itself."""
    return seed if steps == 0 else int(np.random.SeedSequence([seed, steps]).generate_state(1)[0])


def _restore(network: ActorCritic, checkpoint: Checkpoint, directory: RunDirectory) -> None:
    try:
        network.load_state_dict(checkpoint.network)
    except (RuntimeError, TypeError, AttributeError):
        place = f"{directory.checkpoint_file}: not of the network that {directory.identity_file} describes"
        raise RunError(place) from None


@contextmanager
def _torch_threads(count: int) -> Generator[None, None, None]:
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@dataclass
class _Tally:
    """The episodes that ended since the last update."""

    ends: Counter[str] = field(default_factory=Counter)
    reward: float = 0.0
    steps: int = 0  # actions in episodes that ended


class _Watcher(BaseCallback):
    """Counts episodes, tells of progress, saves, and ends training when that is asked for."""

    model: MaskablePPO

    def __init__(self, run: Run, stop: StopRequest, save_every: int, on_update: Callable[[Progress], object]) -> None:
        super().__init__()
        self._run = run
        self._stop = stop
        self._save_every = save_every
        self._on_update = on_update
        done = run.checkpoint
        self._episodes = 0 if done is None else done.episodes
        self.clock = TrainingClock(0.0 if done is None else done.seconds)
        self._saved_at = self._last_steps = run.steps
        self._last_seconds = self.clock.seconds
        self._tally = _Tally()
        self._rewards = np.zeros(run.identity.recipe.envs)  # of the episodes under way
        self._lengths = np.zeros(run.identity.recipe.envs, np.int64)

    def _on_step(self) -> bool:
        self._rewards += self.locals["rewards"]
        self._lengths += 1
        for place in np.flatnonzero(self.locals["dones"]):
            self._tally.ends[self.locals["infos"][place]["outcome"]] += 1
            self._tally.reward += self._rewards[place]
            self._tally.steps += int(self._lengths[place])
            self._rewards[place] = self._lengths[place] = 0
        return not self._stop.requested

    def _on_rollout_end(self) -> None:
        progress = self._progress()
        for name in ("accuracy", "mean_reward", "mean_length"):
            self.logger.record(f"episodes/{name}", getattr(progress, name))
        for end, share in progress.outcomes.items():
            self.logger.record(f"episodes/{end}", share)
        with self._run.directory.progress_file.open("a", encoding="utf-8") as file:
            file.write(json.dumps(progress._asdict()) + "\n")
        self._on_update(progress)

    def _on_rollout_start(self) -> None:
        if self.num_timesteps - self._saved_at >= self._save_every:
            self.save()

    def save(self) -> Checkpoint:
        """Writes the checkpoint of this moment."""
        checkpoint = Checkpoint(
            _policy(self.model).network.state_dict(),
            self.model.policy.optimizer.state_dict(),
            self.model.num_timesteps,
            self.model._n_updates,
            self._episodes,
            self.clock.seconds,
        )
        self._run.directory.save(checkpoint)
        self._saved_at = self.num_timesteps
        return checkpoint

    def _progress(self) -> Progress:
        """Of the time since the last call."""
        tally, self._tally = self._tally, _Tally()
        seconds = self.clock.seconds
        speed = (self.num_timesteps - self._last_steps) / (seconds - self._last_seconds)
        self._last_steps, self._last_seconds = self.num_timesteps, seconds
        count = tally.ends.total()
        self._episodes += count
        return Progress(
            steps=self.num_timesteps,
            episodes=self._episodes,
            seconds=round(seconds, 3),
            steps_per_second=round(speed, 1),
            accuracy=tally.ends["success"] / count if count else None,
            mean_reward=tally.reward / count if count else None,
            mean_length=tally.steps / count if count else None,
            outcomes={end: tally.ends[end] / count for end in ENDS} if count else {},
        )
