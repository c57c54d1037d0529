"""The parser and its agent: normalisation, decoding, training, planning and invalid input."""

import math
import random
import signal
import textwrap
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from lilgym_mp import load_agent
from lilgym_mp.corpus import write_corpus
from lilgym_mp.corpus.generator import training_pairs
from lilgym_mp.corpus.held_out import statement_digest
from lilgym_mp.evaluation import Observations, Settings
from lilgym_mp.learning.common.agents import AgentError, open_agent
from lilgym_mp.learning.common.planning import PlanPolicy
from lilgym_mp.learning.common.program_network import ParserNetwork, Sizes, Slots
from lilgym_mp.learning.common.program_pairs import (
    COLOURS,
    TOKENS,
    Pair,
    SymbolTable,
    normalise_statement,
    pair_of,
    program_of,
    slots_of,
    varied,
)
from lilgym_mp.learning.common.run_directory import AGENT_FILE
from lilgym_mp.learning.parsing import parser, training
from lilgym_mp.learning.parsing.doubts import doubts
from lilgym_mp.learning.parsing.learner import ParserRecipe
from lilgym_mp.learning.parsing.parser import (
    UNKNOWN,
    UNKNOWN_FACTOR,
    Candidate,
    Parse,
    Parser,
    ProgramCandidate,
    beam_search,
)
from lilgym_mp.learning.parsing.planning import ProgramPlanner, explanation_lines, fit_calibration
from lilgym_mp.learning.parsing.scoring import parse_scores
from lilgym_mp.learning.parsing.training import train_parser
from lilgym_mp.programs.canonical import canonical_form
from lilgym_mp.programs.prefix import prefix_tokens
from lilgym_mp.programs.printing import source_of
from lilgym_mp.programs.syntax import parse
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import Stop
from lilgym_mp.scene.render import draw
from lilgym_mp.solver import Solver
from tests.command_line import python
from tests.corpora import entry
from tests.learning.conftest import accuracy, equal

KNOWN = frozenset({*COLOURS, "there", "is", "a", "block", "on", "the", "2", "3", "blocks", "are", "circle", "circles"})
SMALL = ParserRecipe(updates=30, batch_size=16, width=32, generated=0.5, generated_pairs=100, held_out=5, warm_up=5)


@pytest.fixture(scope="module")
def trained(own, tmp_path_factory):
    """A run of very few training steps."""
    place = tmp_path_factory.mktemp("parser") / "run"
    train_parser(own, SMALL, place, device="cpu")
    return place


def test_normalise__standardises_colours_and_programs_restore_them():
    normalised = normalise_statement("There is a BLUE block on the blak block", "tower", KNOWN)
    assert normalised.words == ("<tower>", "there", "is", "a", "yellow", "block", "on", "the", "black", "block")
    source = (
        "exist(filter_obj(all_items, lambda x: is_blue(x) and exist(filter_obj(get_below(x), lambda y: is_black(y)))))"
    )
    pair = pair_of(normalised, source, most_tokens=40)
    assert "is_yellow(1)" in pair.tokens
    assert program_of(pair.tokens, normalised.exchange) == source


def test_pair__program_that_is_too_long_or_has_no_prefix_form_gives_none():
    normalised = normalise_statement("there is a block", "tower", KNOWN)
    assert pair_of(normalised, "exist(all_items)", most_tokens=1) is None
    assert pair_of(normalised, "exist(all_items[1:])", most_tokens=40) is None


def test_variations__exchange_shapes_and_numbers_in_words_and_program():
    pair = Pair(
        ("<scatter>", "2", "circles"),
        ("==", "count(1)", "filter_obj(2)", "all_items", "lambda", "is_circle(1)", "v0", "#2"),
    )
    rng = random.Random(0)
    seen = {varied(pair, 1.0, 1.0, rng) for _ in range(300)}
    assert len(seen) == 18  # three shapes, six numbers
    for words, tokens in seen:
        assert tokens[-1] == f"#{words[1]}"
        assert tokens[5] == f"is_{words[2].removesuffix('s')}(1)"


