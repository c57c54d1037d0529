"""Runs a stress test: python -m tests.stress NAME [--count N] [--seed S]. Exits with 1 if anything is wrong."""

import argparse
import json
from pkgutil import resolve_name

# By name: the function, which takes a count and a seed and returns counts of results and faults.
TESTS = {
    "corrupt_files": "corrupt_files:corrupt_corpora",
    "hostile_records": "hostile_records:hostile_reports",
    "hostile_pages": "hostile_records:hostile_pages",
    "hostile_replies": "hostile_replies:examined",
    "mask_exactness": "mask_exactness:compare",
    "program_language": "program_language:measure",
    "program_truth": "program_truth:compare",
    "web_requests": "web_requests:send",
    "wrapper_stacks": "wrapper_stacks:compare",
}


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument("name", choices=TESTS)
    parser.add_argument("--count", type=int, default=1_000, metavar="N", help="of cases (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, metavar="S")
    args = parser.parse_args()
    results, faults = resolve_name(f"tests.stress.{TESTS[args.name]}")(args.count, args.seed)
    print(*faults[:40], json.dumps(dict(results), indent=1), f"faults: {len(faults)}", sep="\n")
    return int(bool(faults))


if __name__ == "__main__":
    raise SystemExit(main())
