"""Draws the accuracy of V on held-out statements against CPU minutes, STOPs and steps of the environment.

python scripts/draw_reward_model_curves.py runs/Tower-* runs/Scatter-0 --out docs/pictures/reward_model_curves.svg
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from pathlib import Path

import numpy as np

from lilgym_mp.contrib.report.charts import Line, Looks, line_chart
from lilgym_mp.learning.common.run_directory import PROGRESS_FILE, RUN_FILE

AXES = {"cpu_seconds": ("CPU minutes", 60), "stops": ("STOPs, thousands", 1e3), "steps": ("steps, millions", 1e6)}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    curves: dict[str, list[list[dict[str, float]]]] = defaultdict(list)
    for run in args.runs:
        identity = json.loads((run / RUN_FILE).read_text(encoding="utf-8"))["identity"]
        lines = (run / PROGRESS_FILE).read_text(encoding="utf-8").splitlines()
        name = identity["environment"]["configuration"].removesuffix("FlipIt")
        curves[name].append([*map(json.loads, lines)])

    def line(name: str, runs: list[list[dict[str, float]]], key: str, unit: float) -> Line:
        xs = [record[key] / unit for record in min(runs, key=lambda run: run[-1][key])]
        ys = [
            np.interp(xs, [record[key] / unit for record in run], [100 * record["held_out_accuracy"] for record in run])
            for run in runs
        ]
        deviations = np.std(ys, axis=0, ddof=1).tolist() if len(runs) > 1 else None
        return Line(
            f"{name}, {len(runs)} seeds" if len(runs) > 1 else name, xs, np.mean(ys, axis=0).tolist(), deviations
        )

    line_chart(
        [
            (f"against {label}", label, "V on held-out pairs, %", [line(*item, key, unit) for item in curves.items()])
            for key, (label, unit) in AXES.items()
        ],
        Looks(),
    ).savefig(args.out)


if __name__ == "__main__":
    main()
