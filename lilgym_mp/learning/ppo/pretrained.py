"""The paper's models: C3+BERT, C10+BERT, ViLT and FLAVA, with pretrained weights loaded by `transformers`.

Sources: Wu et al. 2023, section 6 and appendix C; where the paper is silent, the authors' released baselines. Ours,
because neither specifies them: C10's layers, FLAVA's image size, the heads on ViLT's and FLAVA's pooled vector.

Directories of weights are as saved by `transformers`. Only safetensors files are read; code in them is never executed.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812
from numpy.lib.stride_tricks import sliding_window_view
from torch import Tensor, nn

from lilgym_mp.corpus.extras import install
from lilgym_mp.learning.common.factored_policy import Factorisation, slot_factorisation
from lilgym_mp.learning.common.model import Model, Prediction, WeightsError
from lilgym_mp.learning.common.model_file import weights_digest
from lilgym_mp.learning.common.run_directory import first_line
from lilgym_mp.learning.common.states import (
    IMAGE_SHAPE,
    PITCH,
    SIDE,
    States,
    assign_indices,
    content_hashes,
    distinct,
    row_hashes,
)
from lilgym_mp.learning.ppo.learner import FINE_TUNED
from lilgym_mp.scene import BOX_COUNT
from lilgym_mp.scene.actions import ActionType
from lilgym_mp.scene.appearances import Appearance
from lilgym_mp.scene.arrays import AnyMapping, Int64Array, UInt8Array
from lilgym_mp.scene.render.drawing import SEPARATOR_RGB

ARCHITECTURES = {"c3-bert": "bert", "c10-bert": "bert", "vilt": "vilt", "flava": "flava"}
MAX_INTENSITY = 255.0
MAX_TOKENS = 64  # word pieces of a statement
MOST_SCENES = 10_000  # in a table of windows
FEW_SCENES = 8  # of so few, whole images are convolved
# Widths in C3 and C10
JOINED = 512
TARGET = 32
VILT_PATCHES = 5, 19  # like the action grid
VILT_COLOURS = (0.5, 0.5, 0.5), (0.5, 0.5, 0.5)  # mean and deviation of each colour
FLAVA_COLOURS = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)
TARGET_TOKEN = "<TARGET>"
CONFIG = "config.json"


def checked_directory(path: Path | None, model: str) -> Path:
    """The directory, if its config.json is of the model's architecture. Raises WeightsError naming what is wrong."""
    architecture = ARCHITECTURES[model]
    if path is None:
        raise WeightsError(
            f"the model {model!r} needs pretrained weights: name a directory with --weights, of the architecture"
            f" {architecture}, with {CONFIG}, model.safetensors and a tokenizer"
        )
    if not path.is_dir():
        missing = "" if path.exists() else ": it does not exist"
        raise WeightsError(f"{path}: not a directory of weights{missing}")
    try:
        found = json.loads((path / CONFIG).read_text(encoding="utf-8")).get("model_type")
    except (OSError, ValueError, RecursionError, AttributeError) as error:
        raise WeightsError(f"{path / CONFIG}: cannot be read: {error}") from None
    if found != architecture:
        raise WeightsError(f"{path / CONFIG}: architecture {found!r}; the model {model!r} needs {architecture}")
    return path


def model_maker(
    model: str, appearance: Appearance, weights: Path | None, details: AnyMapping | None
) -> Callable[[bool, bool], Model]:
    """A constructor of the model, called with has_actor and has_critic; `details`: of a model file.

    Raises WeightsError.
    """
    path = checked_directory(Path(details["weights"]) if details is not None else weights, model)
    try:
        from transformers.utils import logging  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise WeightsError(f"the model {model!r} needs the package transformers: {install('transformers')}") from None
    logging.set_verbosity_error()  # no warnings about unused tensors; missing ones raise an error here
    logging.disable_progress_bar()
    if model in FINE_TUNED:
        return lambda has_actor, has_critic: JointModel(
            Transformer(path, model), appearance, has_actor=has_actor, has_critic=has_critic
        )
    encoder = FrozenBert(path)
    if details is not None and details["weights_sha256"] != encoder.digest:
        raise WeightsError(f"{path}: not the weights that the agent was trained with: their SHA-256 differs")
    layers = C3 if model == "c3-bert" else C10
    return lambda has_actor, has_critic: ConvolutionsAndBert(
        encoder, layers, appearance, has_actor=has_actor, has_critic=has_critic
    )


