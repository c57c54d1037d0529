"""The script that plays a lilGym release: run by its own Python, so it needs nothing but the standard library.

The first line of its input says what to play, every other one asks for playing it once; each is answered by a line
of JSON. The release registers its environments with Gym or Gymnasium when `lilgym` is imported; the one whose id
names the configuration is made.
"""

import importlib
import json
import os
import sys
from time import perf_counter

TOOLKITS = ("gym", "gymnasium")


def find_maker(configuration):  # type: ignore[no-untyped-def]
    """A function that makes the environment. Raises LookupError naming what there is."""
    seen = []
    for name in TOOLKITS:
        try:
            toolkit = importlib.import_module(name)
        except ImportError:
            continue
        registry = toolkit.envs.registry
        ids = list(getattr(registry, "env_specs", registry))  # older versions keep a table within
        seen += ids
        fitting = [each for each in ids if configuration.lower() in each.lower().replace("-", "").replace("_", "")]
        if fitting:
            return lambda options: toolkit.make(fitting[0], **options)
    ours = [each for each in seen if "tower" in each.lower() or "scatter" in each.lower()]
    found = ", ".join(ours) or "none of tower or scatter"
    raise LookupError(f"no environment {configuration} was registered by importing lilgym; there are: {found}")


def play(env, episodes):  # type: ignore[no-untyped-def]
    """Steps taken and seconds. Where the release's own task ends an episode early, the next one begins."""
    steps = 0
    env.reset()
    started = perf_counter()
    for actions in episodes:
        for action in actions:
            result = env.step(action)
            steps += 1
            if result[2] or (len(result) > 4 and result[3]):
                break
        env.reset()
    return {"steps": steps, "seconds": perf_counter() - started}


def main() -> None:
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # the release prints

    def answer(said):  # type: ignore[no-untyped-def]
        answers.write(json.dumps(said) + "\n")
        answers.flush()

    try:
        order = json.loads(sys.stdin.readline())
        sys.path.insert(0, order["directory"])
        importlib.import_module("lilgym")
        env = find_maker(order["configuration"])(order["options"])
        answer({"ready": True})
        for _ in sys.stdin:
            answer(play(env, order["episodes"]))
    except BrokenPipeError:
        return
    except Exception as error:
        answer({"error": f"{type(error).__name__}: {error}"})


if __name__ == "__main__":
    main()
