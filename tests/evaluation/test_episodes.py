"""Recorded episodes: their contents, round trips through files, and errors of damaged files."""

import gzip
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lilgym_mp.contrib.report.phenomena import RULES, phenomena
from lilgym_mp.corpus.tokens import statement_form
from lilgym_mp.evaluation import CONFIGURATIONS, Settings, recording_metadata
from lilgym_mp.evaluation.episode_files import read_episodes, write_episodes
from lilgym_mp.evaluation.episodes import scenes
from lilgym_mp.evaluation.files import SUFFIX, EpisodesError
from lilgym_mp.evaluation.policies import NamedPolicy, Policy, built_in_policy
from lilgym_mp.evaluation.recording import episodes_file
from lilgym_mp.evaluation.recording_metadata import read_metadata
from lilgym_mp.evaluation.results import EvaluationPlan, play, training_statements
from lilgym_mp.scene import Colour
from lilgym_mp.scene.actions import AddBlock, Stop
from tests.command_line import succeeds
from tests.evaluation.records import record
from tests.scripts import ROOT, load_script

RUNS = ROOT / "docs" / "results" / "runs.csv"
TOWER = EvaluationPlan(Settings("TowerScratch"), "dev")
STOP, ADD_BLUE_LEFT = 0, 3  # indices of Tower's actions


class AddsThenStops(Policy):
    """Adds a blue block, then stops, with given probabilities of STOP."""

    needs_masks = False

    def __call__(self, observations, legal, rng):
        self.stop_probabilities = np.where(observations.steps == 0, 0.25, 1.0)
        return np.where(observations.steps == 0, ADD_BLUE_LEFT, STOP)


SIMPLE = NamedPolicy("adds, stops", lambda settings: AddsThenStops(), "nothing", details={"label": "adds", "run": "x"})


@pytest.mark.long
def test_record__contains_the_episodes_and_their_tasks(tmp_path):
    policy, plan = built_in_policy("random-legal"), replace(TOWER, seed=7)
    found = record(tmp_path, policy, plan)
    seen = training_statements(TOWER.settings)
    tasks, forms = TOWER.settings.tasks("dev"), set(map(statement_form, seen))
    for kept, played in zip(found.episodes, play(policy, plan, seen).episodes, strict=True):
        task = tasks.by_id(kept.task)
        assert (kept.start, kept.target, kept.program) == (task.start, task.target, task.program)
        facts = {"statement_seen": task.statement in seen, "form_seen": statement_form(task.statement) in forms}
        assert kept == replace(played, tags=task.tags, **facts)


@pytest.mark.parametrize("rules", ["paper", "release"])
def test_scenes__end_in_the_state_that_the_episode_ended_in(rules):
    settings = Settings("TowerScratch", rules=rules, horizon=2)
    env = settings.make("dev")
    env.reset(seed=0)
    for _ in range(2):
        env.step(ADD_BLUE_LEFT)
    *_, last = scenes(settings.dynamics(), env.task.start, [AddBlock(0, Colour.BLUE)] * 2)
    assert last == env.scene


def test_record__contains_actions_and_stop_probabilities(recording):
    episode = recording.episodes[0]
    assert episode.actions == (AddBlock(0, Colour.BLUE), Stop())
    assert episode.stop_probabilities == (0.25, 1.0)
    assert episode.rewards[0] == -0.1


def test_record__expert_solves_from_the_start_and_from_a_wrong_stop(tmp_path):
    found = record(tmp_path, SIMPLE, TOWER, with_expert=True).episodes
    left = [episode.actions_left for episode in found if episode.outcome == "wrong_stop"]
    assert min(left) > 1
    best = record(tmp_path, built_in_policy("expert"), TOWER, with_expert=True).episodes
    needed = [len(episode.actions) for episode in best]
    assert [episode.optimal_actions for episode in best] == [episode.optimal_actions for episode in found] == needed
    assert not any(episode.edits for episode in record(tmp_path, SIMPLE, TOWER).episodes)


def test_record__equal_evaluations_give_equal_bytes(tmp_path):
    one, two = (record(tmp_path / name, built_in_policy("random-type"), TOWER).path for name in ("one", "two"))
    assert one.read_bytes() == two.read_bytes()
    assert [*one.parent.iterdir()] == [one]


def test_episodes_file__differs_for_each_agent_configuration_split_and_seed():
    first = {"named": SIMPLE, "settings": TOWER.settings, "split": "dev", "seed": 0}
    changes = [{}, {"seed": 1}, {"split": "test"}, {"settings": Settings("TowerFlipIt")}]
    changes += [{"named": replace(SIMPLE, name=f"imitation ({'a/long/place/' * 20}{end})")} for end in "01"]
    names = {episodes_file(Path(), **first | change).name for change in changes}
    assert len(names) == len(changes)
    assert max(map(len, names)) < 120


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    return record(tmp_path_factory.mktemp("recorded"), SIMPLE, TOWER).path