def _pretrained(load: Any, path: Path, **options: Any) -> Any:
    """The result of `load`. Raises WeightsError for an incomplete or damaged directory."""
    try:
        return load(path, local_files_only=True, **options)
    except Exception as error:  # parsers of tokenizers raise anything, and safetensors has its own exception
        raise WeightsError(f"{path}: cannot be loaded: {first_line(error)}") from None


def _pretrained_network(load: Any, path: Path, **options: Any) -> Any:
    network, found = _pretrained(load, path, use_safetensors=True, output_loading_info=True, **options)
    missing = sorted(found["missing_keys"]) + sorted(map(str, found["mismatched_keys"]))
    if missing:
        raise WeightsError(f"{path}: incomplete: {len(missing)} tensors are missing, such as {missing[0]}")
    return network


def _tokenizer(path: Path) -> Any:
    from transformers import AutoTokenizer  # pyright: ignore[reportMissingImports]

    return _pretrained(AutoTokenizer.from_pretrained, path)


class PretrainedModel(Model):
    """Features of states, with policy heads, a value head, or both. The logits are empty without policy heads, the
    values 0 without a value head."""

    pretraining = "pretrained weights"
    heads: Heads | None
    critic: nn.Module | None

    def features(self, states: Any) -> Tensor:
        """(N, width)."""
        raise NotImplementedError

    def acting(self, features: Tensor) -> Tensor:
        """The features that the policy heads read."""
        return features

    def forward(self, states: Any) -> Prediction:
        features = self.features(states)
        values = features.new_zeros(len(features)).float()
        if self.critic is not None:
            values = torch.tanh(self.critic(features).float().squeeze(1))
        if self.heads is None:
            return Prediction(features.new_zeros(len(features), 0), (), values)
        types, arguments = self.heads(self.acting(features))
        return Prediction(types, arguments, values)


class Heads(nn.Module):
    """Linear heads for the type and each argument."""

    def __init__(self, width: int, factorisation: Factorisation) -> None:
        super().__init__()
        self.types = nn.Linear(width, len(ActionType))
        self.arguments = nn.ModuleList(nn.Linear(width, head.size) for head in factorisation.heads)

    def forward(self, vectors: Tensor) -> tuple[Tensor, tuple[Tensor, ...]]:
        return self.types(vectors).float(), tuple(head(vectors).float() for head in self.arguments)


def scene_images(states: States, scenes: Int64Array) -> UInt8Array:
    """(V, 50, 190, 3) half-size images of scenes (V, 3), assembled from the states' boxes."""
    boxes = states.boxes()
    images = np.tile(np.array(SEPARATOR_RGB, np.uint8), (len(scenes), *IMAGE_SHAPE[:2], 1))
    for box in range(BOX_COUNT):
        images[:, :, box * PITCH : box * PITCH + SIDE] = boxes[scenes[:, box]]
    return images


def _floats(images: UInt8Array | Tensor, device: torch.device | None = None) -> Tensor:
    """(V, 3, 50, 190), channels last in memory, from 0 to 1."""
    return torch.as_tensor(images, device=device).permute(0, 3, 1, 2).float() / MAX_INTENSITY


# C3+BERT and C10+BERT


