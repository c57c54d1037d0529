"""A trained model as one safetensors file, tensors and a description, and the device that networks run on.

The description is JSON in the file's metadata: the model's kind, the configurations it plays, its supervision, and
everything its kind needs to rebuild the network. Reading a file never executes its contents.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import asdict, dataclass, field
from pathlib import Path
from threading import get_ident
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn
from torch.nn.modules.module import register_module_parameter_registration_hook

from lilgym_mp.evaluation.files import write_atomically
from lilgym_mp.scene.arrays import AnyDict, AnyMapping, Strings
from lilgym_mp.scene.choices import choose

FORMAT = "lilgym_mp-model"
VERSION = 1
METADATA_KEY = "lilgym_mp"
DEVICES = {name: name for name in ("auto", "cpu", "cuda")}


class ModelFileError(ValueError):
    """A file that is not a model of this package, or not of the expected kind."""


@dataclass(frozen=True)
class ModelDescription:
    """Metadata of a model file."""

    kind: str  # the learner that wrote it, as named on the command line
    version: int  # version of the kind's own format
    configurations: Strings  # configurations that it plays
    supervision: str  # what it learnt from, for result tables
    recipe: AnyMapping = field(default_factory=dict)  # hyperparameters
    details: AnyMapping = field(default_factory=dict)  # specific to the kind, such as a vocabulary

    def to_json(self) -> AnyDict:
        """The description stored in the model file, with its format."""
        return {"format": FORMAT, "format_version": VERSION, **asdict(self)}

    @classmethod
    def from_json(cls, data: AnyMapping) -> ModelDescription:
        """Inverse of `to_json`. Raises ValueError, TypeError, KeyError."""
        fields = dict(data)
        found = fields.pop("format"), fields.pop("format_version")
        if found != (FORMAT, VERSION):
            raise ValueError(f"format {found[0]!r}, version {found[1]!r}; must be {FORMAT!r}, version {VERSION}")
        fields["configurations"] = tuple(fields["configurations"])
        return cls(**fields)


def save_model(path: Path, description: ModelDescription, tensors: Mapping[str, Tensor]) -> None:
    """Writes the file atomically: an interrupt leaves the old one, or none. Equal contents give equal bytes."""
    contents = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    metadata = {METADATA_KEY: json.dumps(description.to_json(), sort_keys=True)}
    data = save(contents, metadata)
    write_atomically(path, lambda unfinished: unfinished.write_bytes(data))


def read_description(path: Path) -> ModelDescription:
    """The description in a model file, without its tensors. Raises ModelFileError naming the file."""
    return load_model(path, with_tensors=False)[0]


def load_model(
    path: Path, device: str | torch.device = "cpu", *, with_tensors: bool = True
) -> tuple[ModelDescription, dict[str, Tensor]]:
    """The description, and the tensors on the device. Raises ModelFileError naming the file and what is wrong."""
    if not path.is_file():
        raise ModelFileError(f"{path}: {'not a regular file' if path.exists() else 'there is no such file'}")
    try:
        with safe_open(path, "pt", device=str(device)) as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys() if with_tensors}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise ModelFileError(f"{path}: truncated, damaged, or not a model file: {error}") from None
    if METADATA_KEY not in metadata:
        raise ModelFileError(f"{path}: a safetensors file, but not one that lilgym-mp wrote")
    with using_description(path):
        return ModelDescription.from_json(json.loads(metadata[METADATA_KEY])), tensors


@contextmanager
def using_description(path: Path) -> Iterator[None]:
    """Within the block a network is made from a description; raises ModelFileError if that cannot be used."""
    try:
        yield
    except ModelFileError:
        raise
    except (ValueError, TypeError, KeyError, IndexError, AttributeError, RuntimeError) as error:
        reason = f"it lacks {error}" if isinstance(error, KeyError) else error
        raise ModelFileError(f"{path}: its description cannot be used: {reason}") from None


@contextmanager
def no_larger_than(tensors: Mapping[str, Tensor]) -> Iterator[None]:
    """Within the block networks with many more parameters than the tensors raise ValueError before memory is used."""
    left = 2 * sum(tensor.numel() for tensor in tensors.values())  # some modules replace a parameter that they made
    thread = get_ident()

    def count(module: nn.Module, name: str, parameter: nn.Parameter | None) -> None:
        nonlocal left
        if parameter is not None and get_ident() == thread:
            left -= parameter.numel()
            if left < 0:
                shape = tuple(parameter.shape)
                raise ValueError(
                    f"its sizes give more parameters than its tensors have, such as {name} of shape {shape}"
                )

    hook = register_module_parameter_registration_hook(count)
    try:
        yield
    finally:
        hook.remove()


def load_weights(network: nn.Module, tensors: Mapping[str, Tensor], path: Path) -> None:
    """Loads the tensors into the network. Raises ModelFileError for others, or non-finite ones."""
    try:
        network.load_state_dict(dict(tensors))
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1].strip()
        raise ModelFileError(f"{path}: tensors do not match the network it describes: {reason}") from None
    non_finite = [name for name, tensor in network.state_dict().items() if not torch.isfinite(tensor).all()]
    if non_finite:
        raise ModelFileError(f"{path}: {non_finite[0]} holds non-finite values")


def weights_digest(path: Path) -> str:
    """SHA-256 over a directory's safetensors files, or of one file."""
    digest = hashlib.sha256()
    for file in sorted(path.glob("*.safetensors")) if path.is_dir() else [path]:
        with file.open("rb") as content:
            hashlib.file_digest(content, lambda: digest)
    return digest.hexdigest()


def select_device(name: str) -> torch.device:
    """The device of that name; "auto" is CUDA if available, else the CPU. Raises ValueError."""
    name = choose("device", name, DEVICES)
    available = torch.cuda.is_available()
    if name == "cuda" and not available:
        raise ValueError("device cuda was requested, but PyTorch finds no CUDA device here; choose cpu or auto")
    return torch.device("cuda" if name != "cpu" and available else "cpu")


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Within the block torch uses `count` threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def precision(device: torch.device, *, reduced: bool = True) -> AbstractContextManager[Any]:
    """Autocast to bfloat16 if `reduced`, except on CPUs without AVX-512, which are some 30 times slower at it."""
    is_fast = device.type == "cuda" or "AVX512" in torch.backends.cpu.get_cpu_capability()
    return torch.autocast(device.type, torch.bfloat16) if reduced and is_fast else nullcontext()
