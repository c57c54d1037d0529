"""Public names of environments, wrappers and the SB3 adapter can be sent to other processes."""

import pytest

from tests.command_line import python

# A script that sends every public object to a spawned process by cloudpickle, inside a function of `__main__`.
SCRIPT = """
import importlib, inspect, multiprocessing, pkgutil
import cloudpickle
import gymnasium as gym
import lilgym_mp.sb3
from lilgym_mp import envs, sb3, wrappers

def public():
    for package in (envs, sb3, wrappers):
        for _, name, _ in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            if ".fast" in name:  # generated code, which is not public
                continue
            module = importlib.import_module(name)
            yield name, module
            for each, value in vars(module).items():
                if not each.startswith("_") and getattr(value, "__module__", None) == name:
                    if inspect.isclass(value) or inspect.isfunction(value):
                        yield f"{name}:{each}", value
        for each in getattr(package, "__all__", ()):
            yield f"{package.__name__}:{each}", getattr(package, each)

def received(item):
    name, data = item
    module, _, attribute = name.partition(":")
    found = importlib.import_module(module)
    found = getattr(found, attribute) if attribute else found
    value = cloudpickle.loads(data)()
    same = value is found or (callable(value) and not inspect.isfunction(value) and not inspect.isclass(value))
    return name, same or type(value) in (dict, tuple)

def spec_made(data):
    spec = cloudpickle.loads(data)
    env = gym.make(spec)
    return env.spec.id == spec.id and "task" in env.reset(seed=0)[1]

def holder(value):
    return lambda: value

if __name__ == "__main__":
    items = [(name, cloudpickle.dumps(holder(value))) for name, value in public()]
    specs = [cloudpickle.dumps(spec) for spec in gym.registry.values() if spec.id.startswith("lilgym_mp/")]
    specs.append(cloudpickle.dumps(wrappers.StopForcing(gym.make("lilgym_mp/TowerScratch-v0")).spec))
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        print([name for name, same in pool.map(received, items) if not same])
        print(all(pool.map(spec_made, specs)), len(items) > 200, len(specs) > 4)
"""


@pytest.mark.long
def test_public_names__are_sent_to_spawned_processes_by_cloudpickle(tmp_path):
    for needed in ("cloudpickle", "stable_baselines3", "pettingzoo"):
        pytest.importorskip(needed, reason=f"needs the package {needed}")
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    done = python(script, cwd=tmp_path)
    assert done.stdout.splitlines() == ["[]", "True True True"], done.stdout + done.stderr
