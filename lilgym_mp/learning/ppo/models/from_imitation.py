"""The network that `lilgym-mp train imitation` trains, with a critic: PPO begins from one of its runs.

It reads items from the boxes' pixels and is otherwise what `imitation.network` says. Its STOP is as likely as the
statement has the target's value, then an ADD or a REMOVE is chosen: the type-first policy of all models here.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from lilgym_mp.actions import ActionType
from lilgym_mp.appearances import Appearance, Scatter, Tower
from lilgym_mp.arrays import Int64Array
from lilgym_mp.corpus import Vocabulary
from lilgym_mp.learning.agents import AgentError, agent_file
from lilgym_mp.learning.imitation.action_heads import STOP_INDEX, action_heads
from lilgym_mp.learning.imitation.agent import Shape, load_agent
from lilgym_mp.learning.imitation.batches import Boxes, StatementTokenizer, box_inputs, padded
from lilgym_mp.learning.imitation.box_features import BoxFeatureTable
from lilgym_mp.learning.imitation.network import MAX_STEPS, MIN_PADDED_WORDS, Inputs
from lilgym_mp.learning.model_file import ModelFileError
from lilgym_mp.learning.ppo.factored_policy import UNUSED, Factorisation, Head
from lilgym_mp.learning.ppo.models.grouping import group_by_statement
from lilgym_mp.learning.ppo.models.protocol import Model, Prediction
from lilgym_mp.learning.ppo.models.weights import WeightsError
from lilgym_mp.learning.ppo.states import IMAGE_SHAPE, PITCH, SIDE, States
from lilgym_mp.perception import read_scenes
from lilgym_mp.render import draw
from lilgym_mp.scene import BOX_COUNT, Scene

MOST_REMEMBERED = 50_000  # distinct boxes that were read


class ImitationModel(Model):
    """The policy of a network that imitation trains; its critic sees how far from the end the network thinks it is."""

    def __init__(self, appearance: Appearance, shape: Shape, pretraining: str) -> None:
        super().__init__()
        self.shape, self.pretraining = shape, pretraining
        self.factorisation = _factorisation(appearance)
        self.network = shape.network()
        self.critic = nn.Sequential(nn.Linear(1 + 2 + MAX_STEPS, 64), nn.ReLU(), nn.Linear(64, 1))
        self._tokenizer = StatementTokenizer(Vocabulary(shape.vocabulary))
        self._table = BoxFeatureTable()
        self._read: dict[int, int] = {}  # by a box's code, its index in the table

    def details(self) -> Mapping[str, Any]:
        return {"network": self.shape.to_json(), "pretraining": self.pretraining}

    def forward(self, states: States) -> Prediction:
        device = next(self.critic.parameters()).device
        groups = group_by_statement(states)
        pairs = groups.pairs
        count, most = pairs.padded.shape
        scenes = (pairs.places % most)[groups.pairs_of][groups.states.padded]  # (S, M, 3) of the statement's boxes
        present = np.arange(most) < pairs.counts[:, None]
        boxes = Boxes(self._boxes(states)[groups.boxes][pairs.padded], present, scenes, most)
        words = padded([self._tokenizer.encode(one) for one in states.statements], MIN_PADDED_WORDS)
        inputs = Inputs(
            words=torch.from_numpy(words).to(device),
            **box_inputs(self._table, boxes, np.zeros(count, np.int64), device),
        )
        targets = states.targets[groups.states.padded]  # (S, M)
        outputs = self.network(inputs, torch.from_numpy(targets).to(device))
        rows, wanted = torch.from_numpy(groups.states.places).to(device), torch.from_numpy(states.targets).to(device)

        def of_states(by_statement: Tensor) -> Tensor:
            return by_statement.flatten(0, 1).index_select(0, rows)

        truth = of_states(outputs.truth)
        stop = torch.where(wanted == 1, truth, -truth)[:, None]
        types = torch.cat([stop, of_states(outputs.types).log_softmax(-1)], 1)
        values = self.critic(torch.cat([types, of_states(outputs.steps)], 1))
        heads = of_states(outputs.adds), of_states(outputs.removes)
        return Prediction(types, heads, torch.tanh(values.float()).squeeze(1))

    def _boxes(self, states: States) -> Int64Array:
        """(U,) indices of the boxes in the table; those that are new are read from their pixels."""
        if len(self._read) > MOST_REMEMBERED:
            self._read, self._table = {}, BoxFeatureTable()
        codes = states.box_codes.tolist()
        new = [place for place, code in enumerate(codes) if code not in self._read]
        if new:
            pictures = np.broadcast_to(draw(Scene.empty(), "half"), (-(-len(new) // BOX_COUNT), *IMAGE_SHAPE)).copy()
            boxes = states.boxes()
            for index, place in enumerate(new):
                image, box = divmod(index, BOX_COUNT)
                pictures[image, :, box * PITCH : box * PITCH + SIDE] = boxes[place]
            scenes = read_scenes(pictures, self.shape.appearance)
            found = [box for scene in scenes for box in scene.boxes]
            self._read.update((codes[place], self._table.index(box)) for place, box in zip(new, found, strict=False))
        self._table.describe()
        return np.array([self._read[code] for code in codes], np.int64)


def begun(appearance: Appearance, weights: Path | None) -> ImitationModel:
    """A model with the network of an imitation run. Raises WeightsError naming the place and what is wrong with it."""
    if weights is None:
        raise WeightsError(
            "the model 'imitation' begins from a trained network: name the run with --weights, a directory that"
            " `lilgym-mp train imitation` wrote"
        )
    try:
        agent = load_agent(agent_file(weights), "cpu")
    except (AgentError, ModelFileError) as fault:
        raise WeightsError(str(fault)) from None
    if agent.shape.appearance != appearance.name:
        raise WeightsError(f"{weights}: a network for {agent.shape.appearance}, not for {appearance.name}")
    model = ImitationModel(appearance, agent.shape, f"begun from imitation: {agent.description.supervision}")
    model.network.load_state_dict(agent.network.state_dict())
    return model


def described(appearance: Appearance, details: Mapping[str, Any]) -> ImitationModel:
    """A model that a file describes. Raises ValueError, TypeError, KeyError for other details."""
    return ImitationModel(appearance, Shape.from_json(details["network"]), str(details["pretraining"]))


def _factorisation(appearance: Appearance) -> Factorisation:
    """The heads of the imitation network. Raises WeightsError for a grid that it cannot play."""
    if not isinstance(appearance, Tower | Scatter) or (isinstance(appearance, Scatter) and appearance != Scatter()):
        raise WeightsError(f"the model 'imitation' plays Tower, and Scatter on the grid 19 x 5; not {appearance}")
    found = action_heads(appearance)
    heads_of = found.index_of
    first_removal = 1 + found.adds
    types = np.select(
        [heads_of == STOP_INDEX, heads_of >= first_removal, heads_of > STOP_INDEX],
        [ActionType.STOP, ActionType.REMOVE, ActionType.ADD],
        UNUSED,
    ).astype(np.int64)
    choices = np.full((len(types), 2), UNUSED, np.int64)
    choices[types == ActionType.ADD, 0] = heads_of[types == ActionType.ADD] - 1
    choices[types == ActionType.REMOVE, 1] = heads_of[types == ActionType.REMOVE] - first_removal
    heads = Head("add", found.adds, (ActionType.ADD,)), Head("remove", found.removes, (ActionType.REMOVE,))
    return Factorisation(heads, types, choices)