@pytest.mark.parametrize(
    "pair",
    [
        Pair(("<scatter>", "a", "circle"), ("exist(1)", "all_items")),  # the program does not name the circle
        Pair(("<tower>", "2", "blocks"), (">=", "count(1)", "all_items", "#3")),  # another number
        Pair(("<tower>", "1", "block"), ("==", "count(1)", "all_items", "#1")),  # "1" is often "some"
    ],
)
def test_variations__keep_pairs_whose_words_and_program_differ(pair):
    rng = random.Random(0)
    assert {varied(pair, 1.0, 1.0, rng) for _ in range(50)} == {pair}


def small_network(seed=0):
    torch.manual_seed(seed)
    return ParserNetwork(12, len(TOKENS), Sizes(width=16, hidden=32, layers=1, longest_program=10)).eval()


def test_beam__returns_complete_programs_sorted_by_probability():
    network = small_network()
    words = [3, 4, 5]
    found = beam_search(network, words, 8)
    assert 0 < len(found) <= 8
    scores = [candidate.log_probability for candidate in found]
    assert scores == sorted(scores, reverse=True)
    for tokens, score, _ in found:
        slots = list(slots_of(tokens))
        parents, parts = (torch.tensor([column]) for column in zip(*slots, strict=True))
        logits = network(torch.tensor([words]), torch.tensor([tokens]), Slots(parents, parts))
        chosen = logits.log_softmax(2)[0].gather(1, torch.tensor(tokens)[:, None]).sum().item()
        assert score == pytest.approx(chosen, abs=1e-4)


RIGHT, ODD = "exist(all_items)", "exist(filter_obj(all_items, lambda x: exist(x)))"
CONSTANT = "(all_items == all_items) == all_items"
PAIRS = "exist(filter_obj(combinations(filter_obj(all_boxes, lambda b: b), 2), lambda p: count(p[0]) == count(p[1])))"


@pytest.mark.parametrize(
    ("shares", "kept"),
    [
        ({RIGHT: 0.5, ODD: 0.45, CONSTANT: 0.05}, {RIGHT, ODD}),
        ({RIGHT: 0.9, ODD: 0.05, CONSTANT: 0.05}, {RIGHT}),
        ({RIGHT: 0.2, ODD: 0.2, CONSTANT: 0.6}, {RIGHT, ODD}),
        ({RIGHT: 0.96, PAIRS: 0.04}, {RIGHT, PAIRS}),  # well typed, but without generated code
    ],
)
def test_parser__drops_ill_typed_programs_that_are_improbable_or_constant(shares, kept, monkeypatch):
    forms = {source: canonical_form(parse(source)) for source in shares}
    found = [
        Candidate(tuple(map(TOKENS.index, prefix_tokens(forms[source]))), math.log(share))
        for source, share in shares.items()
    ]
    monkeypatch.setattr(parser, "beam_search", lambda *_: found)
    known = SymbolTable((*sorted(COLOURS), UNKNOWN))
    candidates = Parser(small_network(), known).parse("anything", "tower").candidates
    assert {one.program for one in candidates} == {source_of(forms[source]) for source in kept}


LEARNING = replace(SMALL, updates=150, generated=0.0, held_out=0, smoothing=0.0, dropout=0.0)


@pytest.mark.long
def test_training__solves_a_small_corpus(own, tmp_path):
    agent = train_parser(own, LEARNING, tmp_path, device="cpu")
    assert accuracy(agent, Settings("TowerScratch", corpus=own), "train") == 1.0


@pytest.mark.long
def test_training__does_not_solve_a_small_corpus_with_shuffled_programs(own, tmp_path, monkeypatch):
    examples = training.corpus_examples(own)
    programs = [example.program for example in examples]
    wrong = [
        example._replace(program=program)
        for example, program in zip(examples, programs[1:] + programs[:1], strict=True)
    ]
    monkeypatch.setattr(training, "corpus_examples", lambda corpus: wrong)
    agent = train_parser(own, LEARNING, tmp_path, device="cpu")
    assert accuracy(agent, Settings("TowerScratch", corpus=own), "train") < 0.7


