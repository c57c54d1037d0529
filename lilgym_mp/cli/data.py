"""`lilgym-mp data ...`: get the official corpus, look into any corpus, make start scenes."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterable, Mapping
from contextlib import suppress
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lilgym_mp.appearances import APPEARANCES
from lilgym_mp.cli.errors import CommandError
from lilgym_mp.corpus.records import FLIPIT, SPLITS, STARTS
from lilgym_mp.terminal import DownloadBar, table

if TYPE_CHECKING:
    from lilgym_mp.corpus import TaskSet
    from lilgym_mp.corpus.official.installing import Installation

FAULTS_FOUND = 1  # exit code of `check`
SET_CHOICES = {"appearance": list(APPEARANCES), "start": list(STARTS), "split": list(SPLITS)}


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser("data", help="get, check, count, show and extend corpora")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    for add in (
        _add_download,
        _add_import,
        _add_list,
        _add_stats,
        _add_check,
        _add_show,
        _add_synthesize,
        _add_permute,
    ):
        add(actions)


def _add_download(actions: Any) -> None:
    parser = actions.add_parser("download", help="download the official corpus into the user's cache")
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--revision", help="commit, branch or tag of the repository (default: its newest commit)")
    source.add_argument("--url", help="a directory on a web server that has the released files, instead of GitHub")
    _add_splits(parser)
    parser.add_argument("--force", action="store_true", help="download although it is installed")
    parser.set_defaults(run=_download)


def _add_import(actions: Any) -> None:
    parser = actions.add_parser("import", help="install the official corpus from a directory or a checkout")
    parser.add_argument("path", type=Path, help="directory with the released files, at any depth")
    _add_splits(parser)
    parser.set_defaults(run=_import)


def _add_list(actions: Any) -> None:
    parser = actions.add_parser("list", help="list corpora and how much they hold")
    parser.add_argument("corpus", nargs="*", help="default: builtin and lilgym")
    parser.set_defaults(run=_list)


def _add_stats(actions: Any) -> None:
    parser = actions.add_parser("stats", help="count tasks, words, forms, phenomena, program words")
    _add_corpus(parser)
    parser.add_argument("--charts", type=Path, metavar="DIRECTORY", help="write charts there, as SVG")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the counts there")
    parser.set_defaults(run=_stats)


def _add_check(actions: Any) -> None:
    parser = actions.add_parser("check", help=f"check every entry; exit code {FAULTS_FOUND} when there are faults")
    _add_corpus(parser)
    parser.set_defaults(run=_check)


def _add_show(actions: Any) -> None:
    parser = actions.add_parser("show", help="show a task: picture, statement, program, truth")
    parser.add_argument("id", help="id of the task")
    parser.add_argument("--corpus", default="builtin", help="as for gym.make (default: %(default)s)")
    for name, choices in SET_CHOICES.items():
        parser.add_argument(f"--{name}", choices=choices, help="needed where several tasks have the id")
    parser.add_argument("--image", type=Path, metavar="FILE", help="write the picture there, as PNG")
    parser.add_argument("--plain", action="store_true", help="letters instead of colours")
    parser.set_defaults(run=_show)


def _add_synthesize(actions: Any) -> None:
    parser = actions.add_parser("synthesize", help="make FlipIt start scenes for every statement of a corpus")
    _add_corpus(parser)
    _add_output(parser)
    _add_appearances_and_splits(parser)
    parser.add_argument("--starts", type=int, default=4, help="start scenes a statement (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="default: %(default)s")
    parser.set_defaults(run=_synthesize)


def _add_permute(actions: Any) -> None:
    parser = actions.add_parser("permute", help="extend FlipIt start scenes by every order of their boxes")
    _add_corpus(parser)
    _add_output(parser)
    _add_appearances_and_splits(parser)
    parser.set_defaults(run=_permute)


def _add_corpus(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("corpus", nargs="?", default="builtin", help="as for gym.make (default: %(default)s)")


def _add_output(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--output", type=Path, required=True, metavar="FILE", help="corpus file to write (.jsonl[.gz])")
    parser.add_argument("--force", action="store_true", help="replace the file")


class _Distinct(argparse.Action):
    """Keeps each value once, in the order given."""

    def __call__(
        self, parser: Any, namespace: argparse.Namespace, values: Any, option_string: str | None = None
    ) -> None:
        setattr(namespace, self.dest, list(dict.fromkeys(values)))


def _add_several(parser: argparse.ArgumentParser, flag: str, choices: list[str]) -> None:
    parser.add_argument(flag, nargs="+", action=_Distinct, choices=choices, default=choices, help="default: all")


def _add_splits(parser: argparse.ArgumentParser) -> None:
    _add_several(parser, "--splits", SET_CHOICES["split"])


def _add_appearances_and_splits(parser: argparse.ArgumentParser) -> None:
    _add_several(parser, "--appearances", SET_CHOICES["appearance"])
    _add_splits(parser)


def _download(args: argparse.Namespace) -> int:
    from lilgym_mp.corpus.faults import InterruptionError
    from lilgym_mp.corpus.official.download import NEWEST, GitHub, WebDirectory, download_official
    from lilgym_mp.corpus.official.installing import intact_installation
    from lilgym_mp.corpus.official.release import official_names
    from lilgym_mp.corpus.places import installed_directory

    target, names = installed_directory(), official_names(args.splits)
    source = WebDirectory(args.url) if args.url else GitHub(args.revision or NEWEST)
    wanted = str(source) if args.url or args.revision else None
    if not args.force and (there := intact_installation(target, names, wanted)) is not None:
        print(f"installed already, from {there.source}: {target} (--force downloads it again)")
        return 0
    try:
        with DownloadBar() as bar:
            installation = download_official(source, names, target, bar.show)
    except InterruptionError as error:
        raise CommandError(
            f"{error}. Nothing was installed; what came is kept, and the same command goes on from there. Without a "
            "network, get the files some other way and run `lilgym-mp data import DIRECTORY`"
        ) from None
    _tell_installation(installation)
    return 0


def _import(args: argparse.Namespace) -> int:
    from lilgym_mp.corpus.official.installing import import_official
    from lilgym_mp.corpus.official.release import official_names
    from lilgym_mp.corpus.places import installed_directory

    _tell_installation(import_official(args.path, official_names(args.splits), installed_directory()))
    return 0


def _tell_installation(installation: Installation) -> None:
    from lilgym_mp.corpus.places import DATA_VARIABLE

    rows = [(file.name, file.bytes, file.tasks, file.contexts, file.proof) for file in installation.files]
    print(table(["file", "bytes", "tasks", "contexts", "known by"], rows))
    for remark in installation.remarks:
        print(f"note: {remark}")
    revision = f", commit {installation.revision}" if installation.revision else ""
    print(f"installed in {installation.directory} from {installation.source}{revision}")
    if named := os.environ.get(DATA_VARIABLE):
        print(f'note: {DATA_VARIABLE} is set: corpus "lilgym" is read from {named}, not from there')


def _list(args: argparse.Namespace) -> int:
    from lilgym_mp.cli.data_report import listing
    from lilgym_mp.corpus import CorpusError
    from lilgym_mp.corpus.loading import load_all_tasks

    found = []
    for corpus in args.corpus or ["builtin", "lilgym"]:
        try:
            found.append((corpus, "", list(load_all_tasks(corpus))))
        except CorpusError as error:
            if args.corpus:
                raise
            found.append((corpus, "not here", []))
            print(error, file=sys.stderr)
    print(listing(found))
    return 0


def _stats(args: argparse.Namespace) -> int:
    from lilgym_mp.analysis.charts import write_charts
    from lilgym_mp.analysis.statistics import corpus_statistics
    from lilgym_mp.cli.data_report import statistics_json, statistics_text

    statistics = corpus_statistics(args.corpus)
    print(statistics_text(statistics))
    try:
        written = write_charts(statistics, args.charts) if args.charts else []
        if args.json:
            args.json.write_text(json.dumps(statistics_json(statistics), indent=1) + "\n", encoding="utf-8")
            written.append(args.json)
    except ImportError as missing:
        raise CommandError(str(missing)) from None
    except OSError as error:
        raise _cannot_write(error) from None
    for path in written:
        print(f"wrote {path}")
    return 0


def _check(args: argparse.Namespace) -> int:
    from lilgym_mp.corpus import check_corpus

    report = check_corpus(args.corpus)
    print(report)
    return 0 if report.ok else FAULTS_FOUND


def _show(args: argparse.Namespace) -> int:
    from PIL import Image

    from lilgym_mp.cli.data_report import task_lines, task_text
    from lilgym_mp.evaluation.files import write_whole
    from lilgym_mp.render.frames import frame

    tasks = _task_set_with(args)
    task = tasks.by_id(args.id)
    print(task_text(task, tasks, coloured=not args.plain and sys.stdout.isatty()))
    if args.image:
        try:
            picture = Image.fromarray(frame(task.start, task_lines(task, tasks)[1:4]))
            write_whole(args.image, lambda unfinished: picture.save(unfinished, format="PNG"))
        except OSError as error:
            raise _cannot_write(error) from None
        print(f"wrote {args.image}")
    return 0


def _task_set_with(args: argparse.Namespace) -> TaskSet:
    """The one task set that has the task asked for."""
    from lilgym_mp.corpus.loading import load_all_tasks

    asked = {name: [value] if (value := getattr(args, name)) else all_ for name, all_ in SET_CHOICES.items()}
    sets = list(load_all_tasks(args.corpus, asked["appearance"], asked["start"], asked["split"]))
    having = [tasks for tasks in sets if args.id in tasks.ids]
    if len(having) > 1:
        origins = "; ".join(str(tasks.provenance) for tasks in having)
        raise CommandError(f"several tasks are called {args.id!r}: {origins}. Add --appearance, --start or --split")
    if not having:
        ids = [task_id for tasks in sets for task_id in tasks.ids]
        examples = ", ".join(get_close_matches(args.id, ids) or ids[:3])
        raise CommandError(f"no task {args.id!r} in corpus {args.corpus!r}; there are for example {examples}")
    return having[0]


def _synthesize(args: argparse.Namespace) -> int:
    from lilgym_mp.corpus.synthesis import Settings, synthesize

    if args.starts < 1:
        raise CommandError(f"--starts must be at least 1, not {args.starts}")
    settings = Settings(args.appearances, args.splits, args.starts, args.seed)
    entries = list(synthesize(args.corpus, settings))
    _write(args, f"{args.corpus}, synthesized starts, seed {args.seed}", [entry.to_json() for entry in entries])
    starts = [start for entry in entries for start in entry.starts]
    true = sum(start.label for start in starts)
    print(f"{len(entries)} statements, {len(starts)} start scenes, {true} true and {len(starts) - true} false")
    for entry in entries:
        values = {start.label for start in entry.starts}
        if len(values) < 2 <= args.starts:
            met = f"only {values.pop()}".lower() if values else "no truth value"
            print(f"note: {met} was met for {entry.id!r}: {entry.statement}")
    return 0


def _permute(args: argparse.Namespace) -> int:
    from lilgym_mp.corpus.exporting import flipit_entries
    from lilgym_mp.corpus.loading import load_all_tasks
    from lilgym_mp.corpus.permutation import with_permuted_boxes

    entries: list[Mapping[str, object]] = []
    before = after = 0
    for tasks in load_all_tasks(args.corpus, args.appearances, [FLIPIT], args.splits):
        permuted = with_permuted_boxes(tasks, distinct=True)
        before, after = before + len(tasks), after + len(permuted)
        entries += flipit_entries(permuted)
    _write(args, f"{args.corpus}, boxes in every order", entries)
    print(f"{len(entries)} statements, {before} start scenes made {after}")
    return 0


def _write(args: argparse.Namespace, name: str, entries: Iterable[Mapping[str, object]]) -> None:
    """Writes a corpus file, whole or not at all."""
    from lilgym_mp.corpus import write_corpus

    path: Path = args.output
    if path.exists() and not args.force:
        raise CommandError(f"{path} exists; --force replaces it")
    partial = path.with_name(f".partial-{path.name}")
    try:
        write_corpus(partial, name, f"as {args.corpus}", entries)
        partial.replace(path)
    except OSError as error:
        raise _cannot_write(error) from None
    finally:
        with suppress(OSError):
            partial.unlink()
    print(f"wrote {path}")


def _cannot_write(error: OSError) -> CommandError:
    return CommandError(f"{error.filename or 'the output'}: cannot be written: {error.strerror or error}")
