"""Adds a trained agent to the package data, in half precision: ship_agent.py RUN NAME"""

from __future__ import annotations

import argparse
from pathlib import Path

from lilgym_mp.learning.common.agents import agent_file
from lilgym_mp.learning.common.model_file import load_model, save_model

DATA = Path(__file__).resolve().parents[1] / "data"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path, metavar="RUN")
    parser.add_argument("name", metavar="NAME")
    args = parser.parse_args()
    description, tensors = load_model(agent_file(args.run))
    if description.recipe.get("corpus", description.details.get("corpus")) != "builtin":
        raise SystemExit(f"{args.run} was not trained on the builtin corpus alone, so it must not be shipped")
    path = DATA / f"agent-{args.name}.safetensors"
    save_model(path, description, {name: tensor.half() for name, tensor in tensors.items()})
    print(f"{path}: {path.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
