"""Wrappers, installed as `lilgym_mp.wrappers`.

A class wraps one Gymnasium environment; its factory, `name_v0`, applies the same transformation to a Gymnasium
environment, a vector environment of this package, or the PettingZoo game.
"""

from lilgym_mp.wrappers.actions import ActionMask as ActionMask
from lilgym_mp.wrappers.actions import MultiDiscreteActions as MultiDiscreteActions
from lilgym_mp.wrappers.actions import StopForcing as StopForcing
from lilgym_mp.wrappers.formats import ChannelsFirst as ChannelsFirst
from lilgym_mp.wrappers.formats import FlatObservation as FlatObservation
from lilgym_mp.wrappers.formats import GridPlanes as GridPlanes
from lilgym_mp.wrappers.formats import ImageObservation as ImageObservation
from lilgym_mp.wrappers.formats import StatementEmbedding as StatementEmbedding
from lilgym_mp.wrappers.formats import StepsLeft as StepsLeft
from lilgym_mp.wrappers.formats import StructuredObservation as StructuredObservation
from lilgym_mp.wrappers.formats import TokenizedStatement as TokenizedStatement
from lilgym_mp.wrappers.gymnasium_adapter import factory
from lilgym_mp.wrappers.text import TextObservation as TextObservation
from lilgym_mp.wrappers.training import BoxPermutation as BoxPermutation
from lilgym_mp.wrappers.training import NLVRReward as NLVRReward
from lilgym_mp.wrappers.training import PotentialShaping as PotentialShaping
from lilgym_mp.wrappers.transformation import WrongEnvironment as WrongEnvironment

action_mask_v0 = factory(ActionMask)
box_permutation_v0 = factory(BoxPermutation)
channels_first_v0 = factory(ChannelsFirst)
statement_embedding_v0 = factory(StatementEmbedding)
flat_observation_v0 = factory(FlatObservation)
grid_planes_v0 = factory(GridPlanes)
image_observation_v0 = factory(ImageObservation)
multi_discrete_actions_v0 = factory(MultiDiscreteActions)
nlvr_reward_v0 = factory(NLVRReward)
potential_shaping_v0 = factory(PotentialShaping)
steps_left_v0 = factory(StepsLeft)
stop_forcing_v0 = factory(StopForcing)
structured_observation_v0 = factory(StructuredObservation)
text_observation_v0 = factory(TextObservation)
tokenized_statement_v0 = factory(TokenizedStatement)
