"""MkDocs hooks (mkdocs.yml): adds pages from outside docs/ and rewrites links that leave it."""

from __future__ import annotations

import argparse
import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parent.parent
OUTSIDE = {"changelog.md": "CHANGELOG.md", "contributing.md": "CONTRIBUTING.md"}  # page: file at the root
SHIM_URL, SHIM = "https://unpkg.com/iframe-worker/shim", "assets/iframe-worker.js"  # lets search work in local files
_INTERVAL = re.compile(r"\[([-+−]?\d+\.\d+), ([-+−]?\d+\.\d+)\](?!\()")  # must not break within brackets
_LINK = re.compile(r"(!?\[[^\]]*\])\(([^)#\s]+)(#[^)\s]*)?\)")


def on_config(config: Any) -> Any:
    """Appends the pages that the navigation does not list."""
    named = set(_pages(config.nav))
    found = sorted(path.relative_to(config.docs_dir).as_posix() for path in Path(config.docs_dir).rglob("*.md"))
    *_, last = config.nav[-1].values()
    last.extend(page for page in found if page not in named)
    return config


def _pages(nav: Any) -> Iterator[str]:
    if isinstance(nav, str):
        yield nav
    else:
        for part in nav.values() if isinstance(nav, dict) else nav:
            yield from _pages(part)


def options_page() -> str:
    """Every option of every command, from the help of its parser."""
    from lilgym_mp.cli import make_parser

    return "\n".join(["# Options of all commands", *_option_tables(make_parser())]) + "\n"


def _option_tables(parser: argparse.ArgumentParser) -> Iterator[str]:
    rows: list[str] = []
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _option_tables(command)
        elif names := [name for name in action.option_strings if name.startswith("--")]:
            text = (action.help or "").replace("%(default)s", str(action.default)).replace("%%", "%")
            text = text.replace("|", "\\|").replace("<", "&lt;")
            rows.append(f"| {', '.join(f'`{name}`' for name in names)} | {text} |")
    if rows:
        yield from (f"\n## {parser.prog}\n", "| option | meaning |", "|---|---|", *rows)


def on_files(files: Files, config: Any) -> Files:
    """Adds the pages from the repository root, and that of the options."""
    files.append(File.generated(config, "options.md", content=options_page()))
    for page, source in OUTSIDE.items():
        files.append(File.generated(config, page, abs_src_path=str(ROOT / source)))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Replaces links to repository files that are not on the site with the file names."""
    if page.file.src_uri.startswith("environments/"):
        page.meta["search"] = {"boost": 3}  # so that a search for a configuration finds its page first
    place = "" if page.file.src_uri in OUTSIDE else "docs/" + posixpath.dirname(page.file.src_uri)

    def relinked(match: re.Match[str]) -> str:
        label, target, anchor = match[1], match[2], match[3] or ""
        if "://" in target:
            return match[0]
        path = posixpath.normpath(posixpath.join(place, target))
        if path.startswith("docs/"):
            inside = posixpath.relpath(path, "docs/" + posixpath.dirname(page.file.src_uri))
            return f"{label}({inside}{anchor})"
        site_page = {source: site for site, source in OUTSIDE.items()}.get(path)
        if site_page:
            return f"{label}({posixpath.relpath(site_page, posixpath.dirname(page.file.src_uri) or '.')}{anchor})"
        return f"{label[1:-1]} (`{path}`)"

    return _LINK.sub(relinked, _INTERVAL.sub("[\\1,\u00a0\\2]", markdown))


def on_post_page(output: str, page: Any, config: Any) -> str:
    """Loads the search worker from the site instead of the network, and names the search dialog."""
    dialog = 'data-md-component="search" role="dialog"'
    output = output.replace(dialog, f'{dialog} aria-label="Search"')
    return output.replace(SHIM_URL, posixpath.relpath(SHIM, posixpath.dirname(page.file.dest_uri) or "."))


def on_post_template(output: str, template_name: str, config: Any) -> str:
    """Does the same for the 404 page."""
    return output.replace(SHIM_URL, f"/{SHIM}")
