"""`lilgym-mp evaluate`: items beside totals, why the expert fails, and which statements count as seen."""

from lilgym_mp.corpus import load_tasks
from lilgym_mp.evaluation import Settings
from lilgym_mp.evaluation.policies import NamedPolicy
from lilgym_mp.evaluation.results import training_statements
from tests.command_line import output_of, succeeds
from tests.corpora import write_statements
from tests.json_files import read_json

BLUE = "exist(filter_obj(all_items, lambda x: is_blue(x)))"
NEVER = f"{BLUE} and not {BLUE}"


def test_out__has_every_episode_and_the_expert_says_why_it_fails(tmp_path, capsys):
    corpus = write_statements(tmp_path / "own.jsonl", ("dev", "A blue block.", BLUE), ("dev", "It never is.", NEVER))
    command = f"evaluate --policy expert --configuration TowerScratch --corpus {corpus} --out"
    assert "expert, TowerScratch: 1 tasks failed: " in output_of(capsys, command, tmp_path / "out.json")
    (row,) = read_json(tmp_path / "out.json")["results"]
    blue, never = row["items"]
    assert (blue["program"], blue["outcome"], blue["actions"][-1]) == (BLUE, "success", "STOP")
    assert (never["task"], never["outcome"] == "success") == ("t1", False)


def test_parses__out_has_the_corpus_program_beside_the_predicted_one(tmp_path):
    known = next(iter(load_tasks("builtin", "tower", "scratch", "train")))
    statements = ("dev", known.statement, known.program), ("dev", "Hm.", NEVER)
    corpus = write_statements(tmp_path / "own.jsonl", *statements)
    succeeds(f"evaluate parse-and-plan --parses --corpus {corpus} --out", tmp_path / "out.json")
    (written,) = read_json(tmp_path / "out.json").values()
    assert written["totals"][0]["statements"] == 2
    right, wrong = written["items"]
    assert (right["program"], right["equal_truth"], right["form_seen"]) == (known.program, True, True)
    assert right["predicted"].startswith(("exist", "count", "not", "All"))
    assert (wrong["equal_truth"], wrong["program"], wrong["uncertain"][0]) == (False, NEVER, "nothing was understood")


def test_seen__refers_to_the_corpus_that_the_agent_was_trained_on(tmp_path):
    seen = next(iter(load_tasks("builtin", "tower", "scratch", "train"))).statement
    corpus = write_statements(tmp_path / "own.jsonl", ("train", "A new one.", BLUE), ("dev", seen, BLUE))
    settings = Settings("TowerScratch", corpus=str(corpus))

    def trained_on(recipe):
        return training_statements(settings, NamedPolicy("any", lambda settings: None, "", details={"recipe": recipe}))

    assert trained_on({}) == {"A new one."}
    assert seen in trained_on({"corpus": "builtin"})
    assert trained_on({"corpus": str(tmp_path / "gone.jsonl")}) == set()
    command = f"evaluate parse-and-plan --alone --configuration TowerScratch --corpus {corpus} --out"
    succeeds(command, tmp_path / "out.json")
    (row,) = read_json(tmp_path / "out.json")["results"]
    assert (row["episodes_seen"], row["episodes_unseen"]) == (1, 0)