@pytest.mark.long
def test_training__is_reproducible_by_seed(own, tmp_path):
    for name, seed in (("one", 3), ("two", 3), ("three", 4)):
        train_parser(own, replace(SMALL, updates=5, seed=seed), tmp_path / name, device="cpu")
    assert equal(tmp_path / "one", tmp_path / "two")
    assert not equal(tmp_path / "one", tmp_path / "three")


@pytest.mark.long
def test_calibration__is_of_the_probabilities_of_the_agent(own, tmp_path, monkeypatch):
    calibrated = []
    monkeypatch.setattr(training, "calibrated_temperature", lambda predictions: 0.25)
    monkeypatch.setattr(training, "forecasts", lambda parser, *rest: calibrated.append(parser) or [(0.5, True)] * 9)
    agent = train_parser(own, SMALL, tmp_path, device="cpu")
    for example in training.corpus_examples(own):
        found = (one.parse(example.statement, "tower").candidates for one in (calibrated[0], agent.parser))
        assert next(found) == next(found)


@pytest.mark.long
def test_resume__continues_from_the_last_checkpoint(own, tmp_path, monkeypatch):
    recipe = replace(SMALL, updates=16)
    steps = []

    def interrupt(progress):
        if progress.updates == 11:
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)  # at once, without a checkpoint

    monkeypatch.setattr("lilgym_mp.learning.common.run.REPORT_SECONDS", 0.0)
    monkeypatch.setattr("lilgym_mp.learning.common.run.SAVE_SECONDS", 0.0)
    with pytest.raises(KeyboardInterrupt):
        train_parser(own, recipe, tmp_path, on_progress=interrupt, device="cpu")
    assert not (tmp_path / AGENT_FILE).exists()
    train_parser(own, recipe, tmp_path, resume=True, on_progress=lambda p: steps.append(p.updates), device="cpu")
    assert (steps[0], steps[-1]) == (11, 16)
    assert open_agent(tmp_path, "cpu").description.kind == "parse-and-plan"


@pytest.mark.long
def test_training__drops_generated_statements_that_are_held_out(monkeypatch):
    first = next(training_pairs("scatter", random.Random("generated 0").getrandbits(32)))
    recipe = replace(SMALL, held_out=0)
    before = training.load_training_data("builtin", recipe)
    shipped = training.held_out_digests("builtin")
    monkeypatch.setattr(training, "held_out_digests", lambda corpus: shipped | {statement_digest(first.statement)})
    after = training.load_training_data("builtin", recipe)
    assert len(after.generated) < len(before.generated)
    assert after.held_out_sha256 != before.held_out_sha256, "part of the run's identity"


# The agent


@pytest.fixture(scope="module")
def shipped():
    return load_agent("parse-and-plan", "cpu")


class Oracle(Parser):
    """A parser with fixed candidates."""

    def __init__(self, *candidates):
        super().__init__(small_network(), SymbolTable((*COLOURS, UNKNOWN)))
        self.candidates = tuple(ProgramCandidate(program, probability) for program, probability in candidates)

    def parse(self, statement, appearance):
        return Parse(("<tower>", "yellow"), (), {}, self.candidates)


BLUE = "exist(filter_obj(all_items, lambda x: is_blue(x)))"
BLACK = "exist(filter_obj(all_items, lambda x: is_black(x)))"
EMPTY = "not exist(all_items)"


NOTHING = Scene.empty()


def planner(*candidates, configuration="TowerScratch"):
    settings = Settings(configuration)
    return ProgramPlanner(Oracle(*candidates), settings.dynamics(), settings.start == "flipit")


def planned(*candidates, steps=0, **configuration):
    """The plan from the empty scene after some steps."""
    return planner(*candidates, **configuration).plan(NOTHING, "any", True, steps)


def test_planner__plan_for_one_candidate_is_as_short_as_the_experts():
    chosen = planner((BLUE, 1.0))
    plan = chosen.plan(NOTHING, "any", True)
    expert = Solver(chosen.dynamics).solve(Task("t", "any", BLUE, True, NOTHING))
    assert len(plan.actions) == expert.steps
    assert plan.success_probability == pytest.approx(1.0, abs=0.01)


def test_planner__satisfies_several_candidates_at_once_if_possible():
    both = planned((BLUE, 0.6), (BLACK, 0.4))
    assert (len(both.actions), both.satisfied) == (3, (0, 1))


