"""Model files: round trips and invalid files."""

import copy
import pickle
import resource
from dataclasses import replace
from importlib.resources import as_file, files
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from torch import nn

from lilgym_mp.learning.common.agents import AgentError, open_agent
from lilgym_mp.learning.common.model_file import (
    METADATA_KEY,
    ModelDescription,
    ModelFileError,
    load_model,
    load_weights,
    save_model,
    select_device,
)
from lilgym_mp.learning.common.run_directory import AGENT_FILE
from tests.learning.conftest import Trap, equal

DESCRIPTION = ModelDescription(
    "imitation", 1, ("TowerScratch",), "programs", {"seed": 3}, {"vocabulary": ["a", "blue", "block"]}
)
TENSORS = {"weight": torch.arange(6.0).reshape(2, 3), "bias": torch.zeros(2)}


UNUSABLE = "description cannot be used|do not match the network"
SHIPPED = ("imitation-tower", "parse-and-plan", "ppo-tower")


@pytest.fixture
def model(tmp_path):
    path = tmp_path / AGENT_FILE
    save_model(path, DESCRIPTION, TENSORS)
    return path


def test_save__is_inverted_by_load_and_deterministic_and_leaves_no_other_file(model):
    description, tensors = load_model(model)
    assert description == DESCRIPTION
    assert equal(tensors, TENSORS)
    first = model.read_bytes()
    save_model(model, DESCRIPTION, dict(reversed(TENSORS.items())))
    assert model.read_bytes() == first
    assert list(model.parent.iterdir()) == [model]


@pytest.mark.parametrize("kept", [0, 7, 100, -1])
def test_load__rejects_truncated_files(model, kept):
    model.write_bytes(model.read_bytes()[:kept])
    with pytest.raises(ModelFileError, match="truncated, damaged, or not a model file"):
        load_model(model)


def test_load__never_unpickles(tmp_path):
    path = tmp_path / "trap.pt"
    path.write_bytes(pickle.dumps(Trap(tmp_path / "opened")))
    with pytest.raises(ModelFileError, match="truncated, damaged, or not a model file"):
        load_model(path)
    assert not (tmp_path / "opened").exists()


@pytest.mark.parametrize(
    ("metadata", "said"),
    [
        ({}, "not one that lilgym-mp wrote"),
        ({METADATA_KEY: "{"}, "description cannot be used"),
        ({METADATA_KEY: '{"format": "lilgym_mp-model", "format_version": 99}'}, "version 99; must be .* version 1"),
        ({METADATA_KEY: '{"format": "lilgym_mp-model", "format_version": 1}'}, "description cannot be used"),
    ],
)
def test_load__rejects_other_description_formats(tmp_path, metadata, said):
    path = tmp_path / "other.safetensors"
    save_file(TENSORS, path, metadata)
    with pytest.raises(ModelFileError, match=said):
        load_model(path)


def test_load__rejects_missing_and_irregular_files(tmp_path):
    with pytest.raises(ModelFileError, match="there is no such file"):
        load_model(tmp_path / "nothing")
    with pytest.raises(ModelFileError, match="not a regular file"):
        load_model(Path("/dev/zero"))


def test_load_weights__rejects_other_shapes_and_nan(model):
    with pytest.raises(ModelFileError, match="size mismatch for weight"):
        load_weights(nn.Linear(4, 2), TENSORS, model)
    with pytest.raises(ModelFileError, match="bias holds non-finite values"):
        load_weights(nn.Linear(3, 2), {**TENSORS, "bias": torch.tensor([0.0, float("nan")])}, model)
    layer = nn.Linear(3, 2)
    load_weights(layer, TENSORS, model)
    assert torch.equal(layer.weight, TENSORS["weight"])


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("parse-and-plan", {"width": 64}, UNUSABLE),
        ("imitation-tower", {"width": "wide"}, UNUSABLE),
        ("parse-and-plan", {"vocabulary": ["a"]}, UNUSABLE),
        ("parse-and-plan", {"heads": 0}, "heads must divide the width, 96, not be 0"),
        ("parse-and-plan", {"longest_program": 10**7}, "longest_program must be at most 4,096, not 10,000,000"),
        ("ppo-tower", {"heads": 5}, "heads must divide the width, 112, not be 5"),
        *((name, {"width": 4_000_000}, "its sizes give more parameters than its tensors have") for name in SHIPPED),
        *((name, {"layers": 10**9, "text_layers": 10**9}, "its sizes give more parameters") for name in SHIPPED),
    ],
)
def test_open_agent__rejects_other_sizes_than_the_tensors_before_memory_is_used(name, change, said, tmp_path):
    with as_file(files("lilgym_mp.data") / f"agent-{name}.safetensors") as path:
        description, tensors = load_model(path)
    details = copy.deepcopy(description.details)
    sizes = details["model"]["sizes"] if "model" in details else details.get("network") or details["sizes"]
    sizes |= {key: value for key, value in change.items() if key in ("width", "vocabulary") or key in sizes}
    save_model(tmp_path / AGENT_FILE, replace(description, details=details), tensors)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ModelFileError, match=said):
        open_agent(tmp_path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"kind": "guessing"}, "unknown kind 'guessing'; known: game, imitation, parse-and-plan, "),
        ({"version": 99}, "a model of kind 'imitation', version 99; must be 'imitation', version 1"),
    ],
)
def test_open_agent__rejects_other_kinds_and_versions(model, changes, said):
    save_model(model, replace(DESCRIPTION, **changes), TENSORS)
    with pytest.raises(ModelFileError, match=said):
        open_agent(model.parent)


def test_open_agent__rejects_directories_without_agent(tmp_path):
    with pytest.raises(AgentError, match=f"it has no {AGENT_FILE}"):
        open_agent(tmp_path)
    with pytest.raises(AgentError, match="no such file or directory"):
        open_agent(tmp_path / "nowhere")


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device here")
def test_device__rejects_unavailable_and_unknown_devices():
    assert select_device("auto") == select_device("cpu") == torch.device("cpu")
    with pytest.raises(ValueError, match="finds no CUDA device here; choose cpu or auto"):
        select_device("cuda")
    with pytest.raises(ValueError, match="unknown device 'tpu'; choose from auto, cpu, cuda"):
        select_device("tpu")
