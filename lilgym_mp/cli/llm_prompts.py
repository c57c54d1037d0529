"""Generate prompts for training language models.

Writes generated tasks as JSON lines, each with its prompt and all that scoring a reply needs.
"""

from __future__ import annotations

import argparse
from itertools import islice
from pathlib import Path
from typing import Any

from lilgym_mp.cli.options import add_flag, add_number, add_out, add_seed, check_at_least, check_out
from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.evaluation.files import json_line, write_atomically
from lilgym_mp.evaluation.terminal import Progress
from lilgym_mp.scene.appearances import APPEARANCES


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `lilgym-mp llm prompts`."""
    parser.add_argument("--kind", required=True, metavar="KIND", help="plan, truth, verify or program")
    parser.add_argument("--appearance", choices=list(APPEARANCES), default="tower", help="(default: %(default)s)")
    add_number(parser, "--level", 3, "difficulty of statements, 1 to 5")
    parser.add_argument("--split", choices=list(SPLITS), default="train", help="(default: %(default)s)")
    add_number(parser, "--min-actions", 2, "of the shortest plan")
    add_number(parser, "--max-actions", None, "of the shortest plan (default: the horizon)")
    add_number(parser, "--episodes", 1_000, "number of prompts")
    add_seed(parser, "of the tasks")
    parser.add_argument(
        "--scene",
        choices=["list", "image", "both"],
        default="list",
        help='how all but program prompts show the scene; unless a list, rows have "messages", pictures in base64'
        " (default: %(default)s)",
    )
    add_flag(parser, "--expert-answers", 'add the expert\'s reply as "answer"')
    add_out(parser, "JSON lines", required=True)


def run(args: argparse.Namespace) -> int:
    """Writes prompts with verifiable answers as JSON lines."""
    from lilgym_mp.contrib.rlvr import expert_reply, messages_of, rows

    check_at_least(args, 1, "episodes")
    lengths = {"min_actions": args.min_actions, "max_actions": args.max_actions}
    endless = rows(args.kind, args.appearance, args.level, seed=args.seed, split=args.split, **lengths)
    check_out(args)

    def write(path: Path) -> None:
        with path.open("w", encoding="utf-8") as file, Progress(args.episodes, "prompts") as progress:
            for row in islice(endless, args.episodes):
                added: dict[str, Any] = {"answer": expert_reply(row)} if args.expert_answers else {}
                if args.scene != "list":
                    added["messages"] = messages_of(row, args.scene)
                file.write(json_line({**row.to_json(), **added}))
                progress.advance()

    write_atomically(args.out, write)
    print(f"{args.episodes:,} prompts: {args.out}")
    return 0