@pytest.mark.parametrize(("likely", "actions"), [(0.999, 2), (0.6, 3)])
def test_planner__a_short_plan_has_actions_for_other_candidates_only_if_they_are_likely(likely, actions):
    chosen = planner((BLUE, likely), (BLACK, 1 - likely))
    assert len(chosen.plan(NOTHING, "any", True).actions) == 3
    short = chosen.short_plan(NOTHING, "any", True)
    assert (len(short.actions), short.satisfied[0]) == (actions, 0)


def test_planner__prefers_the_more_probable_of_conflicting_candidates():
    plan = planned((BLUE, 0.6), (f"not {BLUE}", 0.4))
    assert plan.satisfied == (0,)
    assert plan.success_probability == pytest.approx(0.6 / (0.6 + 0.04))


def test_planner__drops_programs_satisfied_by_a_flipit_start():
    plan, later = (planned((EMPTY, 0.9), (BLUE, 0.1), steps=steps, configuration="TowerFlipIt") for steps in (0, 3))
    assert [goal.program for goal in plan.goals] == [BLUE]
    assert later.goals[0].program == EMPTY


def test_planner__stops_without_candidates_or_remaining_steps():
    assert planned().actions == (Stop(),)
    assert planned((BLUE, 1.0), steps=11).actions == (Stop(),)


def observed(image, statement, step=0):
    return Observations(image[None], (statement,), *(np.array([number]) for number in (1, step, 0)))


def test_policy__replans_after_an_unexpected_image():
    settings = Settings("TowerScratch")
    env = settings.make("dev")
    observation, _ = env.reset(seed=0)
    policy = PlanPolicy(planner((BLUE, 1.0)))

    def choice(image, step):
        return int(policy(observed(image, "any", step), np.zeros((1, 0), bool), np.random.default_rng(0))[0])

    add = choice(observation["image"], 0)
    assert add != 0
    assert choice(observation["image"], 1) == add  # as if nothing had happened
    after, *_ = env.step(add)
    assert choice(after["image"], 2) == 0
    noise = np.random.default_rng(0).integers(0, 255, (50, 190, 3), np.uint8)
    assert choice(noise, 0) == 0, "stops where it can read nothing"


@pytest.mark.parametrize(
    "statement", ["", "zzz qqq", "a " * 10_000, "x" * 10_000, "\0 \u2603", "there is a blue block"]
)
def test_agent__plans_for_any_statement(trained, statement):
    agent = open_agent(trained, "cpu")
    chosen = agent.planner(Settings("TowerScratch"))
    plan = chosen.plan(NOTHING, statement, True)
    assert plan.actions
    assert bool(plan.parse.unknown) is not statement.startswith(("a ", "there"))
    lines = "\n".join(explanation_lines(plan, chosen, statement, True))
    assert all(repr(word) in lines for word in plan.parse.unknown)


@pytest.mark.long
def test_shipped_agent__lists_unknown_and_corrected_words_and_believes_its_parse_less(shipped):
    planner = shipped.planner(Settings("TowerScratch"))
    plan = planner.plan(NOTHING, "There is a zorblax on a bloc.", True)
    assert (plan.parse.unknown, plan.parse.corrections) == (("zorblax",), {"bloc": "block"})
    assert sum(candidate.probability for candidate in plan.parse.candidates) == pytest.approx(UNKNOWN_FACTOR)
    assert sum(plan.probabilities().values()) <= UNKNOWN_FACTOR + 1e-9
    assert plan.success_probability <= (6 / 7) ** 2
    notes = ("read 'bloc' as 'block'", "unknown, 1 of 7 words: 'zorblax'")
    assert tuple(plan.parse.notes()) == notes
    policy, nothing = PlanPolicy(planner), np.zeros((1, 0), bool)
    seen = observed(draw(NOTHING, "half"), "There is a zorblax on a bloc.")
    chosen = policy(seen, nothing, np.random.default_rng(0))
    assert policy.output(nothing, chosen).notes == [notes]


NO_BLUE = "not exist(filter_obj(all_items, lambda x: is_blue(x)))"


