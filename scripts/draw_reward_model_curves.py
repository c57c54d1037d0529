"""Writes the accuracy of V on held-out statements, by CPU minutes, STOPs and steps, into docs/results.

    python scripts/draw_reward_model_curves.py results/runs/reward-model-*FlipIt-*

The runs take the place of the file's earlier ones of their appearances.

`python scripts/draw_pictures.py charts` then draws docs/pictures/reward_model_curves.svg.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from pathlib import Path

import numpy as np
from write_result_tables import read, write

from lilgym_mp.learning.common.run_directory import PROGRESS_FILE, RUN_FILE

AXES = {"CPU minutes": ("cpu_seconds", 60), "STOPs": ("stops", 1), "steps": ("steps", 1)}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("runs", nargs="+", type=Path)
    args = parser.parse_args()
    curves: dict[str, list[list[dict[str, float]]]] = defaultdict(list)
    for run in args.runs:
        identity = json.loads((run / RUN_FILE).read_text(encoding="utf-8"))["identity"]
        lines = (run / PROGRESS_FILE).read_text(encoding="utf-8").splitlines()
        name = identity["environment"]["configuration"].removesuffix("FlipIt")
        curves[name].append([*map(json.loads, lines)])
    head, *known = read("reward_model_curves")
    rows = [row for row in known if row[1] not in curves]
    for axis, (key, unit) in AXES.items():
        for name, runs in curves.items():
            xs = [record[key] / unit for record in min(runs, key=lambda run: run[-1][key])]
            ys = [
                np.interp(xs, [record[key] / unit for record in run], [record["held_out_accuracy"] for record in run])
                for run in runs
            ]
            deviations = np.std(ys, axis=0, ddof=min(1, len(runs) - 1))
            for x, *values in zip(xs, 100 * np.mean(ys, axis=0), 100 * deviations, strict=True):
                rows.append([axis, name, f"{x:.2f}" if unit > 1 else f"{x:.0f}", *(f"{value:.2f}" for value in values)])
    write("reward_model_curves", [head, *sorted(rows, key=lambda row: (row[0], row[1] != "Tower", float(row[2])))])


if __name__ == "__main__":
    main()
