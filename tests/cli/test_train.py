"""`lilgym-mp train`, `evaluate` and `explain`, with a few dozen training steps each."""

import json
import shutil
import sys
from types import SimpleNamespace

import pytest

from lilgym_mp.cli import USAGE_ERROR
from lilgym_mp.cli.explain import _sentences
from lilgym_mp.cli.options import CommandError
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.episode_files import read_episodes
from lilgym_mp.scene.render.characters import text
from tests.command_line import error_of, lilgym, output_of, succeeds
from tests.json_files import read_json, read_json_lines

SMALL = "--envs 2 --same-statement 1 --rollout 32 --batch-size 16 --epochs 1"


@pytest.fixture(scope="module")
def trained_run(own, tmp_path_factory):
    """A PPO run on the small corpus; read-only."""
    directory = tmp_path_factory.mktemp("trained") / "run"
    command = f"train ppo TowerScratch --corpus {own} --steps 64 {SMALL} --mask --recolour --out"
    succeeds(command, directory)
    return directory


@pytest.fixture
def run(trained_run, tmp_path):
    """A copy of the PPO run."""
    return shutil.copytree(trained_run, tmp_path / "run")


@pytest.mark.long
def test_train__options_override_the_recipe(tmp_path, own):
    options = "--schedule constant --learning-rate 0.003 --seed 4 --rules release --recipe paper --mask"
    succeeds(f"train ppo TowerScratch --corpus {own} --steps 64 {SMALL} {options} --out", tmp_path)
    written = read_json(tmp_path / "run.json")["identity"]
    assert (written["recipe_name"], written["environment"]["rules"]) == ("paper", "release")
    expected = {"mask": True, "critic": "separate", "rollout": 32, "learning_rate": 0.003, "schedule": "constant"}
    assert written["recipe"].items() >= {**expected, "seed": 4}.items()


@pytest.mark.parametrize(
    ("learner", "expected"),
    [
        ("reward-model", "before training begins (default: 250 in scatter, 150 in tower)"),
        ("imitation", "per statement in a batch (default: 8 in scatter, 16 in tower)"),
        ("ppo", "above 0 the agent also plays Scratch (default: 0.25 in flipit, 0 in scratch)"),
    ],
)
def test_train_help__prints_the_defaults_of_each_appearance_or_start(learner, expected, capsys):
    with pytest.raises(SystemExit):
        lilgym(f"train {learner} --help")
    output = " ".join(capsys.readouterr().out.split())
    assert expected in output
    assert "native" not in output, "a grid on which no learner can be trained"


@pytest.mark.long
def test_tensorboard__gets_the_numbers_of_each_progress_line(tmp_path, own, monkeypatch):
    written = []
    writer = SimpleNamespace(add_scalar=lambda *row: written.append(row))
    module = SimpleNamespace(SummaryWriter=lambda path, **options: writer if path == tmp_path / "tensorboard" else None)
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", module)
    succeeds(f"train ppo TowerScratch --corpus {own} --steps 64 {SMALL} --tensorboard --out", tmp_path)
    lines = read_json_lines(tmp_path / "progress.jsonl")
    assert lines
    losses = [row for row in written if row[0] == "value_loss"]
    assert losses == [("value_loss", line["value_loss"], line["steps"]) for line in lines]


def test_tensorboard__missing_is_an_error_before_training(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "tensorboard", None)
    monkeypatch.delitem(sys.modules, "torch.utils.tensorboard", raising=False)
    refused = error_of(capsys, "train ppo TowerScratch --tensorboard --out", tmp_path / "run")
    assert "--tensorboard needs tensorboard: pip install tensorboard" in refused
    assert not (tmp_path / "run").exists()


@pytest.mark.long
def test_evaluate__compares_the_agent_with_random_policies(capsys, tmp_path, run, own):
    output = output_of(capsys, f"evaluate {run} --corpus {own} --out", tmp_path / "results.json")
    (table,) = (block.splitlines() for block in output.split("\n\n") if block.startswith("policy "))
    names = [f"ppo ({run}), greedy", f"ppo ({run}), sampled", "random legal", "random unmasked"]
    assert [line.split("  ")[0] for line in table[2:]] == names
    assert "\nTowerScratch, 3 episodes\n" in output
    assert "rewards, and programs to exchange colours" in output
    agent = read_json(tmp_path / "results.json")["results"][0]
    assert agent.items() >= {"configuration": "TowerScratch", "split": "dev", "start_scenes": 3}.items()
    assert agent["supervision"].startswith("rewards, and programs to exchange colours (corpus")
    assert agent["recipe"]["recolour"] is True
    assert 0 <= agent["accuracy"] <= 1
    assert {"accuracy_seen", "accuracy_unseen", "mean_reward"} <= agent.keys()