class FrozenBert:
    """A frozen BERT: the mean of all layers' hidden states over a statement's word pieces, cached by statement.

    Not an nn.Module, so that its weights are not saved in model files.
    """

    def __init__(self, path: Path) -> None:
        from transformers import BertModel  # pyright: ignore[reportMissingImports]

        self.path = path
        self.digest = weights_digest(path)
        self._tokenizer = _tokenizer(path)
        self._network = _pretrained_network(BertModel.from_pretrained, path, add_pooling_layer=False).eval()
        self.width = int(self._network.config.hidden_size)
        self.parameter_count = sum(parameter.numel() for parameter in self._network.parameters())
        self._cache: dict[str, Tensor] = {}

    def vectors(self, statements: Sequence[str], device: torch.device) -> Tensor:
        """(S, width)."""
        new = [statement for statement in statements if statement not in self._cache]
        for first in range(0, len(new), MAX_TOKENS):
            some = new[first : first + MAX_TOKENS]
            self._cache.update(zip(some, self._encode(some, device), strict=True))
        return torch.stack([self._cache[statement] for statement in statements]).to(device)

    @torch.no_grad()
    def _encode(self, statements: list[str], device: torch.device) -> Tensor:
        self._network.to(device)
        tokens = self._tokenizer(
            statements,
            padding=True,
            truncation=True,
            max_length=MAX_TOKENS,
            return_special_tokens_mask=True,
            return_tensors="pt",
        ).to(device)
        layers = self._network(
            input_ids=tokens["input_ids"], attention_mask=tokens["attention_mask"], output_hidden_states=True
        ).hidden_states
        mean = torch.stack(layers).float().mean(0)  # (S, T, width)
        words = (tokens["attention_mask"] * (1 - tokens["special_tokens_mask"]))[..., None]
        return (mean * words).sum(1) / words.sum(1).clamp(min=1)


def C3() -> nn.Sequential:  # noqa: N802
    """The release's three convolutions over the half-size image: 1,280 features."""
    return _convolutions([(32, 8, 4, 0), (64, 4, 2, 0), (32, 3, 1, 0)])


def C10() -> nn.Sequential:  # noqa: N802
    """Ten convolutions of our own design; the paper specifies only their number.

    Their weights are initialised as by He et al. (2015): with torch's defaults, ten layers leave nothing of the image.
    """
    channels = (16, 16, 32, 32, 64, 64, 128, 128, 64, 32)
    strides = (2, 1, 2, 1, 2, 1, 2, 1, 1, 1)
    layers = _convolutions([(count, 3, stride, 1) for count, stride in zip(channels, strides, strict=True)])
    for layer in layers:
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
            nn.init.zeros_(cast("Tensor", layer.bias))
    return layers


def _convolutions(sizes: Sequence[tuple[int, int, int, int]]) -> nn.Sequential:
    """Convolutions of these numbers of channels, kernels, strides and paddings, flattened at the end."""
    layers: list[nn.Module] = []
    before = 3
    for channels, kernel, stride, padding in sizes:
        layers += [nn.Conv2d(before, channels, kernel, stride, padding), nn.ReLU()]
        before = channels
    return nn.Sequential(*layers, nn.Flatten())


# Kept although convolving whole images is plainer: a pass of C3 with gradients over 405 distinct scenes of TowerFlipIt
# takes 19 ms of a core's time with a table that knows them, as in all passes over a rollout but the first, and 609 ms
# with torch's convolutions.
class WindowTable:
    """The distinct windows that convolutions see in scenes: images are made of few parts, and each window is convolved
    once for all images of a batch that have it.

    A window of the first convolution is pixels, of a later one the indices of the windows before it, in row-major
    order. Index 0 is outside the image.
    """

    def __init__(self, convolutions: Sequence[nn.Conv2d]) -> None:
        self._sizes = [cast("tuple[int, ...]", (c.kernel_size[0], c.stride[0], c.padding[0])) for c in convolutions]
        self._known: list[dict[int, int]] = []
        self._windows: list[Any] = []  # of each convolution, (U + 1, kernel * kernel * channels)
        self._scenes: dict[int, int] = {}
        self._positions: Any = ()  # (S, positions) windows of the last convolution in each scene

    def of(self, states: States, scenes: Int64Array) -> list[UInt8Array | Int64Array]:
        """The windows in scenes (V, 3) of the states: pixels, those of each later convolution, and (V, positions)."""
        if len(self._scenes) > MOST_SCENES:
            self._known = []
            self._windows = []
            self._scenes = {}
            self._positions = ()
        scene_of, new = assign_indices(row_hashes(states.box_hashes[scenes]), self._scenes)
        if len(new):
            positions = self._add(scene_images(states, scenes[new]))
            self._positions = np.concatenate((self._positions, positions)) if len(self._positions) else positions
        selected: list[UInt8Array | Int64Array] = []
        chosen = self._positions[scene_of]
        for windows in reversed(self._windows):
            used, renumbered = distinct(np.append(chosen.ravel(), 0), len(windows))
            selected.append(renumbered[:-1].reshape(chosen.shape))
            chosen = windows[used]
        return [chosen, *reversed(selected)]

    def _add(self, images: UInt8Array) -> Int64Array:
        """(M, positions) windows of the last convolution in images (M, 50, 190, 3)."""
        seen: Any = images
        for layer, (kernel, stride, padding) in enumerate(self._sizes):
            around = (padding, padding)
            seen = np.pad(seen, ((0, 0), around, around, (0, 0)))
            cut = sliding_window_view(seen, (kernel, kernel), (1, 2))[:, ::stride, ::stride]
            rows = np.ascontiguousarray(np.moveaxis(cut, 3, 5)).reshape(-1, kernel * kernel * seen.shape[3])
            if layer == len(self._windows):
                self._known.append({})
                self._windows.append(np.zeros((1, rows.shape[1]), rows.dtype))
            indices, new = assign_indices(content_hashes(rows), self._known[layer])
            self._windows[layer] = np.concatenate((self._windows[layer], rows[new]))
            seen = 1 + indices.reshape(*cut.shape[:3], 1)
        return seen.reshape(len(images), -1)


