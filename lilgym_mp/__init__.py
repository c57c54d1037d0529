"""Natural-language visual reasoning with reinforcement learning: one fast core, many environments."""

from pathlib import Path

__version__ = "0.1.0"

# In a checkout `wrappers` and `data` lie beside the package, not in it (pyproject.toml: package-dir).
if not Path(__file__).with_name("wrappers").is_dir():
    __path__.append(str(Path(__file__).resolve().parents[1]))

from lilgym_mp.envs.registration import register_all

register_all()