@pytest.mark.parametrize(
    ("statement", "program"),
    {
        "There isn't a blue block.": NO_BLUE,
        "A blue block does not exist.": NO_BLUE,
        "There are \uff13 blue blocks.": "count(filter_obj(all_items, lambda x: is_blue(x))) == 3",
        "There are \u0663 blue blocks.": "count(filter_obj(all_items, lambda x: is_blue(x))) == 3",
        "There are exactly zero blue blocks.": NO_BLUE,
        "There are \u06f0 blue blocks.": NO_BLUE,
        "There is less than one blue block.": NO_BLUE,
        "There are no fewer than three blue blocks.": "count(filter_obj(all_items, lambda x: is_blue(x))) >= 3",
        "The left box is empty.": "not exist(all_boxes[0])",
    }.items(),
)
def test_shipped_agent__reads_ways_to_say_no_and_digits_of_any_script(shipped, statement, program):
    found = shipped.parser.parse(statement, "tower")
    assert (found.candidates[0].program, found.uncertain) == (program, ())


DOUBTS = {
    "scatter": {
        "An even number of circles touch the wall.": "does not express 'even'",
        "There is a big black circle and it is bigger than the black square.": "does not express 'bigger'",
        "All circles don't touch a black circle, and none is blue.": "does not express 'not' and 'none'",
        "There is a blue circle and there isn't a blue circle.": "is false in every scene",
        "There are 1,000 black circles.": "'1,000' cannot be read",
        "There are more than \u22121 black circles.": "'\u22121' cannot be read",
        "There are \u2462 black circles.": "'\u2462' cannot be read",
        "There are 1 000 black circles.": "'1 000' cannot be read",
        "There are no more than 0 circles.": "does not express 'no more than 0'",
        "There is never a blue circle.": "unknown, 1 of 6 words: 'never'",
        "Zorbl, every circle is blue": "words: 'zorbl'",
        "≥ 3 circles": "words: '≥'",
        "There is a blök.": "words: 'blök'",
        "The asdf qwerty.": "nothing was understood",
        "It is there.": "nothing was understood",
        "": "nothing was understood",
    },
    "tower": {
        "Fewer than two blocks are blue.": "does not express 'fewer than 2'",
        "The left box doesn't hold more than two blocks.": "does not express 'more than 2'",
        "The left box is not empty.": "does not express 'not' and 'empty'",
        "No box is empty.": "does not express 'no' and 'empty'",
        "Every box but the left has a blue block.": "does not express 'every box but'",
    },
}


@pytest.mark.parametrize(
    ("appearance", "statement", "doubt"),
    [(appearance, *row) for appearance, rows in DOUBTS.items() for row in rows.items()],
)
def test_shipped_agent__says_why_its_reading_is_uncertain(shipped, appearance, statement, doubt):
    found = shipped.parser.parse(statement, appearance)
    assert doubt in " | ".join(found.uncertain)
    assert all(isinstance(note, str) for note in found.notes())


@pytest.mark.parametrize("statement", ["There are exactly two towers.", "There is a tower with a blue block on top."])
def test_shipped_agent__is_sure_of_plain_statements(shipped, statement):
    assert shipped.parser.parse(statement, "tower").uncertain == ()


TWO_OR_LESS = "count(filter_obj(all_items, lambda x: is_blue(x))) <= 2"


@pytest.mark.parametrize(
    ("statement", "is_doubted"),
    {
        "at most 2": False,
        "fewer than 3": False,
        "no more than 2": False,
        "not more than 2": False,
        "fewer than 2": True,
        "no fewer than 3": True,
        "at least 2": True,
        "more than 1": True,
    }.items(),
)
def test_doubts__compare_the_limits_of_the_statement_and_the_program(statement, is_doubted):
    assert any(doubts(statement, statement.split(), [(TWO_OR_LESS, 1.0)], (True, False))) == is_doubted


def test_doubts__of_no_reading_and_a_close_rival():
    assert list(doubts("It is.", ["it", "is"], [], ())) == ["no program was found"]
    (rival,) = doubts("Blue.", ["blue"], [("is_blue", 0.6), ("is_black", 0.3)], (True, False))
    assert rival == "another reading is nearly as likely: is_black"