class ConvolutionsAndBert(PretrainedModel):
    """Image, statement and target vectors, concatenated as input of an actor and a critic.

    With both, actor and critic share the convolutions and the target embedding, as in the release.
    """

    def __init__(
        self,
        encoder: FrozenBert,
        convolutions: Callable[[], nn.Sequential],
        appearance: Appearance,
        *,
        has_actor: bool,
        has_critic: bool,
    ) -> None:
        super().__init__()
        self._encoder = encoder
        self.factorisation = slot_factorisation(appearance)
        self.convolutions = convolutions()
        self._layers = [layer for layer in self.convolutions if isinstance(layer, nn.Conv2d)]
        self._table = WindowTable(self._layers)
        with torch.no_grad():
            features = self.convolutions(torch.zeros(1, 3, *IMAGE_SHAPE[:2])).shape[1]
        self.image = nn.Linear(features, JOINED)
        self.target = nn.Embedding(2, TARGET)
        joined = JOINED + encoder.width + TARGET
        self.actor = _two_layers(joined) if has_actor else None
        self.heads = Heads(JOINED, self.factorisation) if has_actor else None
        self.critic = nn.Sequential(_two_layers(joined), nn.Linear(JOINED, 1)) if has_critic else None

    def inputs(self, states: States) -> Any:
        """The windows of V scenes (`WindowTable.of`), or a few images; statement vectors, targets, scenes of states."""
        scenes, scene_of = states.scenes()
        device = self.target.weight.device
        is_few = len(scenes) < FEW_SCENES
        arrays = [scene_images(states, scenes)] if is_few else self._table.of(states, scenes)
        seen = [torch.from_numpy(array).to(device) for array in arrays]
        indices = (states.statement_of, states.targets, scene_of)
        statement_of, targets, scene_of = (torch.from_numpy(each).to(device) for each in indices)
        return seen, self._encoder.vectors(states.statements, device)[statement_of], targets, scene_of

    def features(self, states: Any) -> Tensor:
        (images, *windows), vectors, targets, scene_of = states
        found = self._convolved(images, windows) if windows else self.convolutions(_floats(images))
        return torch.cat((self.image(found)[scene_of], vectors, self.target(targets)), 1)

    def _convolved(self, pixels: Tensor, windows: Sequence[Tensor]) -> Tensor:
        """(V, features) of `convolutions`, from the windows of V scenes: those of pixels, and the others."""
        rows = pixels.float() / MAX_INTENSITY
        found = pixels
        for convolution, index in zip(self._layers, windows, strict=True):
            weight = convolution.weight.permute(0, 2, 3, 1).flatten(1)
            found = F.relu(F.linear(rows, weight, convolution.bias))
            found = torch.cat((torch.zeros_like(found[:1]), found[1:]))
            rows = F.embedding(index, found).flatten(1)
        return rows.unflatten(1, (-1, found.shape[1])).transpose(1, 2).flatten(1)

    def acting(self, features: Tensor) -> Tensor:
        assert self.actor is not None
        return self.actor(features)

    def details(self) -> AnyMapping:
        return {"weights": str(self._encoder.path), "weights_sha256": self._encoder.digest}

    @property
    def frozen_parameters(self) -> int:
        return self._encoder.parameter_count


