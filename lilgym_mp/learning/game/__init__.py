"""Learning both sides of the proposer-verifier game, on the update of `learning.common.update`."""

from lilgym_mp.submodules import submodule_getter

__getattr__ = submodule_getter(__name__)
