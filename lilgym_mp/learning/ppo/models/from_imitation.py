"""PPO initialised from a run of `lilgym-mp train imitation`: the network of `imitation.network` with a critic.

It reads items from the boxes' pixels. P(STOP) is the probability that the statement has the target value; then ADD or
REMOVE is chosen: a factored policy like that of the other models.
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
from lilgym_mp.learning.imitation.agent import Architecture, load_agent
from lilgym_mp.learning.imitation.batches import DistinctBoxes, StatementTokenizer, box_inputs, pad_rows
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

MAX_CACHED_BOXES = 50_000


class ImitationModel(Model):
    """The imitation network's policy; the critic sees its type logits and steps-to-go logits."""

    def __init__(self, appearance: Appearance, architecture: Architecture, pretraining: str) -> None:
        super().__init__()
        self.architecture, self.pretraining = architecture, pretraining
        self.factorisation = _factorisation(appearance)
        self.network = architecture.network()
        self.critic = nn.Sequential(nn.Linear(1 + 2 + MAX_STEPS, 64), nn.ReLU(), nn.Linear(64, 1))
        self._tokenizer = StatementTokenizer(Vocabulary(architecture.vocabulary))
        self._table = BoxFeatureTable()
        self._box_indices: dict[int, int] = {}  # box hash -> index in the table

    def details(self) -> Mapping[str, Any]:
        return {"network": self.architecture.to_json(), "pretraining": self.pretraining}

    def forward(self, states: States) -> Prediction:
        device = next(self.critic.parameters()).device
        groups = group_by_statement(states)
        pairs = groups.pairs
        count, most = pairs.padded.shape
        scenes = (pairs.positions % most)[groups.pairs_of][groups.states.padded]  # (S, M, 3) of the statement's boxes
        present = np.arange(most) < pairs.counts[:, None]
        boxes = DistinctBoxes(self._boxes(states)[groups.boxes][pairs.padded], present, scenes, most)
        words = pad_rows([self._tokenizer.encode(one) for one in states.statements], MIN_PADDED_WORDS)
        inputs = Inputs(
            words=torch.from_numpy(words).to(device),
            **box_inputs(self._table, boxes, np.zeros(count, np.int64), device),
        )
        padded_targets = states.targets[groups.states.padded]  # (S, M)
        outputs = self.network(inputs, torch.from_numpy(padded_targets).to(device))
        rows = torch.from_numpy(groups.states.positions).to(device)
        targets = torch.from_numpy(states.targets).to(device)

        def of_states(by_statement: Tensor) -> Tensor:
            return by_statement.flatten(0, 1).index_select(0, rows)

        truth = of_states(outputs.truth)
        stop = torch.where(targets == 1, truth, -truth)[:, None]
        types = torch.cat([stop, of_states(outputs.types).log_softmax(-1)], 1)
        values = self.critic(torch.cat([types, of_states(outputs.steps)], 1))
        heads = of_states(outputs.adds), of_states(outputs.removes)
        return Prediction(types, heads, torch.tanh(values.float()).squeeze(1))

    def _boxes(self, states: States) -> Int64Array:
        """(U,) box indices in the table; new boxes are read from their pixels."""
        if len(self._box_indices) > MAX_CACHED_BOXES:
            self._box_indices, self._table = {}, BoxFeatureTable()
        hashes = states.box_hashes.tolist()
        new = [position for position, box_hash in enumerate(hashes) if box_hash not in self._box_indices]
        if new:
            images = np.broadcast_to(draw(Scene.empty(), "half"), (-(-len(new) // BOX_COUNT), *IMAGE_SHAPE)).copy()
            boxes = states.boxes()
            for index, position in enumerate(new):
                image, box = divmod(index, BOX_COUNT)
                images[image, :, box * PITCH : box * PITCH + SIDE] = boxes[position]
            scenes = read_scenes(images, self.architecture.appearance)
            found = [box for scene in scenes for box in scene.boxes]
            self._box_indices.update(
                (hashes[position], self._table.index(box)) for position, box in zip(new, found, strict=False)
            )
        self._table.update_features()
        return np.array([self._box_indices[box_hash] for box_hash in hashes], np.int64)


def from_run(appearance: Appearance, weights: Path | None) -> ImitationModel:
    """A model with the network of an imitation run. Raises WeightsError naming the path and what is wrong with it."""
    if weights is None:
        raise WeightsError(
            "the model 'imitation' starts from a trained network: name its run directory, written by"
            " `lilgym-mp train imitation`, with --weights"
        )
    try:
        agent = load_agent(agent_file(weights), "cpu")
    except (AgentError, ModelFileError) as error:
        raise WeightsError(str(error)) from None
    if agent.architecture.appearance != appearance.name:
        raise WeightsError(f"{weights}: a network for {agent.architecture.appearance}, not for {appearance.name}")
    model = ImitationModel(
        appearance, agent.architecture, f"initialised from imitation: {agent.description.supervision}"
    )
    model.network.load_state_dict(agent.network.state_dict())
    return model


def from_details(appearance: Appearance, details: Mapping[str, Any]) -> ImitationModel:
    """The untrained model described by a model file. Raises ValueError, TypeError, KeyError."""
    return ImitationModel(appearance, Architecture.from_json(details["network"]), str(details["pretraining"]))


def _factorisation(appearance: Appearance) -> Factorisation:
    """The imitation network's heads. Raises WeightsError for a grid it cannot play."""
    if not isinstance(appearance, Tower | Scatter) or (isinstance(appearance, Scatter) and appearance != Scatter()):
        raise WeightsError(f"the model 'imitation' plays Tower, and Scatter on the grid 19 x 5; not {appearance}")
    logits = action_heads(appearance)
    index_of = logits.index_of
    first_remove = 1 + logits.add_count
    types = np.select(
        [index_of == STOP_INDEX, index_of >= first_remove, index_of > STOP_INDEX],
        [ActionType.STOP, ActionType.REMOVE, ActionType.ADD],
        UNUSED,
    ).astype(np.int64)
    choices = np.full((len(types), 2), UNUSED, np.int64)
    choices[types == ActionType.ADD, 0] = index_of[types == ActionType.ADD] - 1
    choices[types == ActionType.REMOVE, 1] = index_of[types == ActionType.REMOVE] - first_remove
    heads = Head("add", logits.add_count, (ActionType.ADD,)), Head("remove", logits.remove_count, (ActionType.REMOVE,))
    return Factorisation(heads, types, choices)
