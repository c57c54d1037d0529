"""The options of all commands: each has one name, and is on a page of the documentation."""

import argparse

import pytest

from lilgym_mp.cli import make_parser
from lilgym_mp.learning.common.learners import LEARNERS, find_learner
from tests.scripts import ROOT, load_script

DOCS = ROOT / "docs"
FORMER = ("warmup", "unknown", "sampled", "no-sampled", "limit", "count", "splits", "output")


def options(parser):
    """The long options of a parser and of its subcommands."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from options(command)
        else:
            yield from (option for option in action.option_strings if option.startswith("--"))


def test_options__each_is_on_the_page_of_options():
    page = load_script("site_hooks").options_page()
    assert [option for option in set(options(make_parser())) if f"`{option}" not in page] == []


def test_options__a_thing_has_no_second_name():
    assert not {f"--{name}" for name in FORMER} & set(options(make_parser()))


@pytest.mark.parametrize("learner", sorted(LEARNERS))
def test_recipes__keep_the_names_of_saved_runs_where_options_are_renamed(learner):
    found = find_learner(learner)
    made = found.recipe.of("" if found.config is None else "TowerFlipIt")
    assert found.recipe.from_json(made.to_json()) == made


def test_documents__are_at_most_39_100_words_and_the_readme_900():
    words = sum(len(path.read_text().split()) for path in DOCS.rglob("*.md"))
    assert words <= 39_100
    assert len((DOCS.parent / "README.md").read_text().split()) <= 900
