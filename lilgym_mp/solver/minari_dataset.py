"""Demonstrations as a Minari dataset for offline learning. Minari is imported only when one is written."""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
import numpy as np

from lilgym_mp.solver.demonstrations import Demonstration

if TYPE_CHECKING:
    from lilgym_mp.envs.single import LilGymEnv

ALGORITHM = "lilgym_mp expert"
HDF5_FORMAT = ("v110", "v110")  # oldest and newest version written; headers take a third of the space of older ones


def write_minari(
    dataset_id: str,
    episodes: Sequence[Demonstration],
    env: gym.Env[Any, Any],
    eval_env: gym.Env[Any, Any],
    description: str,
) -> None:
    """Writes the dataset to Minari's data directory; the infos contain each episode's task id and program.

    Each episode is replayed in `env`, so that its observations are stored; `eval_env` is what
    `recover_environment(eval_env=True)` makes again. The HDF5 file is compressed by gzip without loss, which Minari can
    read and append to as usual. If writing fails, no files remain. Raises ModuleNotFoundError without Minari, and
    ValueError for no episodes or a dataset id that is invalid or in use.
    """
    minari = import_module("minari")
    if not episodes:
        raise ValueError("there are no demonstrations: none of the tasks was solved")
    path: Path = import_module("minari.storage").get_dataset_path(dataset_id)
    if path.exists():
        raise ValueError(f"the Minari dataset {dataset_id!r} exists already; choose another name, or delete it")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # warnings about missing authors and links
            dataset = minari.create_dataset_from_buffers(
                dataset_id,
                (_buffer(episode, env) for episode in episodes),
                env=env.spec,
                eval_env=eval_env.spec,
                observation_space=env.observation_space,
                action_space=env.action_space,
                algorithm_name=ALGORITHM,
                description=description,
                jpeg_encoding=False,
                data_format="hdf5",
            )
        _compress(dataset.storage)
    except BaseException:
        shutil.rmtree(path, ignore_errors=True)
        raise


def _buffer(episode: Demonstration, env: gym.Env[Any, Any]) -> Any:
    """The episode as the environment shows it."""
    task, count = episode.task, len(episode.actions)
    unwrapped = cast("LilGymEnv", env.unwrapped)
    actions = [unwrapped.dynamics.appearance.encode(action) for action in episode.actions]
    observed = [env.reset(options={"task": task.id})[0], *(env.step(action)[0] for action in actions)]
    last = (False,) * (count - 1)
    return import_module("minari.data_collector").EpisodeBuffer(
        options={"task": task.id},
        observations={name: [observation[name] for observation in observed] for name in observed[0]},
        actions=np.array(actions, np.int64),
        rewards=np.array(episode.rewards, np.float64),
        terminations=[*last, episode.terminated],
        truncations=[*last, episode.truncated],
        infos={"program": [task.program] * (count + 1), "task": [task.id] * (count + 1)},
    )


def _compress(storage: Any) -> None:
    """Rewrites the file of Minari's storage compressed; Minari itself does not compress, and pads every array."""
    h5py: Any = import_module("h5py")
    path: Path = storage.data_path / "main_data.hdf5"
    smaller = path.with_suffix(".tmp")
    with h5py.File(path, "r") as source, h5py.File(smaller, "w", libver=HDF5_FORMAT, track_order=True) as target:
        _copy_compressed(source, target)
    smaller.replace(path)
    storage.update_metadata({"dataset_size": storage.get_size()})


def _copy_compressed(source: Any, target: Any) -> None:
    """Copies an HDF5 group; each array becomes one compressed chunk and stays extensible."""
    target.attrs.update(source.attrs)
    for name, part in source.items():
        if hasattr(part, "items"):
            _copy_compressed(part, target.create_group(name))
        elif part.shape and part.size:
            settings = {"chunks": part.shape, "maxshape": part.maxshape, "compression": "gzip", "shuffle": True}
            target.create_dataset(name, data=part[()], dtype=part.dtype, **settings).attrs.update(part.attrs)
        else:
            source.copy(name, target)
