"""Install, check, summarise and extend corpora."""

from __future__ import annotations

import os
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from itertools import product
from pathlib import Path

from lilgym_mp.cli import data_sets
from lilgym_mp.cli.data_report import statistics_text
from lilgym_mp.cli.options import CORPUS_HELP, CommandError, add_number, add_out, add_seed, check_at_least
from lilgym_mp.corpus import check_corpus, load_all_tasks
from lilgym_mp.corpus.generator.pairs import TEMPLATES, templates_of
from lilgym_mp.corpus.locations import DATA_VARIABLE, installed_directory, is_path, is_split
from lilgym_mp.corpus.matching import with_permuted_boxes
from lilgym_mp.corpus.official import OfficialFile, download_official, import_official, official_names
from lilgym_mp.corpus.records import FLIPIT, SCRATCH, SPLITS
from lilgym_mp.corpus.scene_sampling import sampler_of
from lilgym_mp.corpus.splits import RULES, split_lists
from lilgym_mp.corpus.synthesis import synthesize
from lilgym_mp.corpus.writing import entry_json, flipit_entries, header_json, task_rows, write_lines
from lilgym_mp.evaluation.files import fresh_file, write_atomically
from lilgym_mp.evaluation.terminal import Progress, table
from lilgym_mp.programs import ProgramRuntimeError, compile_program
from lilgym_mp.scene import Scene
from lilgym_mp.scene.appearances import APPEARANCES
from lilgym_mp.scene.arrays import AnyMapping
from lilgym_mp.scene.choices import listed

INVALID_CORPUS = 1  # exit code of `check`


def add_options(parser: ArgumentParser) -> None:
    """Adds the actions of `lilgym-mp data`, each with its own options."""
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)

    def add(name: str, run: Callable[[Namespace], int], summary: str) -> ArgumentParser:
        action = actions.add_parser(name, help=summary, description=f"{summary[0].upper()}{summary[1:]}.")
        action.set_defaults(run=run)
        return action

    download = add("download", _download, "download the official corpus into the user's cache")
    download.add_argument("--url", help="URL of a directory with the released files, instead of GitHub")
    _add_several(download, "split", SPLITS)

    local = add("import", _import, "install the official corpus from a directory or a checkout")
    local.add_argument("path", type=Path, metavar="DIRECTORY", help="directory with released files, at any depth")

    _add_corpus_argument(add("stats", _stats, "count tasks, statements, words and forms of statements"))

    checking = f"check every entry; the exit code is {INVALID_CORPUS} if any is invalid"
    _add_corpus_argument(add("check", _check, checking))

    _add_making(add)
    data_sets.add_actions(add)


def _add_making(add: Callable[..., ArgumentParser]) -> None:
    generate = add("generate", _generate, "write statements with programs and start scenes made by the generator")
    generate.add_argument("number", type=int, metavar="N", help="statements of each appearance and split")
    add_number(generate, "--level", 3, "difficulty, 1 to 5")
    add_seed(generate, "of the statements")

    synthesize = add("synthesize", _synthesize, "make FlipIt start scenes for every statement of a corpus")
    _add_corpus_argument(synthesize)
    add_number(synthesize, "--starts", 4, "start scenes per statement")
    add_seed(synthesize, "of the scenes")

    permute = add("permute", _permute, "augment FlipIt start scenes with all permutations of their boxes")
    _add_corpus_argument(permute)

    export = add("export", _export, "write every task as a JSON line, for `datasets.load_dataset` and other readers")
    _add_corpus_argument(export)

    split = add("split", _split, "write the lists of a compositional split, which can be named as a corpus")
    _add_corpus_argument(split)
    split.add_argument(
        "--by",
        required=True,
        choices=list(RULES),
        help="hold out of dev and test what train has not: forms of programs, longer statements, or pairs of words",
    )

    files = {split: "lists to write (.split.json[.gz])", export: "file to write (.jsonl[.gz])"}
    for parser in (generate, synthesize, permute, export, split):
        written = files.get(parser, "corpus file to write (.jsonl[.gz])")
        add_out(parser, written, required=True)
        _add_several(parser, "appearances", APPEARANCES)
        if parser is not split:
            _add_several(parser, "split", SPLITS)
    generate.set_defaults(appearances=list(TEMPLATES))


def _add_corpus_argument(parser: ArgumentParser) -> None:
    parser.add_argument("corpus", nargs="?", default="builtin", metavar="CORPUS", help=CORPUS_HELP)


def _add_several(parser: ArgumentParser, name: str, choices: Collection[str]) -> None:
    help_text = f"{name.removesuffix('s')}s to include (default: all)"
    parser.add_argument(f"--{name}", nargs="+", choices=choices, default=list(choices), help=help_text)


def _download(args: Namespace) -> int:
    target = installed_directory()
    names = [name for name in official_names(args.split) if not (target / name).exists()]
    if not names:
        print(f"already installed: {target}")
        return 0
    with Progress(len(names), "files") as progress:
        files = download_official(names, target, args.url, lambda name: progress.advance(note=name))
    _print_installed(files, target)
    return 0