@pytest.mark.long
def test_parse_and_plan__is_trained_and_explains(capsys, tmp_path, own):
    small = "--updates 10 --width 32 --batch-size 16 --generated-pairs 100 --held-out-statements 5"
    output = output_of(capsys, f"train parse-and-plan --corpus {own} {small} --out", tmp_path)
    assert f"lilgym-mp evaluate {tmp_path} --corpus {own}" in output
    output = output_of(capsys, "explain 'There is a blue block.' --agent", tmp_path)
    assert "parsed words: there is a blue block" in output
    assert "predicted probability of success:" in output


@pytest.mark.long
def test_explain__explains_a_task_with_its_outcome(capsys):
    task = Settings("ScatterFlipIt").make("dev").tasks[0]
    output = output_of(capsys, "explain --task", task.id)
    assert "outcome: " in output
    explained, *drawn = output.split("\n 0   1   2")
    assert task.statement in explained
    assert len(drawn) == explained.split("plan: ")[1].count("(") + 1
    assert text(task.start, [], coloured=False).split("\n")[5] in drawn[0].replace(" 2\n", "\n")


def test_explain__parses_the_statements_of_a_file(capsys, tmp_path):
    (tmp_path / "own.txt").write_text("There is a blue bloc.\n\nThere is a zorblax,\x0ban even one.\r\n", newline="")
    block, blank, zorblax = json.loads(output_of(capsys, "explain --json --file", tmp_path / "own.txt"))
    assert block["words"][-1] == "block"
    assert block["programs"][0]["program"] == "exist(filter_obj(all_items, lambda x: is_blue(x)))"
    assert block.items() >= {"corrections": {"bloc": "block"}, "unknown": [], "uncertain": []}.items()
    assert blank.items() >= {"line": 2, "statement": "", "programs": []}.items()
    assert zorblax.items() >= {"line": 3, "unknown": ["zorblax"]}.items()
    assert zorblax["programs"][0]["probability"] <= 1 / 3
    assert zorblax["uncertain"][0].startswith("unknown, 1 of")


def test_explain__reads_a_csv_file_by_its_header(capsys, tmp_path):
    (tmp_path / "own.csv").write_text('\nid,note,Sentence\n7,"two\nlines",It is blue.\n,,\n8,x,"One, even."\n')
    found = json.loads(output_of(capsys, "explain --json --file", tmp_path / "own.csv"))
    rows = [(each["line"], each["id"], each["statement"]) for each in found]
    assert rows == [(3, "7", "It is blue."), (5, "", ""), (6, "8", "One, even.")]
    (tmp_path / "own.csv").write_text("id,sentence\n")
    assert json.loads(output_of(capsys, "explain --json --file", tmp_path / "own.csv")) == []


@pytest.mark.parametrize(
    ("content", "error"),
    [
        ("id,text\n1,There is a blue block.\n", "no column sentence or statement in its header id, text"),
        ('sentence\n"There is a blue block.\nThere are two.\n', "line 3: unexpected end of data"),
        ('sentence\n"There is" a blue block.\n', "line 2: ',' expected"),
    ],
)
def test_explain__refuses_a_csv_file_without_sentences_or_with_a_stray_quote(content, error, tmp_path):
    (tmp_path / "own.csv").write_text(content)
    with pytest.raises(CommandError, match=error):
        list(_sentences(tmp_path / "own.csv"))


def test_explain__says_that_nothing_was_understood_without_readings(capsys):
    output = output_of(capsys, "explain 'asdf qwerty' --false")
    assert "nothing was understood" in output
    assert "satisfied" not in output
    assert "probability of success" not in output


def test_evaluate__records_that_imitation_chooses_greedy_or_sampled_actions(tmp_path, own):
    """The included network for Tower samples in FlipIt, as that did better on statements held out of training."""
    from lilgym_mp import load_agent
    from lilgym_mp.evaluation.policies import AS_TRAINED, SAMPLED

    assert load_agent("imitation-tower", "cpu").description.details["stop_rules"]["TowerFlipIt"]["sampled"]
    command = f"evaluate imitation-tower --alone --configuration TowerFlipIt --corpus {own}"
    succeeds(f"{command} --actions greedy sampled --record", tmp_path)
    assert {read_episodes(path).header.actions for path in tmp_path.glob("*.gz")} == {AS_TRAINED, SAMPLED}


def test_evaluate__records_each_action_mode(capsys, tmp_path, run, own):
    command = f"evaluate {run} --corpus {own} --name mine --record {tmp_path / 'kept'}"
    assert ", sampled " in output_of(capsys, f"{command} --policy random-type")
    headers = [read_episodes(path).header for path in (tmp_path / "kept").glob("*.gz")]
    assert {(header.agent, header.actions, header.mask, header.training_seed) for header in headers} == {
        ("mine", "greedy", True, 0),
        ("mine", "sampled", True, 0),
        ("random type", "sampled", False, None),
    }
    assert lilgym(command) == USAGE_ERROR  # the files exist