def _two_layers(inputs: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, JOINED), nn.LeakyReLU(), nn.Linear(JOINED, JOINED), nn.LeakyReLU())


# ViLT and FLAVA


class Transformer(nn.Module):
    """A pretrained vision-language transformer.

    ViLT's image is upscaled to 5 x 19 patches, one per cell of the action grid. FLAVA's is resized to its square, and
    its vector is the multimodal encoder's first.
    """

    def __init__(self, path: Path, model: str) -> None:
        """`model`: "vilt" or "flava"."""
        import transformers  # pyright: ignore[reportMissingImports]

        super().__init__()
        self.path = path
        self.is_vilt = model == "vilt"
        network_class: Any = getattr(transformers, f"{model.capitalize()}Model")
        self.network = _pretrained_network(network_class.from_pretrained, path)
        self.tokenizer = _tokenizer(path)
        self.tokenizer.add_special_tokens({"additional_special_tokens": [TARGET_TOKEN]})
        embedding = self.network if self.is_vilt else self.network.text_model
        words = len(self.tokenizer)
        if embedding.get_input_embeddings().num_embeddings < words:  # one more for the target token
            embedding.resize_token_embeddings(words, mean_resizing=False)

    @property
    def width(self) -> int:
        """Length of the vectors that the model gives for each token."""
        return int(self.network.config.hidden_size)

    def forward(self, states: States) -> Tensor:
        config = self.network.config
        device = next(self.network.parameters()).device
        if self.is_vilt:
            size = [count * config.patch_size for count in VILT_PATCHES]
            most_tokens = config.max_position_embeddings
        else:
            size = [config.image_config.image_size] * 2
            most_tokens = config.text_config.max_position_embeddings
        scenes, scene_of = states.scenes()
        images = _floats(scene_images(states, scenes), device)
        images = F.interpolate(images, size=size, mode="bilinear", align_corners=False)[scene_of]
        mean, deviation = torch.tensor(VILT_COLOURS if self.is_vilt else FLAVA_COLOURS, device=device)[..., None, None]
        texts = [  # the statement, the target token, then True or False: ViLT's input in the release
            f"{states.statements[statement]} {TARGET_TOKEN} {bool(target)}"
            for statement, target in zip(states.statement_of.tolist(), states.targets.tolist(), strict=True)
        ]
        tokens = self.tokenizer(texts, padding=True, truncation=True, max_length=int(most_tokens), return_tensors="pt")
        words = {name: tokens[name].to(device) for name in ("input_ids", "attention_mask")}
        output = self.network(pixel_values=(images - mean) / deviation, **words)
        return output.pooler_output if self.is_vilt else output.multimodal_embeddings[:, 0]


class JointModel(PretrainedModel):
    """ViLT or FLAVA, fine-tuned, with policy heads, a value head, or both."""

    def __init__(self, transformer: Transformer, appearance: Appearance, *, has_actor: bool, has_critic: bool) -> None:
        super().__init__()
        self.factorisation = slot_factorisation(appearance)
        self.transformer = transformer
        width = transformer.width
        self.heads = Heads(width, self.factorisation) if has_actor else None
        self.critic = None
        if has_critic:
            layers = nn.Linear(width, 2 * width), nn.LayerNorm(2 * width), nn.GELU(), nn.Linear(2 * width, 1)
            self.critic = nn.Sequential(*layers)

    def features(self, states: States) -> Tensor:
        return self.transformer(states)

    def details(self) -> AnyMapping:
        return {"weights": str(self.transformer.path)}
