"""Plays one episode step by step: the task, the expert's shortest solution, and a picture of every step.

Try: python examples/first_steps.py --seed 3 --out first_steps.png
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import gymnasium as gym
from PIL import Image, ImageDraw

import lilgym_mp  # registers the environments
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.render.frames import INK_RGB, LINE_PIXELS, PAPER_RGB, caption_font, smooth_picture
from lilgym_mp.solver import Expert

GAP = 16  # pixels around pictures


def main() -> None:
    parser = argparse.ArgumentParser(description="Play one episode step by step, with pictures.")
    parser.add_argument("--id", default="lilgym_mp/ScatterFlipIt-v0")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--max-actions", type=int, default=12, help="maximum number of actions")
    parser.add_argument("--out", type=Path, default=Path("first_steps.png"))
    args = parser.parse_args()

    env = gym.make(args.id)
    unwrapped: Any = env.unwrapped
    observation, _ = env.reset(seed=args.seed)
    task = f"{observation['statement']}  Make it {str(bool(observation['target'])).lower()}."
    legal = lilgym_mp.action_masks(env)
    print(f"lilgym_mp {lilgym_mp.__version__}: {legal.sum()} of {unwrapped.action_space.n} actions are legal")
    print(task)

    expert = Expert(env)
    frames = [("start", unwrapped.scene)]
    for _ in range(args.max_actions):
        action = expert.act()
        _, reward, terminated, truncated, info = env.step(action)
        name = describe(unwrapped.dynamics.appearance.decode(action))
        frames.append((f"{name}  {float(reward):+.1f}", unwrapped.scene))
        print(f"{name}  action {action}, reward {float(reward):+.1f}  {info.get('outcome', '')}".rstrip())
        if terminated or truncated:
            break
    sheet(task, frames).save(args.out)
    print(f"the pictures are in {args.out}")


def sheet(title: str, frames: list[tuple[str, Scene]], columns: int = 2) -> Image.Image:
    """A grid of scenes, each with a caption above, under a title."""
    tiles = [(caption, Image.fromarray(smooth_picture(scene, 1))) for caption, scene in frames]
    width, height = tiles[0][1].size
    rows = -(-len(tiles) // columns)
    tile_width, tile_height = width + GAP, height + LINE_PIXELS + GAP
    image = Image.new("RGB", (columns * tile_width + GAP, rows * tile_height + LINE_PIXELS + GAP), PAPER_RGB)
    pen, font = ImageDraw.Draw(image), caption_font()
    pen.text((GAP, GAP // 2), title, fill=INK_RGB, font=font)
    for index, (caption, picture) in enumerate(tiles):
        row, column = divmod(index, columns)
        left, top = GAP + column * tile_width, GAP + LINE_PIXELS + row * tile_height
        pen.text((left, top), caption, fill=INK_RGB, font=font)
        image.paste(picture, (left, top + LINE_PIXELS))
    return image


if __name__ == "__main__":
    main()
