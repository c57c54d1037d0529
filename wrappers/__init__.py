"""Wrappers, installed as `lilgym_mp.wrappers`, one per file.

A class wraps one Gymnasium environment; its factory, `name_v0`, applies the same transformation to a Gymnasium
environment, a vector environment of this package, or the PettingZoo game.
"""

from lilgym_mp.wrappers.action_mask import ActionMask
from lilgym_mp.wrappers.box_permutation import BoxPermutation
from lilgym_mp.wrappers.channels_first import ChannelsFirst
from lilgym_mp.wrappers.embedding import StatementEmbedding
from lilgym_mp.wrappers.flat import FlatObservation
from lilgym_mp.wrappers.grid_planes import GridPlanes
from lilgym_mp.wrappers.gymnasium_adapter import factory
from lilgym_mp.wrappers.image import ImageObservation
from lilgym_mp.wrappers.multi_discrete import MultiDiscreteActions
from lilgym_mp.wrappers.named_actions import NamedActions
from lilgym_mp.wrappers.native_image import NativeImage
from lilgym_mp.wrappers.nlvr_reward import NLVRReward
from lilgym_mp.wrappers.potential_shaping import PotentialShaping
from lilgym_mp.wrappers.reverse_curriculum import ReverseCurriculum, reverse_curriculum_v0
from lilgym_mp.wrappers.steps_left import StepsLeft
from lilgym_mp.wrappers.stop_forcing import StopForcing
from lilgym_mp.wrappers.structured import StructuredObservation
from lilgym_mp.wrappers.text import TextObservation
from lilgym_mp.wrappers.tokens import TokenizedStatement
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
