"""PPO's predictions and updates as CUDA graphs, for networks whose inputs have fixed shapes.

A small network's kernels take longer to launch than to execute, and the paper's recipe makes 320 updates of 64 states
a rollout. A CUDA graph launches all kernels of a prediction or of an update at once. On CPUs the same functions are
called without graphs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor, nn

from lilgym_mp.learning.common.factored_policy import FactoredPolicy
from lilgym_mp.learning.common.model import Model, Prediction
from lilgym_mp.learning.common.optimisation import check_finite
from lilgym_mp.learning.common.states import States
from lilgym_mp.learning.common.update import Experience, Losses, Transitions, losses, mean_losses, mini_batches
from lilgym_mp.learning.ppo.learner import PPORecipe

CALLS_BEFORE_CAPTURE = 3  # without a graph: they initialise libraries and the optimiser


class Graphed:
    """A function of tensors of fixed shapes, captured on CUDA and then replayed. A call overwrites earlier outputs."""

    def __init__(self, function: Callable[..., tuple[Tensor, ...]]) -> None:
        self._function = function
        self._calls = 0
        self._graph = cast("Any", None)
        self._inputs = self._given = self._outputs = cast("tuple[Tensor, ...]", ())  # given: at the latest call

    def __call__(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        """An input that is the same object as at the call before must have the same values."""
        if inputs[0].device.type != "cuda":
            return self._function(*inputs)
        if not self._inputs:
            self._inputs = tuple(given.clone() for given in inputs)
            self._given = inputs
        for own, given, before in zip(self._inputs, inputs, self._given, strict=True):
            if given is not before:
                own.copy_(given)
        self._given = inputs
        self._calls = self._calls + 1
        if self._calls <= CALLS_BEFORE_CAPTURE:  # as torch requires, on another stream
            stream = torch.cuda.Stream()
            current = torch.cuda.current_stream()
            stream.wait_stream(current)
            with torch.cuda.stream(stream):
                outputs = self._function(*self._inputs)
            current.wait_stream(stream)
            return outputs
        if self._graph is None:
            self._graph = torch.cuda.CUDAGraph()
            with torch.cuda.graph(self._graph):
                self._outputs = self._function(*self._inputs)
        self._graph.replay()
        return self._outputs


class GraphedModel(Model):
    """A model that predicts on the CPU for always the same number of states, and is updated."""

    def __init__(
        self, model: Model, optimiser: torch.optim.Optimizer, recipe: PPORecipe, precision: Callable[[], Any]
    ) -> None:
        super().__init__()
        self.factorisation = model.factorisation
        self._model = model
        self._precision = precision
        self._optimiser = optimiser
        self._recipe = recipe
        self._predict = Graphed(self._prediction)
        self._step = Graphed(self._optimise)

    def forward(self, states: States) -> Prediction:
        (joined,) = self._predict(*self._model.fixed_inputs(states))
        types, *heads, values = joined.cpu().split(self._sizes, 1)
        return Prediction(types, tuple(heads), values.squeeze(1))

    def _prediction(self, *inputs: Tensor) -> tuple[Tensor]:
        torch.clear_autocast_cache()  # a graph must not contain copies of earlier weights
        with torch.no_grad(), self._precision():
            types, heads, values = self._model(inputs)
        parts = [types, *heads, values[:, None]]
        self._sizes = [part.shape[1] for part in parts]
        return (torch.cat(parts, 1),)

    def update(
        self, states: States, experience: Experience, entropy_coefficient: float, rng: np.random.Generator
    ) -> list[Losses]:
        """As `update`, with the mini-batches of a rollout's states gathered on the device. Raises TrainingRunError."""
        recipe = self._recipe
        columns = (*self._model.fixed_inputs(states), *experience.transitions)
        (group,) = self._optimiser.param_groups
        rate = group["lr"]
        coefficients = torch.tensor([entropy_coefficient, rate], device=columns[0].device)
        steps: list[Tensor] = []
        for _ in range(recipe.epochs):
            grouped = recipe.same_statement > 1
            batches = mini_batches(experience.statement_of, recipe.batch_size, rng, by_statement=grouped)
            for rows in torch.from_numpy(np.stack(list(batches))).to(coefficients.device):
                steps.append(torch.stack(self._step(coefficients, rows, *columns)))
        group |= {"lr": rate, "capturable": False}  # as in a checkpoint that any device can continue from
        found = [Losses(*step) for step in torch.stack(steps).cpu()]
        mean = mean_losses(found)
        check_finite(mean.total, policy=mean.policy, value=mean.value)
        return found

    def _optimise(self, coefficients: Tensor, rows: Tensor, *columns: Tensor) -> tuple[Tensor, ...]:
        entropy_coefficient, rate = coefficients
        *inputs, actions, log_probabilities, values, advantages, returns, forced = (column[rows] for column in columns)
        old = Transitions(actions, log_probabilities, values, advantages, returns, forced)
        self._optimiser.zero_grad()
        with self._precision():
            types, heads, values = self._model(tuple(inputs))
        policy = FactoredPolicy(self._model.factorisation, types, heads)
        loss = losses(self._recipe, policy, values, old, entropy_coefficient)
        loss.total.backward()
        (group,) = self._optimiser.param_groups
        nn.utils.clip_grad_norm_(group["params"], self._recipe.gradient_norm)
        group |= {"lr": rate, "capturable": rate.is_cuda and torch.cuda.is_current_stream_capturing()}
        self._optimiser.step()
        return loss._replace(total=loss.total.detach())