@pytest.fixture
def recording(recorded, tmp_path):
    return read_episodes(Path(shutil.copy(recorded, tmp_path)))


def rewrite(path, change):
    rows = [json.loads(line) for line in gzip.decompress(path.read_bytes()).decode().splitlines()]
    change(rows)
    path.write_bytes(gzip.compress("".join(json.dumps(row, separators=(",", ":")) + "\n" for row in rows).encode()))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: rows.pop(), r"truncated after \d+ of \d+ episodes"),
        (lambda rows: rows[0].update(format="other"), "first line must name the format 'lilgym_mp-episodes'"),
        (lambda rows: rows[0].update(version=99), "line 1: format 'lilgym_mp-episodes', version 99"),
        (lambda rows: rows[0].pop("seed"), "line 1: .*seed"),
        (lambda rows: rows[0].update(actions="lazy"), "unknown actions 'lazy'; choose from as-trained"),
        (lambda rows: rows[0]["settings"].update(configuration="Tower"), "line 1: unknown configuration 'Tower'"),
        (lambda rows: rows[2].update(rewards=[0.1, "x"]), "line 3: rewards must be of type tuple"),
        (lambda rows: rows[2].update(outcome="lost"), "line 3: unknown outcome 'lost'; choose from horizon"),
        (lambda rows: rows[2].update(actions=["JUMP"]), "line 3: 'JUMP' is not an action"),
        (lambda rows: rows[2].update(rewards=[]), "line 3: 0 rewards for 2 actions"),
        (lambda rows: rows[2].update(start=[[], []]), "line 3: a scene has 3 boxes, not 2"),
    ],
)
def test_read__errors_name_file_and_line(recording, change, message):
    rewrite(recording.path, change)
    with pytest.raises(EpisodesError, match=message) as error:
        read_episodes(recording.path)
    assert str(recording.path) in str(error.value)


def test_read__accepts_older_recordings_with_phenomena_and_their_digest_is_the_same(recording):
    def as_before(rows):
        for row in rows[1:]:
            tags = [name for name in RULES if name in phenomena(row["program"])]
            rest = {name: row.pop(name) for name in list(row)[list(row).index("tags") :]}
            row.update(phenomena=tags, **rest)

    digest = load_script("digest_recordings").digest
    before = digest(recording.path.parent)
    rewrite(recording.path, as_before)
    assert read_episodes(recording.path).episodes == recording.episodes
    assert digest(recording.path.parent) == before


@pytest.mark.parametrize("kept", [0, 300])
def test_read__rejects_a_truncated_file(recording, kept):
    recording.path.write_bytes(recording.path.read_bytes()[:kept])
    with pytest.raises(EpisodesError, match=r"truncated|damaged|holds no recorded episodes"):
        read_episodes(recording.path)


def test_write__rejects_a_header_with_another_episode_count(recording, tmp_path):
    with pytest.raises(ValueError, match="the header says"):
        write_episodes(tmp_path / "new", recording.header, recording.episodes[1:])
    assert not (tmp_path / "new").exists()


def test_recording_metadata__is_next_to_every_recording(tmp_path):
    command = f"evaluate --policy random-legal expert --configuration TowerScratch --record {tmp_path}"
    succeeds(command)
    recordings = list(tmp_path.glob(f"*{SUFFIX}"))
    assert len(recordings) == 2
    for recording in recordings:
        found = read_metadata(recording)
        assert found["command"] == f"lilgym-mp {command}"
        assert re.fullmatch(r"\d{4}-\d\d-\d\d \d\d:\d\d", found["date"])
        assert found["software"]["numpy"]
        assert found["machine"] == recording_metadata.machine()


def test_commit__is_known_in_an_editable_install(tmp_path, monkeypatch):
    (tmp_path / "lilgym_mp").symlink_to(ROOT / "lilgym_mp")
    monkeypatch.setattr(recording_metadata, "__file__", f"{tmp_path}/lilgym_mp/evaluation/recording_metadata.py")
    assert (recording_metadata.commit.__wrapped__() is None) != (ROOT / ".git").exists()


def test_metadata__is_empty_without_a_file_and_names_a_damaged_one(tmp_path):
    recording = tmp_path / f"a{SUFFIX}"
    assert read_metadata(recording) == {}
    (tmp_path / "a.metadata.json").write_text('{"date":')
    with pytest.raises(EpisodesError, match=r"a\.metadata\.json: not valid metadata of a recording"):
        read_metadata(recording)


@pytest.mark.long
def test_results__random_rows_have_the_published_digest(official_data, tmp_path):
    command = "evaluate --corpus lilgym --optimal --policy random-legal random-type --passes 5 --record"
    succeeds(command, tmp_path, "--configuration", *CONFIGURATIONS)
    digest = load_script("digest_recordings").digest(tmp_path)
    row = next(line for line in RUNS.read_text().splitlines() if line.startswith('"8, 9"'))
    assert row.endswith(digest)
