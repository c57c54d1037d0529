"""Train two agents in about four minutes, compare them with random policies and the expert, and film their episodes.

    python examples/demo.py [DIRECTORY]

DIRECTORY (default: runs/demo) keeps everything; if interrupted, the same command continues.
"""

from __future__ import annotations

import sys
from pathlib import Path

from lilgym_mp.cli import main
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.episode_files import read_episodes
from lilgym_mp.evaluation.film import episode_frames, film_frames

EXPERIMENT = Path(__file__).parents[1] / "experiments" / "demo.toml"
FILMED = 6  # episodes of each agent, in two columns


def demo(directory: Path, experiment: Path = EXPERIMENT) -> None:
    command("experiment", experiment, "--jobs", 2, "--out", directory)
    parser, network = (directory / "runs" / run for run in ("parse-and-plan-0", "imitation-TowerScratch-0"))
    place = directory / "comparison"
    others = ["--policy", "random-type", "random-legal", "expert", "--configuration", "TowerScratch"]
    command("evaluate", parser, network, *others, "--record", place, "--out", directory / "results.json", "--force")
    env = Settings("TowerScratch").make("dev")
    for file in sorted(place.glob("*.gz")):
        recording = read_episodes(file)
        if recording.header.run:
            filmed = recording.episodes[:: max(1, len(recording.episodes) // FILMED)][:FILMED]
            film = directory / f"{recording.header.agent}.gif"
            film_frames(film, [list(episode_frames(env, episode)) for episode in filmed], columns=2)
            print(f"film: {film}")
    print(f"Next: lilgym-mp evaluate {parser} --configuration ScatterFlipIt --split test")
    print(f"      lilgym-mp explain 'There is a blue block.' --agent {parser}")


def command(*words: object) -> None:
    """The command `lilgym-mp` with these words."""
    if code := main([*map(str, words)]):
        sys.exit(code)


if __name__ == "__main__":
    demo(Path(*sys.argv[1:2] or ["runs/demo"]))