def _import(args: Namespace) -> int:
    files = import_official(args.path, installed_directory())
    _print_installed(files, installed_directory())
    if missing := set(official_names()) - {file.name for file in files}:
        print(f"note: {args.path} lacks {listed(missing)}")
    return 0


def _print_installed(files: Sequence[OfficialFile], target: Path) -> None:
    print(table(["file", "bytes", "tasks", "contexts", "verified by"], files))
    print(f"installed in {target}")
    if named := os.environ.get(DATA_VARIABLE):
        print(f'note: {DATA_VARIABLE} is set, so the corpus "lilgym" is read from {named} instead')


def _stats(args: Namespace) -> int:
    print(statistics_text(args.corpus, list(load_all_tasks(args.corpus))))
    return 0


def _check(args: Namespace) -> int:
    report = check_corpus(args.corpus)
    print(report)
    return 0 if report.ok else INVALID_CORPUS


def _generate(args: Namespace) -> int:
    from lilgym_mp.corpus.generator import CorpusSpec, generated_entries

    check_at_least(args, 1, "number")
    check_at_least(args, 0, "seed")
    for appearance in args.appearances:  # before any statement is made
        templates_of(appearance)
        sampler_of(appearance)
    args.corpus = f"generated:{args.level}:{args.seed}"
    spec = CorpusSpec.parse(args.corpus)
    rows = list[Mapping[str, object]]()
    with Progress(len(args.appearances) * len(args.split), "splits") as progress:
        for appearance, split in product(args.appearances, args.split):
            for index, entry in enumerate(generated_entries(spec, appearance, split, args.number), 1):
                name = f"{appearance}-{split}-{args.level}-{index}"
                starts = [(f"{name}-{n}", start) for n, start in enumerate(entry.starts, 1)]
                rows.append(entry_json(name, appearance, split, entry.statement, entry.program, starts))
            progress.advance(note=f"{appearance} {split}")
    _write_corpus(args, args.corpus, rows)
    print(f"{len(rows)} statements")
    return 0


def _synthesize(args: Namespace) -> int:
    check_at_least(args, 1, "starts")
    found = list(synthesize(args.corpus, args.appearances, args.split, starts=args.starts, seed=args.seed))
    entries = [entry for entry in found if args.starts < 2 or not _is_always_true(entry)]
    _write_corpus(args, f"{args.corpus}, synthesized starts, seed {args.seed}", entries)
    labels = [start["label"] for entry in entries for start in entry["starts"]]
    true = sum(labels)
    print(f"{len(entries)} statements, {len(labels)} start scenes, {true} true and {len(labels) - true} false")
    for entry in found:
        if entry not in entries:
            print(f"left out, as no scene was found that makes it false: {entry['id']!r}: {entry['statement']}")
    for entry in entries:
        values = {start["label"] for start in entry["starts"]}
        if len(values) < 2 <= args.starts:
            those = f"only {values.pop()}".lower() if values else "no"
            print(f"note: {those} start scenes found for {entry['id']!r}: {entry['statement']}")
    return 0


def _is_always_true(entry: AnyMapping) -> bool:
    """Whether the entry's program is true in all its start scenes and in the empty scene."""
    try:
        empty = compile_program(entry["program"]).evaluate(Scene.empty())
    except ProgramRuntimeError:
        return False
    return empty and {start["label"] for start in entry["starts"]} == {True}


def _permute(args: Namespace) -> int:
    entries: list[Mapping[str, object]] = []
    before = after = 0
    for tasks in load_all_tasks(args.corpus, args.appearances, [FLIPIT], args.split):
        permuted = with_permuted_boxes(tasks, distinct=True)
        before += len(tasks)
        after += len(permuted)
        entries += flipit_entries(permuted)
    _write_corpus(args, f"{args.corpus}, boxes in every order", entries)
    print(f"{len(entries)} statements, {before} start scenes permuted into {after}")
    return 0


def _export(args: Namespace) -> int:
    rows = list(task_rows(load_all_tasks(args.corpus, args.appearances, splits=args.split, needs_tasks=False)))
    _write(args, rows)
    print(f"{len(rows):,} tasks")
    return 0


def _split(args: Namespace) -> int:
    if not is_split(args.out):
        raise CommandError(f"--out must name a file that ends in .split.json or .split.json.gz, not {str(args.out)!r}")
    lists = split_lists(args.by, list(load_all_tasks(args.corpus, args.appearances, [SCRATCH])))
    print(table(["task set", "statements"], [(name, len(ids)) for name, ids in lists.items()]))
    corpus = os.path.relpath(args.corpus, args.out.parent) if is_path(args.corpus) else args.corpus
    _write(args, [{"corpus": corpus, "by": args.by, "statements": lists}])
    return 0


def _write_corpus(args: Namespace, name: str, entries: Iterable[Mapping[str, object]]) -> None:
    _write(args, (header_json(name, f"as {args.corpus}"), *entries))


def _write(args: Namespace, rows: Iterable[Mapping[str, object]]) -> None:
    write_atomically(fresh_file(args.out, force=args.force), lambda unfinished: write_lines(unfinished, rows))
    print(f"wrote {args.out}")
