"""A training run in memory, of any learner: steps, reports and checkpoints until its budget is spent, or Ctrl-C."""

from __future__ import annotations

import math
import os
import signal
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from functools import wraps
from pathlib import Path
from threading import current_thread, main_thread
from typing import Any, ClassVar, NamedTuple, ParamSpec, TypedDict, cast

import torch
from torch import nn

from lilgym_mp.evaluation.files import locked
from lilgym_mp.learning.common.agents import Agent
from lilgym_mp.learning.common.model_file import save_model, select_device, torch_threads
from lilgym_mp.learning.common.run_directory import RunDirectory, TrainingRunError, begin_run
from lilgym_mp.scene.arrays import AnyDict, AnyMapping

SAVE_SECONDS = 60.0  # CPU time between checkpoints
REPORT_SECONDS = 15.0  # CPU time between lines of progress.jsonl
STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def cpu_seconds() -> float:
    """CPU time of this process and its terminated children."""
    return sum(os.times()[:4])


@dataclass
class Counters:
    """Counts in a checkpoint of any learner; field names are part of its format."""

    updates: int = 0  # of the optimiser
    cpu_seconds: float = 0.0  # over all sessions of the run


class Budget(NamedTuple):
    """`amount` of `unit`, or `minutes` of CPU time, everything included, whichever is spent first."""

    unit: str  # the counter that measures progress: "steps" of the environments or "updates" of the optimiser
    amount: int | None
    minutes: float | None = None

    def options(self) -> dict[str, float | None]:
        """The budget as arguments of the function that trains."""
        return {self.unit: self.amount, "minutes": self.minutes}

    def check(self) -> None:
        """Raises ValueError unless there is a positive budget."""
        if self.amount is None and self.minutes is None:
            raise ValueError(f"give a budget: {self.unit}, minutes, or both")
        for name, value in self.options().items():
            if value is not None and not 0 < value < math.inf:
                raise ValueError(f"the budget in {name} must be above 0, not {value:g}")


class Session(TypedDict, total=False):
    """Keyword arguments of every learner's function that trains."""

    device: str  # "auto", "cpu" or "cuda"
    threads: int  # of the CPU; 1 by default
    resume: bool  # continue the run in the directory, which must have the same settings
    say: Callable[[str], object]  # is given lines about the run, to be printed
    on_progress: Callable[[Any], object]  # is given each line of progress.jsonl


