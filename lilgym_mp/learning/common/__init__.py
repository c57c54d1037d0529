"""What several learners share; each learner imports this package and no other learner."""

from lilgym_mp.submodules import submodule_getter

__getattr__ = submodule_getter(__name__)
