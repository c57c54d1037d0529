"""Adds a trained agent to the package data, in half precision: ship_agent.py RUN NAME [--eight-bits]"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch

from lilgym_mp.learning.common.agents import agent_file
from lilgym_mp.learning.common.model_file import load_model, save_model

LARGE = 2_000  # weights of a matrix that --eight-bits affects
DATA = Path(__file__).resolve().parents[1] / "data"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path, metavar="RUN")
    parser.add_argument("name", metavar="NAME")
    parser.add_argument("--eight-bits", action="store_true", help="store large matrices as float8_e4m3fn")
    args = parser.parse_args()
    description, tensors = load_model(agent_file(args.run))
    sources = (description.recipe, description.details, description.details.get("settings", {}))
    if {source["corpus"] for source in sources if "corpus" in source} != {"builtin"}:
        raise SystemExit(f"{args.run} was not trained on the builtin corpus alone, so it must not be shipped")
    path = DATA / f"agent-{args.name}.safetensors"
    stored = {name: tensor.half() for name, tensor in tensors.items()}
    if args.eight_bits:
        large = [name for name, tensor in stored.items() if tensor.ndim > 1 and tensor.numel() >= LARGE]
        stored |= {name: tensors[name].to(torch.float8_e4m3fn) for name in large}
    save_model(path, description, stored)
    print(f"{path}: {path.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