def test_shipped_agent__capitals_punctuation_and_interjections_change_no_parse(shipped):
    written = (
        "every tower has a yellow base",
        "Every tower has a yellow base!",
        "Look, every tower has a yellow base!",
    )
    parses = [shipped.parser.parse(statement, "tower") for statement in written]
    assert len({(parse.words, parse.candidates) for parse in parses}) == 1


@pytest.mark.long
def test_shipped_agent__parses_the_same_when_the_language_gains_a_word():
    new_word = """
        from lilgym_mp.programs.values import ItemView
        from lilgym_mp.programs.words import ItemArg, word

        @word("item tests", depends_on="attributes")
        def is_aardvark(x: ItemArg) -> bool:
            "Whether `x` is an aardvark."
            return False
    """
    parse = """
        from lilgym_mp import load_agent
        from lilgym_mp.learning.common.program_pairs import TOKENS
        print(load_agent("parse-and-plan", "cpu").parser.parse("There are two blue blocks.", "tower").candidates)
        print(len(TOKENS))
    """
    before, after = (
        python("-c", "\n".join(map(textwrap.dedent, parts))).stdout.splitlines()
        for parts in ([parse], [new_word, parse])
    )
    assert after[0] == before[0]
    assert int(after[1]) == int(before[1]) + 1


def test_parser__rejects_tokens_that_the_language_lacks(trained):
    agent = open_agent(trained, "cpu")
    details = agent.parser.to_details()
    with pytest.raises(ValueError, match=r"this version of the program language has no 'is_aardvark\(1\)'"):
        Parser.of({**details, "tokens": [*details["tokens"][:-1], "is_aardvark(1)"]})


def test_agent__plays_only_the_appearances_of_its_corpus(own, tmp_path):
    whole = Path(own).read_text().splitlines(keepends=True)
    tower = tmp_path / "tower.jsonl"
    tower.write_text("".join(line for line in whole if '"scatter"' not in line))
    train_parser(str(tower), replace(SMALL, updates=2), tmp_path / "run", device="cpu")
    agent = open_agent(tmp_path / "run", "cpu")
    with pytest.raises(AgentError, match="does not play ScatterScratch; it plays Tower"):
        agent.policy(Settings("ScatterScratch"))


# Calibration


def test_calibration__fits_the_success_rates():
    rng = random.Random(0)
    stated = [rng.choice([0.6, 0.8, 0.9]) for _ in range(3000)]
    found = fit_calibration([(probability, rng.random() < probability**0.5) for probability in stated])
    for probability in (0.6, 0.8, 0.9):
        assert found(probability) == pytest.approx(probability**0.5, abs=0.03)
    assert found(0.0) == 0.0


def test_parse_scores__count_exact_forms_and_equal_truth_by_form_and_level(tmp_path):
    same = "count(filter_obj(all_items, lambda x: is_blue(x))) >= 1"
    two = "count(filter_obj(all_items, lambda x: is_blue(x))) == 2"
    in_a_box = "exist(filter_obj(all_boxes, lambda b: exist(filter_obj(b, lambda x: is_blue(x)))))"
    entries = [
        entry("0", "tower", "train", "There is a blue block.", BLUE),
        entry("1", "tower", "dev", "There is a black block.", BLUE),
        entry("2", "tower", "dev", "Some block is blue.", in_a_box),
        entry("3", "tower", "dev", "Two blocks are blue.", two),
    ]
    write_corpus(tmp_path / "own.jsonl", "own", "CC0-1.0", entries)
    scores = parse_scores(Oracle((same, 0.6), (two, 0.4)), str(tmp_path / "own.jsonl"), "dev")
    found = {score.group: score for score in scores}
    assert found["all"] == ("tower", "all", 3, pytest.approx(1 / 3), pytest.approx(2 / 3), 1.0)
    assert found["seen forms"][2:] == (1, 1.0, 1.0, 1.0)
    assert found["unseen forms"][2:] == (2, 0.0, 0.5, 1.0)
    assert sum(score.statements for group, score in found.items() if "level" in group) == 3
