"""Wrappers, installed as `lilgym_mp.wrappers`.

A class wraps one Gymnasium environment; its factory, `name_v0`, applies the same transformation to a Gymnasium
environment, a vector environment of this package, or the PettingZoo game.
"""

from lilgym_mp.submodules import submodule_getter
from lilgym_mp.wrappers.actions import ActionMask, MultiDiscreteActions, StopForcing
from lilgym_mp.wrappers.formats import (
    ChannelsFirst,
    FlatObservation,
    GridPlanes,
    ImageObservation,
    StatementEmbedding,
    StepsLeft,
    StructuredObservation,
    TokenizedStatement,
)
from lilgym_mp.wrappers.gymnasium_adapter import factory
from lilgym_mp.wrappers.text import TextObservation
from lilgym_mp.wrappers.training import BoxPermutation, NLVRReward, PotentialShaping
from lilgym_mp.wrappers.transformation import WrongEnvironment

__all__ = [
    "ActionMask",
    "BoxPermutation",
    "ChannelsFirst",
    "FlatObservation",
    "GridPlanes",
    "ImageObservation",
    "MultiDiscreteActions",
    "NLVRReward",
    "PotentialShaping",
    "StatementEmbedding",
    "StepsLeft",
    "StopForcing",
    "StructuredObservation",
    "TextObservation",
    "TokenizedStatement",
    "WrongEnvironment",
    "action_mask_v0",
    "box_permutation_v0",
    "channels_first_v0",
    "factory",
    "flat_observation_v0",
    "grid_planes_v0",
    "image_observation_v0",
    "multi_discrete_actions_v0",
    "nlvr_reward_v0",
    "potential_shaping_v0",
    "statement_embedding_v0",
    "steps_left_v0",
    "stop_forcing_v0",
    "structured_observation_v0",
    "text_observation_v0",
    "tokenized_statement_v0",
]

action_mask_v0 = factory(ActionMask, __name__)
box_permutation_v0 = factory(BoxPermutation, __name__)
channels_first_v0 = factory(ChannelsFirst, __name__)
statement_embedding_v0 = factory(StatementEmbedding, __name__)
flat_observation_v0 = factory(FlatObservation, __name__)
grid_planes_v0 = factory(GridPlanes, __name__)
image_observation_v0 = factory(ImageObservation, __name__)
multi_discrete_actions_v0 = factory(MultiDiscreteActions, __name__)
nlvr_reward_v0 = factory(NLVRReward, __name__)
potential_shaping_v0 = factory(PotentialShaping, __name__)
steps_left_v0 = factory(StepsLeft, __name__)
stop_forcing_v0 = factory(StopForcing, __name__)
structured_observation_v0 = factory(StructuredObservation, __name__)
text_observation_v0 = factory(TextObservation, __name__)
tokenized_statement_v0 = factory(TokenizedStatement, __name__)

__getattr__ = submodule_getter(__name__)
