"""Training with Stable-Baselines3: environments, a policy, and a recipe."""

from lilgym_mp.submodules import submodule_getter

try:
    import sb3_contrib  # noqa: F401
    import stable_baselines3  # noqa: F401
except ModuleNotFoundError as missing:
    from lilgym_mp.corpus.extras import install

    raise ModuleNotFoundError(f"lilgym_mp.sb3 needs {missing.name}: {install('sb3')}", name=missing.name) from missing

from lilgym_mp.sb3.games import GameVecEnv, InfoMasks, make_game_vec_env
from lilgym_mp.sb3.policy import EntropySchedule, LilGymPolicy, Recipe, StatementRolloutBuffer, agent_of, recipe
from lilgym_mp.sb3.vec_env import BACKENDS, BatchVecEnv, make_vec_env

__all__ = ["BACKENDS", "BatchVecEnv", "EntropySchedule", "LilGymPolicy", "Recipe", "StatementRolloutBuffer"]
__all__ += ["GameVecEnv", "InfoMasks", "agent_of", "make_game_vec_env", "make_vec_env", "recipe"]

__getattr__ = submodule_getter(__name__)
