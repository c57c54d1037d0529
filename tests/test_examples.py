"""The examples run, shortened, and do what they promise."""

import io
import json
import os
import re
import runpy
import sys
from base64 import b64decode
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
from PIL import Image

from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.episode_files import read_episodes
from tests.command_line import python, succeeds
from tests.documents import code_blocks
from tests.json_files import read_json
from tests.scripts import ROOT, needs

EXAMPLES = ROOT / "examples"
RLLIB_RETURN = r"steps  mean return  proposer_0 (\S+)"
TIMEOUT_SECONDS = 300  # per process; a local Ray starts slowly on a busy machine


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Runs an example in this process and returns its output."""

    def run_example(name, *arguments):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", [name, *arguments])
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        return capsys.readouterr().out

    return run_example


def test_first_steps__plays_and_writes_a_picture(run, tmp_path):
    assert "reward" in run("first_steps.py", "--max-actions", "2")
    assert (tmp_path / "first_steps.png").stat().st_size > 0


@pytest.mark.long
def test_demo__writes_results_recordings_and_films(tmp_path, capsys, own, monkeypatch):
    demo = runpy.run_path(str(EXAMPLES / "demo.py"))
    short = demo["EXPERIMENT"].read_text()
    for whole, few in (("1_900", "20"), ("12_000", "500"), ("700", "10"), ('"builtin"', f'"{own}"')):
        short = short.replace(f"= {whole}\n", f"= {few}\n")
    (tmp_path / "short.toml").write_text(short)

    def command(word, *more):
        demo["command"](word, *more, *(["--corpus", own] if word == "evaluate" else []))

    names = demo["demo"].__globals__
    monkeypatch.setitem(names, "command", command)
    monkeypatch.setitem(names, "Settings", partial(Settings, corpus=own))
    demo["demo"](tmp_path / "demo", tmp_path / "short.toml")
    printed = capsys.readouterr().out
    found = read_json(tmp_path / "demo" / "results.json")["results"]
    agents = {"random type", "random legal", "imitation", "parse-and-plan", "expert"}
    assert {row["agent"].split(" (")[0] for row in found} == agents
    tasks = Settings("TowerScratch", corpus=own).make("dev").evaluation_tasks()
    recorded = list((tmp_path / "demo" / "comparison").glob("*.gz"))
    assert len(recorded) == 5
    assert [episode.task for episode in read_episodes(recorded[0]).episodes] == [*tasks]
    for name in ("imitation", "parse-and-plan"):
        film = tmp_path / "demo" / f"{name}.gif"
        assert str(film) in printed
        with Image.open(film) as frames:
            assert frames.n_frames > 1


@pytest.mark.long
def test_self_play__grows_both_pools_and_writes_the_curve(run, tmp_path):
    small = ["--envs", "8", "--same-statement", "2", "--rollout", "64", "--batch-size", "64", "--width", "16"]
    printed = run("self_play.py", "--rounds", "1", "--steps", "64", "--out", "played", "--", *small)
    saved = read_json(tmp_path / "played" / "verifier-1" / "run.json")
    assert saved["identity"]["partners"]["proposer"] == ["helpful", "deceptive"]
    names, row = (tmp_path / "played" / "exploitability.csv").read_text().splitlines()
    found = dict(zip(names.split(","), map(float, row.split(",")), strict=True))
    assert found["exploitability"] == pytest.approx(found["proposer_gain"] + found["verifier_gain"], abs=1e-3)
    assert f"round 1: exploitability {found['exploitability']:.3f}" in printed


@pytest.mark.long
@pytest.mark.parametrize("masks", [False, True])
def test_train_masked_ppo__evaluates_the_model_that_it_saves(run, tmp_path, masks):
    needs("sb3_contrib")
    options = ["--configuration", "TowerScratch", "--corpus", "builtin", "--steps", "256", "--seed", "1"]
    options += ["--masks"] * masks
    run("train_masked_ppo.py", *options, "--split", "test", "--json", "results.json")
    rows = read_json(tmp_path / "results.json")["results"]
    found = [(row["actions"], row["split"], "masked" in row["supervision"]) for row in rows]
    assert found == [("greedy", "test", masks), ("sampled", "test", masks)]
    assert (tmp_path / "masked_ppo.zip").exists()


def test_tour__saved_outputs_are_pictures_rather_than_names_of_objects():
    text = (EXAMPLES / "tour.ipynb").read_text()
    assert "<IPython.core.display" not in text
    assert "data:image/gif;base64," in text


@pytest.mark.long
def test_tour__runs_and_shows_scenes_a_film_and_a_chart(tmp_path, monkeypatch, capsys):
    needs("torch", "matplotlib")
    shown = []
    display = SimpleNamespace(
        display=shown.append,
        Image=lambda name: Image.open(io.BytesIO(Path(name).read_bytes())),
        HTML=lambda text: Image.open(io.BytesIO(b64decode(text.partition("base64,")[2].partition('"')[0]))),
    )
    notebook = SimpleNamespace(version_info=(9, 0), get_ipython=lambda: None, display=display)  # without Jupyter
    monkeypatch.setitem(sys.modules, "IPython", notebook)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    monkeypatch.chdir(tmp_path)
    names, saved = {}, []
    for cell in read_json(EXAMPLES / "tour.ipynb")["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
            saved += [output["data"].get("image/png") for output in cell["outputs"] if "data" in output]
    *scenes, film, chart = shown
    pictures = [Image.open(io.BytesIO(b64decode(text))) for text in filter(None, saved)]
    assert [each.tobytes() for each in pictures] == [each.tobytes() for each in (*scenes, chart)]
    assert [scene.size for scene in scenes] == [(784, 304)] * 2
    assert film.n_frames > 2
    assert chart.width > 300
    assert re.search(r"^parse-and-plan +94\.\d %", capsys.readouterr().out, re.MULTILINE)


@pytest.mark.long
@pytest.mark.parametrize(
    ("example", "options", "shown"),
    [
        ("ppo_single_file.py", ["--env", "lilgym_mp/TowerFlipIt-v0"], r"(.*\n)+ +4,096 +\d+ +0\.\d{3}  0\.\d{3}\n"),
        ("game_ppo.py", [], r" *turns +success\n *4,096  [01]\.\d+\n"),
    ],
)
def test_ppo_example__reports_its_accuracy(run, example, options, shown):
    needs("torch")
    assert re.fullmatch(shown, run(example, *options, "--steps", "4096"))


@pytest.mark.long
def test_proposer_verifier_audit__trains_a_verifier_and_writes_its_curve(run, tmp_path):
    needs("sb3_contrib")
    options = ("--steps", "32", "--rollout", "32", "--tasks", "20")
    printed = run("proposer_verifier_audit.py", *options, "--out", "out")
    assert "always accepting" in printed
    assert "true accepts" in printed
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"curve.csv", "curve.svg", "verifier.zip"}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.long
def test_supersuit_ppo__plays_with_the_guides_views(run):
    needs("supersuit")
    assert "mean return" in run("supersuit_ppo.py", "--steps", "256", "--games", "1", "--guide")


@pytest.fixture(scope="module")
def structured(tmp_path_factory):
    """A small data set of mixed quality, with observations as items."""
    file = tmp_path_factory.mktemp("structured") / "own.npz"
    succeeds("data collect TowerScratch --episodes 10 --observation structured --quality mixed --out", file)
    return file


@pytest.mark.filterwarnings("ignore")  # of d3rlpy's dependencies
@pytest.mark.parametrize(
    ("example", "module", "options", "last"),
    [
        ("behaviour_cloning.py", "torch", [], r" +\d+  \d+\.\d\d  0\.\d{3}"),
        ("offline_rl.py", "d3rlpy", ["--method", "cql"], r" +\d+  0\.\d{3}"),
        ("offline_rl.py", "d3rlpy", ["--method", "bc"], r" +\d+  0\.\d{3}"),
    ],
)
@pytest.mark.long
def test_offline_example__learns_from_a_data_set(run, structured, example, module, options, last):
    needs(module)
    assert re.fullmatch(last, run(example, str(structured), *options, "--updates", "2").splitlines()[-1])


@pytest.mark.long
def test_train_language_model__reports_both_phases(run):
    needs("torch")
    short = ("--rows", "40", "--supervised-steps", "2", "--reward-steps", "1", "--prompts", "2")
    phases = [json.loads(line)["phase"] for line in run("train_language_model.py", *short).splitlines()]
    assert phases == ["supervised", "supervised", "rewarded"]


@pytest.mark.long
def test_finetune_language_model__reports_each_phase_and_saves_the_models(run, tmp_path):
    transformers = pytest.importorskip("transformers")
    tokenizers = pytest.importorskip("tokenizers")
    words = {word: index for index, word in enumerate(("<eos>", "STOP", "ADD(LEFT, BLUE)", "Statement:", "LEFT:"))}
    backend = tokenizers.Tokenizer(tokenizers.models.WordLevel(words, unk_token="<eos>"))
    backend.pre_tokenizer = tokenizers.pre_tokenizers.CharDelimiterSplit("\n")
    tokenizer = transformers.PreTrainedTokenizerFast(tokenizer_object=backend, eos_token="<eos>")
    tokenizer.chat_template = "{% for message in messages %}{{ message.content }}{% endfor %}"
    tokenizer.save_pretrained(tmp_path / "tiny")
    sizes = {"hidden_size": 16, "intermediate_size": 16, "num_hidden_layers": 2, "num_attention_heads": 2}
    config = transformers.LlamaConfig(vocab_size=len(words), bos_token_id=None, eos_token_id=0, **sizes)
    transformers.LlamaForCausalLM(config).save_pretrained(tmp_path / "tiny")
    short = ("--supervised-steps", "2", "--reward-steps", "2", "--rows", "40", "--dev-rows", "10")
    printed = run("finetune_language_model.py", "--model", "tiny", "--out", "out", *short)
    assert printed == (tmp_path / "out" / "progress.jsonl").read_text()
    reported = [(line["phase"], line["step"]) for line in map(json.loads, printed.splitlines())]
    assert reported[2:] == [("zero-shot", 0), ("supervised", 2), ("rewarded", 2)]
    for name in ("supervised", "rewarded"):
        assert (tmp_path / "out" / name / "model.safetensors").exists()


@pytest.mark.parametrize(
    ("name", "module", "options", "pattern", "gain"),
    [
        pytest.param("supersuit_ppo", "supersuit", "--steps 24576", r"(\S+)$", 0.3, marks=pytest.mark.long),
        ("torchrl_rollout", "torchrl", "--steps 64 --envs 2 --batch 64 --width 8", "legal actions (100)%", 0),
        ("torchrl_two_agents", "torchrl", "--frames 4096 --batch 1024", r"success (\S+)$", 0.1),
        ("torchrl_two_agents", "torchrl", "--frames 512 --batch 256 --guide", r"success (\S+)$", -1),
        ("benchmarl_game", "benchmarl", "--frames 8192", r"mean return ([+-]\d\.\d+)$", 0.2),
        ("benchmarl_game", "benchmarl", "--frames 2048 --guide", r"mean return ([+-]\d\.\d+)$", -1),
        ("rllib_two_policies", "ray", "--steps 4096 --batch 1024 --width 32 --runners 0", RLLIB_RETURN, 0.1),
        ("rllib_two_policies", "ray", "--steps 256 --batch 128 --width 16 --runners 0 --guide", RLLIB_RETURN, -3),
        ("rllib_single_agent", "ray", "--steps 64 --batch 64 --width 8 --runners 0", r"(\d+) steps  mean return", 0),
    ],
)
def test_examples_with_other_libraries__learn(tmp_path, name, module, options, pattern, gain):
    needs(module)
    environment = {**os.environ, "PYTHONPATH": str(EXAMPLES.parent)}
    done = python(EXAMPLES / f"{name}.py", *options.split(), cwd=tmp_path, env=environment, timeout=TIMEOUT_SECONDS)
    assert done.returncode == 0, done.stdout + done.stderr
    printed = [float(found) for found in re.findall(pattern, done.stdout, re.MULTILINE)]
    assert printed[-1] >= printed[0] + gain


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")  # of the libraries
@pytest.mark.parametrize(("module", "text"), [("torchrl", "from torchrl."), ("supersuit", "MaskablePPO")])
def test_code_in_the_integrations_page__prints_the_described_output(module, text, capsys):
    needs(module)
    page = (ROOT / "docs" / "integrations.md").read_text()
    blocks = [block for block in code_blocks(page) if text in block.code]
    exec("".join(block.code for block in blocks), {"__name__": "__main__"})
    assert capsys.readouterr().out == "".join(block.output or "" for block in blocks)
