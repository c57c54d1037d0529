"""Directories of pretrained weights as saved by `transformers`: config.json, model.safetensors, a tokenizer.

Only safetensors files are read; code in the directory is never executed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

CONFIG, TENSORS, INDEX = "config.json", "model.safetensors", "model.safetensors.index.json"
PICKLES = ("*.bin", "*.pt", "*.pth", "*.ckpt", "*.h5", "*.msgpack")
TOKENIZERS = ("tokenizer.json", "vocab.txt")  # one of them is required
LARGEST_CONFIG = 1 << 22  # bytes


class WeightsError(ValueError):
    """An unusable directory of weights."""


def check_weights(path: Path | None, model: str, architectures: Sequence[str]) -> dict[str, Any]:
    """The directory's config.json, checked for `model`. Raises WeightsError naming the path and what is wrong."""
    if path is None:
        raise WeightsError(
            f"the model {model!r} needs pretrained weights: name a directory with --weights, of the architecture"
            f" {' or '.join(architectures)}, with {CONFIG}, {TENSORS} and a tokenizer"
        )
    if not path.is_dir():
        raise WeightsError(f"{path}: not a directory of weights" + (": it does not exist" * (not path.exists())))
    config = _config(path / CONFIG)
    found = config.get("model_type")
    if found not in architectures:
        raise WeightsError(
            f"{path / CONFIG}: architecture {found!r}; the model {model!r} needs {' or '.join(architectures)}"
        )
    if not any((path / name).is_file() for name in (TENSORS, INDEX)):
        pickles = sorted(file.name for pattern in PICKLES for file in path.glob(pattern))
        held = f"; {', '.join(pickles)} may contain pickled objects and is not read" if pickles else ""
        raise WeightsError(f"{path}: incomplete: it has no {TENSORS}{held}")
    if not any((path / name).is_file() for name in TOKENIZERS):
        raise WeightsError(f"{path}: incomplete: it has no tokenizer ({' or '.join(TOKENIZERS)})")
    return config


def _config(file: Path) -> dict[str, Any]:
    try:
        if file.stat().st_size > LARGEST_CONFIG:
            raise WeightsError(f"{file}: larger than {LARGEST_CONFIG} bytes")
        config = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise WeightsError(f"{file.parent}: incomplete: it has no {CONFIG}") from None
    except (OSError, ValueError, RecursionError) as error:
        raise WeightsError(f"{file}: cannot be read: {error}") from None
    if not isinstance(config, dict):
        raise WeightsError(f"{file}: must be a JSON object")
    return config


def weights_digest(path: Path) -> str:
    """SHA-256 over a directory's safetensors files, or of one file."""
    digest = hashlib.sha256()
    for file in sorted(path.glob("*.safetensors")) if path.is_dir() else [path]:
        with file.open("rb") as content:
            while block := content.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()
