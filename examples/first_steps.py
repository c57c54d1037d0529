"""One episode step by step: the task, the expert's shortest solution, and a picture of every step.

Try: python examples/first_steps.py --seed 3 --output first_steps.png
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from PIL import Image

import lilgym_mp  # registers the environments
from lilgym_mp.solver import Expert

GAP = 24  # pixels between columns


def main() -> None:
    parser = argparse.ArgumentParser(description="One episode step by step, with pictures.")
    parser.add_argument("--id", default="lilgym_mp/ScatterFlipIt-v0")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=12, help="at most so many actions")
    parser.add_argument("--output", type=Path, default=Path("first_steps.png"))
    args = parser.parse_args()

    env = gym.make(args.id, render_mode="rgb_array")
    bare: Any = env.unwrapped
    observation, _ = env.reset(seed=args.seed)
    print(f"lilgym_mp {lilgym_mp.__version__}: {bare.action_masks().sum()} of {bare.action_space.n} actions are legal")
    print(f"{observation['statement']}  Make it {bool(observation['target'])}.")

    expert = Expert(env)
    frames = [bare.render()]
    for _ in range(args.steps):
        action = expert.act()
        _, reward, terminated, truncated, info = env.step(action)
        frames.append(bare.render())
        print(f"{bare.decode_action(action)}  reward {reward:+.1f}  {info.get('outcome', '')}".rstrip())
        if terminated or truncated:
            break
    sheet(frames).save(args.output)
    print(f"the pictures are in {args.output}")


def sheet(frames: list[np.ndarray], columns: int = 2) -> Image.Image:
    """The frames side by side, row by row."""
    height, width, _ = frames[0].shape
    rows = -(-len(frames) // columns)
    image = Image.new("RGB", (columns * width + GAP, rows * height), "white")
    for number, frame in enumerate(frames):
        row, column = divmod(number, columns)
        image.paste(Image.fromarray(frame), (column * (width + GAP), row * height))
    return image


if __name__ == "__main__":
    main()
