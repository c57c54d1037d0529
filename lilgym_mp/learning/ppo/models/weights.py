"""Directories of pretrained weights, as `transformers` writes them: config.json, model.safetensors, a tokenizer.

Only safetensors files are read, and no code that a directory may hold is run.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

CONFIG, TENSORS, INDEX = "config.json", "model.safetensors", "model.safetensors.index.json"
PICKLES = ("*.bin", "*.pt", "*.pth", "*.ckpt", "*.h5", "*.msgpack")
TOKENIZERS = ("tokenizer.json", "vocab.txt")  # one of them is there
LARGEST_CONFIG = 1 << 22  # bytes


class WeightsError(ValueError):
    """A directory of weights that cannot serve."""


def check_weights(place: Path | None, model: str, architectures: Sequence[str]) -> dict[str, Any]:
    """The directory's config.json, once it can serve `model`. Raises WeightsError naming the place and the error."""
    if place is None:
        raise WeightsError(
            f"the model {model!r} needs pretrained weights: name their directory with --weights, of the architecture"
            f" {' or '.join(architectures)}, with {CONFIG}, {TENSORS} and a tokenizer"
        )
    if not place.is_dir():
        raise WeightsError(f"{place}: no directory of weights" + (": there is no such place" * (not place.exists())))
    config = _config(place / CONFIG)
    found = config.get("model_type")
    if found not in architectures:
        raise WeightsError(
            f"{place / CONFIG}: of the architecture {found!r}; the model {model!r} needs {' or '.join(architectures)}"
        )
    if not any((place / name).is_file() for name in (TENSORS, INDEX)):
        pickles = sorted(path.name for pattern in PICKLES for path in place.glob(pattern))
        held = f"; {', '.join(pickles)} may hold pickled objects and is not read" if pickles else ""
        raise WeightsError(f"{place}: incomplete: it has no {TENSORS}{held}")
    if not any((place / name).is_file() for name in TOKENIZERS):
        raise WeightsError(f"{place}: incomplete: it has no tokenizer ({' or '.join(TOKENIZERS)})")
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


def weights_digest(place: Path) -> str:
    """SHA-256 over the tensors' files of a directory, or of one file."""
    digest = hashlib.sha256()
    for file in sorted(place.glob("*.safetensors")) if place.is_dir() else [place]:
        with file.open("rb") as content:
            while block := content.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()
