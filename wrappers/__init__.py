"""Wrappers, installed as `lilgym_mp.wrappers`.

A class wraps one Gymnasium environment; its factory, `name_v0`, applies the same transformation to a Gymnasium
environment, a vector environment of this package, or the PettingZoo game.
"""

from lilgym_mp.wrappers.actions import ActionMask, MultiDiscreteActions, NamedActions, StopForcing
from lilgym_mp.wrappers.formats import (
    ChannelsFirst,
    FlatObservation,
    GridPlanes,
    ImageObservation,
    NativeImage,
    StatementEmbedding,
    StepsLeft,
    StructuredObservation,
    TokenizedStatement,
)
from lilgym_mp.wrappers.gymnasium_adapter import factory
from lilgym_mp.wrappers.text import TextObservation
from lilgym_mp.wrappers.training import (
    BoxPermutation,
    NLVRReward,
    PotentialShaping,
    ReverseCurriculum,
    reverse_curriculum_v0,
)
from lilgym_mp.wrappers.transformation import WrongEnvironment

action_mask_v0 = factory(ActionMask)
box_permutation_v0 = factory(BoxPermutation)
channels_first_v0 = factory(ChannelsFirst)
statement_embedding_v0 = factory(StatementEmbedding)
flat_observation_v0 = factory(FlatObservation)
grid_planes_v0 = factory(GridPlanes)
image_observation_v0 = factory(ImageObservation)
multi_discrete_actions_v0 = factory(MultiDiscreteActions)
named_actions_v0 = factory(NamedActions)
native_image_v0 = factory(NativeImage)
nlvr_reward_v0 = factory(NLVRReward)
potential_shaping_v0 = factory(PotentialShaping)
steps_left_v0 = factory(StepsLeft)
stop_forcing_v0 = factory(StopForcing)
structured_observation_v0 = factory(StructuredObservation)
text_observation_v0 = factory(TextObservation)
tokenized_statement_v0 = factory(TokenizedStatement)

__all__ = [
    "ActionMask",
    "BoxPermutation",
    "ChannelsFirst",
    "FlatObservation",
    "GridPlanes",
    "ImageObservation",
    "MultiDiscreteActions",
    "NLVRReward",
    "NamedActions",
    "NativeImage",
    "PotentialShaping",
    "ReverseCurriculum",
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
    "flat_observation_v0",
    "grid_planes_v0",
    "image_observation_v0",
    "multi_discrete_actions_v0",
    "named_actions_v0",
    "native_image_v0",
    "nlvr_reward_v0",
    "potential_shaping_v0",
    "reverse_curriculum_v0",
    "statement_embedding_v0",
    "steps_left_v0",
    "stop_forcing_v0",
    "structured_observation_v0",
    "text_observation_v0",
    "tokenized_statement_v0",
]
