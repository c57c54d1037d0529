"""Script that plays a lilGym release; run by the release's own Python, so it uses only the standard library.

Input and output are lines of JSON: the first request describes the environment and the episodes, and every further
line requests to play the episodes once. Importing `lilgym` registers its environments with Gym or Gymnasium; the one
whose id contains the configuration's name is used.
"""

import importlib
import json
import os
import sys
from time import perf_counter

TOOLKITS = ("gym", "gymnasium")


def find_maker(configuration):  # type: ignore[no-untyped-def]
    """A function that makes the environment. Raises LookupError naming the registered ones."""
    seen = []
    for name in TOOLKITS:
        try:
            toolkit = importlib.import_module(name)
        except ImportError:
            continue
        registry = toolkit.envs.registry
        ids = list(getattr(registry, "env_specs", registry))  # older versions of Gym have env_specs
        seen += ids
        matches = [each for each in ids if configuration.lower() in each.lower().replace("-", "").replace("_", "")]
        if matches:
            return lambda options: toolkit.make(matches[0], **options)
    related = [each for each in seen if "tower" in each.lower() or "scatter" in each.lower()]
    found = ", ".join(related) or "none of tower or scatter"
    raise LookupError(f"no environment {configuration} was registered by importing lilgym; there are: {found}")


def play(env, episodes):  # type: ignore[no-untyped-def]
    """Steps and seconds. If the release ends an episode early, the next one begins."""
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
    os.dup2(2, 1)  # because the release prints to standard output

    def answer(content):  # type: ignore[no-untyped-def]
        answers.write(json.dumps(content) + "\n")
        answers.flush()

    try:
        setup = json.loads(sys.stdin.readline())
        sys.path.insert(0, setup["directory"])
        importlib.import_module("lilgym")
        env = find_maker(setup["configuration"])(setup["options"])
        answer({"ready": True})
        for _ in sys.stdin:
            answer(play(env, setup["episodes"]))
    except BrokenPipeError:
        return
    except Exception as error:
        answer({"error": f"{type(error).__name__}: {error}"})


if __name__ == "__main__":
    main()