class TrainingRun(ABC):
    """A run in memory.

    Ctrl-C or SIGTERM end its loop after the current step, with a checkpoint; then KeyboardInterrupt is raised. A second
    Ctrl-C raises it at once, as does one outside the loop.
    """

    counters: Counters  # the learner's own
    files: RunDirectory
    parts: Mapping[str, nn.Module | torch.optim.Optimizer]  # what a checkpoint holds the state of, by name
    saves_agent_early: ClassVar[bool] = False  # also when it is interrupted
    reports_every_step: ClassVar[bool] = False

    def __init__(self, out: Path, budget: Budget, session: Session) -> None:
        """`out`: the run directory, empty or new unless the run is resumed. Raises ValueError for an invalid budget."""
        budget.check()
        self.budget = budget
        self.out = out
        self.resume = session.get("resume", False)
        self.device = select_device(session.get("device", "auto"))
        self.say = session.get("say", lambda text: None)
        self._on_progress = session.get("on_progress", lambda line: None)
        self._start_seconds = cpu_seconds()
        self.stop = StopRequest()
        self._progress_bytes: int | None = 0  # of the checkpoint that the run continues from; None: unknown

    def state(self) -> AnyDict:
        """The contents of a checkpoint besides the counters."""
        return {name: part.state_dict() for name, part in self.parts.items()}

    def restore(self, state: AnyDict) -> None:
        """Inverse of `state`; the counters have been restored."""
        for name, part in self.parts.items():
            part.load_state_dict(state[name])

    @abstractmethod
    def step(self) -> Any:
        """One step of the algorithm, with data collection when it is due. Raises TrainingRunError."""

    def progress_line(self, recent: Sequence[Any]) -> Any:
        """The line of progress.jsonl, a NamedTuple with a `note`, about the steps since the last one."""
        return recent[-1]

    @abstractmethod
    def finish(self) -> Agent:
        """The trained agent, to be saved; the last checkpoint has been saved."""

    def begin(self, identity: AnyMapping, **options: Any) -> None:
        """Begins or reopens the run directory, and remembers the budget and these options. Raises TrainingRunError."""
        self.files = begin_run(self.out, identity, resume=self.resume)
        self._options = {**self.budget.options(), **options}

    def introduction(self) -> str:
        """Lines printed when training begins."""
        return ""

    def train(self) -> Any:
        """Trains, saves the agent and returns it.

        Raises KeyboardInterrupt if it was interrupted, OutputError if another process trains this run.
        """
        with locked(self.out):
            return self._train()

    def _train(self) -> Any:
        self._check_unspent()
        if self.files.finished:
            if self.files.identity.get("recipe", {}).get("schedule", "") != "constant":
                self.say(f"{self.files.path} had finished; over the larger budget its learning rate rises again")
        elif self._progress_bytes is not None:
            self.files.cut_progress(self._progress_bytes)
        self.files.remember(**self._options)
        if introduction := self.introduction():
            self.say(introduction)
        self.learn()
        if self.stop.requested and not self.saves_agent_early:
            raise KeyboardInterrupt
        agent = self.finish()
        save_model(self.files.agent_file, agent.description, agent.network.state_dict())
        self.files.remember(finished=not self.stop.requested)
        spent = f"{self.spent():,} {self.budget.unit}, {self.minutes():g} CPU minutes"
        self.say(f"saved {self.files.agent_file} after {spent}")
        if self.stop.requested:
            raise KeyboardInterrupt
        return agent

    def learn(self) -> None:
        """Trains until the budget is spent or a stop is requested."""
        self.optimise()

    def seconds(self) -> float:
        """CPU time."""
        return self.counters.cpu_seconds + cpu_seconds() - self._start_seconds

    def spent(self) -> int:
        """The steps or updates so far, whichever the budget counts."""
        return getattr(self.counters, self.budget.unit)

    def progress(self) -> float:
        """The fraction of the budget spent."""
        _, amount, minutes = self.budget
        by_amount = 0.0 if amount is None else self.spent() / amount
        return max(by_amount, 0.0 if minutes is None else self.seconds() / (60 * minutes))

    def is_over(self) -> bool:
        """Whether the run has reached its number of steps, or another limit of the learner's."""
        return self.progress() >= 1

    def _check_unspent(self) -> None:
        """Raises TrainingRunError if a resumed run has spent the budget and is finished."""
        if self.is_over() and self.files.finished:
            given = " or ".join(f"--{name}" for name, value in self.budget.options().items() if value is not None)
            way = f"request more with {given}" if self.progress() >= 1 else "it is out of patience"
            raise TrainingRunError(
                f"the run in {self.files.path} already has {self.spent():,} {self.budget.unit}; {way}"
            )

    def optimise(self, step: Callable[[], Any] | None = None, until: float = 1.0) -> None:
        """Takes steps until a fraction of the budget is spent, or a stop is requested, and saves a checkpoint.

        Raises TrainingRunError if the budget allows none, or a loss is not finite.
        """
        step = step or self.step
        recent: list[Any] = []
        saved = reported = self.seconds()
        with stop_on_signals() as self.stop:
            while not self.is_over() and self.progress() < until and not self.stop.requested:
                recent.append(step())
                now = self.seconds()
                if self.reports_every_step or now - reported >= REPORT_SECONDS:
                    self._report(self.progress_line(recent))
                    recent = []
                    reported = now
                if now - saved >= SAVE_SECONDS:
                    self.save()
                    saved = now
            if recent:
                self._report(self.progress_line(recent))
        if not self.spent() and self.is_over():
            raise TrainingRunError(
                f"{self.budget.minutes:g} minutes were spent before the first update; give more minutes"
            )
        self.save()

    def _report(self, line: Any) -> None:
        self.files.record(line._asdict())
        self._on_progress(line)

    def save(self) -> None:
        """Writes a checkpoint from which the run can be resumed."""
        counters = {**asdict(self.counters), "cpu_seconds": self.seconds()}
        progress = self.files.progress_bytes
        self.files.save_checkpoint({**self.state(), "counters": counters, "progress_bytes": progress})

    def load(self) -> bool:
        """Continues from the checkpoint if the run is resumed and has one. Raises TrainingRunError."""
        if not self.resume or not self.files.has_checkpoint:
            if self.files.agent_file.exists():
                raise TrainingRunError(f"{self.files.path} has an agent, but no checkpoint to continue from")
            return False
        with self.files.checkpoint(self.device) as state:
            for field in fields(self.counters):
                setattr(self.counters, field.name, state["counters"][field.name])
            self._progress_bytes = state.get("progress_bytes")
            self.restore(state)
            for name, tensor in (state.get("network") or state["networks"]).items():
                if not torch.isfinite(tensor).all():
                    raise ValueError(f"{name} holds non-finite values")
        return True

    def minutes(self) -> float:
        """CPU time, for the model file."""
        return round(self.seconds() / 60, 2)


Arguments = ParamSpec("Arguments")


def training(run: Callable[Arguments, TrainingRun]) -> Callable[Arguments, Any]:
    """The function that makes a run from its arguments and trains: it saves and returns the agent."""

    @wraps(run, assigned=["__doc__"], updated=[])
    def train(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Any:
        with torch_threads(cast("int", kwargs.get("threads", 1))):
            return run(*args, **kwargs).train()

    return train


@dataclass
class StopRequest:
    """Whether a signal has asked the run to stop."""

    requested: bool = False


@contextmanager
def stop_on_signals() -> Generator[StopRequest, None, None]:
    """Within the block the first Ctrl-C or SIGTERM sets `requested`; a Ctrl-C after it raises KeyboardInterrupt, but
    not a SIGTERM: with PR_SET_PDEATHSIG Linux sends a child one for each thread of a killed parent. Outside the main
    thread no handler is installed."""
    stop = StopRequest()

    def request(signal_number: int, frame: object) -> None:
        if stop.requested and signal_number == signal.SIGINT:
            raise KeyboardInterrupt
        stop.requested = True

    handled = STOP_SIGNALS if current_thread() is main_thread() else ()
    before = {signal_number: signal.signal(signal_number, request) for signal_number in handled}
    try:
        yield stop
    finally:
        for signal_number, handler in before.items():
            signal.signal(signal_number, handler)
