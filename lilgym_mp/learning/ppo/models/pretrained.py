"""The paper's models: C3+BERT, C10+BERT, ViLT and FLAVA, with pretrained weights loaded by `transformers`.

Sources: Wu et al. 2023, section 6 and appendix C; where the paper is silent, the authors' released baselines. Ours,
because neither specifies them: C10's layers, FLAVA's image size, the heads on ViLT's and FLAVA's pooled vector.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor, nn

from lilgym_mp.actions import ActionType
from lilgym_mp.appearances import Appearance
from lilgym_mp.extras import install
from lilgym_mp.learning.ppo.factored_policy import slot_factorisation
from lilgym_mp.learning.ppo.models.protocol import Model, Prediction
from lilgym_mp.learning.ppo.models.weights import WeightsError, check_weights, weights_digest
from lilgym_mp.learning.ppo.states import IMAGE_SHAPE, States

ARCHITECTURES = {"c3-bert": ("bert",), "c10-bert": ("bert",), "vilt": ("vilt",), "flava": ("flava",)}
MAX_INTENSITY = 255.0
MAX_TOKENS = 64  # word pieces of a statement
JOINED, TARGET = 512, 32  # widths in C3 and C10
VILT_PATCHES = 5, 19  # like the action grid
FLAVA_MEAN, FLAVA_DEVIATION = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)
TARGET_TOKEN = "<TARGET>"


def model_maker(
    model: str, appearance: Appearance, weights: Path | None, details: Mapping[str, Any] | None
) -> Callable[[bool, bool], Model]:
    """A constructor of the model, called with has_actor and has_critic; `details`: of a model file.

    Raises WeightsError.
    """
    path = Path(details["weights"]) if details is not None else weights
    config = check_weights(path, model, ARCHITECTURES[model])
    assert path is not None
    _check_library(model)
    if model in ("vilt", "flava"):
        transformer = _Vilt if model == "vilt" else _Flava
        from_config = details is not None  # its tensors come from the model file
        return lambda has_actor, has_critic: JointModel(
            transformer(path, config, from_config=from_config), appearance, has_actor, has_critic
        )
    encoder = FrozenBert(path)
    if details is not None and details["weights_sha256"] != encoder.digest:
        raise WeightsError(f"{path}: not the weights that the agent was trained with: their SHA-256 differs")
    layers = C3 if model == "c3-bert" else C10
    return lambda has_actor, has_critic: ConvolutionsAndBert(encoder, layers, appearance, has_actor, has_critic)


def _check_library(model: str) -> None:
    try:
        import transformers  # noqa: F401  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise WeightsError(f"the model {model!r} needs the package transformers: {install('transformers')}") from None


@contextmanager
def _quiet() -> Iterator[None]:
    """Silences progress bars and warnings about unused tensors; missing tensors raise an error here."""
    from transformers.utils import logging  # pyright: ignore[reportMissingImports]

    verbosity, bars = logging.get_verbosity(), logging.is_progress_bar_enabled()
    logging.set_verbosity_error()
    logging.disable_progress_bar()
    try:
        yield
    finally:
        logging.set_verbosity(verbosity)
        if bars:
            logging.enable_progress_bar()


def _pretrained(load: Any, path: Path, **options: Any) -> Any:
    """The pretrained network. Raises WeightsError when the directory lacks a part of it."""
    safe_options = {"local_files_only": True, "use_safetensors": True, "output_loading_info": True}
    try:
        with _quiet():
            network, loading_info = load(path, **safe_options, **options)
    except (OSError, ValueError, RuntimeError, KeyError) as error:
        raise WeightsError(f"{path}: cannot be loaded: {str(error).strip().splitlines()[0]}") from None
    except Exception as error:  # safetensors has its own exception, not a subclass of OSError
        if type(error).__name__ != "SafetensorError":
            raise
        raise WeightsError(f"{path}: its safetensors file is damaged: {error}") from None
    missing = sorted(loading_info["missing_keys"]) + sorted(map(str, loading_info["mismatched_keys"]))
    if missing:
        raise WeightsError(f"{path}: incomplete: {len(missing)} tensors are missing, such as {missing[0]}")
    return network


def _tokenizer(path: Path) -> Any:
    from transformers import AutoTokenizer  # pyright: ignore[reportMissingImports]

    try:
        return AutoTokenizer.from_pretrained(path, local_files_only=True)
    except Exception as error:  # its parsers raise anything
        raise WeightsError(f"{path}: its tokenizer cannot be loaded: {error}") from None


# C3+BERT and C10+BERT


class FrozenBert:
    """A frozen BERT: the mean of all layers' hidden states over a statement's word pieces, cached by statement.

    Not an nn.Module, so that its weights are not saved in model files.
    """

    def __init__(self, path: Path) -> None:
        from transformers import BertModel  # pyright: ignore[reportMissingImports]

        self.path, self.digest = path, weights_digest(path)
        self._tokenizer = _tokenizer(path)
        self._network = _pretrained(BertModel.from_pretrained, path, add_pooling_layer=False).eval()
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
    return nn.Sequential(
        nn.Conv2d(3, 32, 8, 4),
        nn.ReLU(),
        nn.Conv2d(32, 64, 4, 2),
        nn.ReLU(),
        nn.Conv2d(64, 32, 3, 1),
        nn.ReLU(),
        nn.Flatten(),
    )


def C10() -> nn.Sequential:  # noqa: N802
    """Ten convolutions of our own design; the paper specifies only their number."""
    layers: list[nn.Module] = []
    before = 3
    for channels, stride in (
        (32, 1),
        (32, 2),
        (64, 1),
        (64, 2),
        (64, 1),
        (64, 2),
        (128, 1),
        (128, 2),
        (64, 1),
        (32, 1),
    ):
        layers += [nn.Conv2d(before, channels, 3, stride, 1), nn.ReLU()]
        before = channels
    return nn.Sequential(*layers, nn.Flatten())


class ConvolutionsAndBert(Model):
    """Image, statement and target vectors, concatenated as input of an actor and a critic.

    With both, actor and critic share the convolutions and the target embedding, as in the release.
    """

    pretraining = "pretrained weights"

    def __init__(
        self, encoder: FrozenBert, convolutions: Callable[[], nn.Sequential], appearance: Appearance,
        has_actor: bool, has_critic: bool,
    ) -> None:  # fmt: skip
        super().__init__()
        self._encoder = encoder
        self.factorisation = slot_factorisation(appearance)
        self.convolutions = convolutions()
        with torch.no_grad():
            features = self.convolutions(torch.zeros(1, 3, *IMAGE_SHAPE[:2])).shape[1]
        self.image = nn.Linear(features, JOINED)
        self.target = nn.Embedding(2, TARGET)
        joined = JOINED + encoder.width + TARGET
        self.actor = _two_layers(joined) if has_actor else None
        self.heads = _Heads(JOINED, self.factorisation.heads) if has_actor else None
        self.critic = nn.Sequential(_two_layers(joined), nn.Linear(JOINED, 1)) if has_critic else None

    def forward(self, states: States) -> Prediction:
        device = self.target.weight.device
        images = torch.from_numpy(states.images()).to(device).permute(0, 3, 1, 2).float() / MAX_INTENSITY
        statements = self._encoder.vectors(states.statements, device)
        parts = (
            self.image(self.convolutions(images)),
            statements[torch.from_numpy(states.statement_of).to(device)],
            self.target(torch.from_numpy(states.targets).to(device)),
        )
        joined = torch.cat(parts, 1)
        actor_features = None if self.actor is None else self.actor(joined)
        return _prediction(
            self.heads, actor_features, None if self.critic is None else self.critic(joined), len(images)
        )

    def details(self) -> Mapping[str, Any]:
        return {"weights": str(self._encoder.path), "weights_sha256": self._encoder.digest}

    @property
    def frozen_parameters(self) -> int:
        return self._encoder.parameter_count


def _two_layers(inputs: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, JOINED), nn.LeakyReLU(), nn.Linear(JOINED, JOINED), nn.LeakyReLU())


class _Heads(nn.Module):
    """Linear heads for the type and each argument."""

    def __init__(self, width: int, heads: Sequence[Any]) -> None:
        super().__init__()
        self.types = nn.Linear(width, len(ActionType))
        self.arguments = nn.ModuleList(nn.Linear(width, head.size) for head in heads)

    def forward(self, vectors: Tensor) -> tuple[Tensor, tuple[Tensor, ...]]:
        return self.types(vectors).float(), tuple(head(vectors).float() for head in self.arguments)


def _prediction(
    heads: _Heads | None, actor_features: Tensor | None, critic_features: Tensor | None, count: int
) -> Prediction:
    """Without an actor the logits are empty; without a critic the values are 0."""
    types, arguments = (torch.zeros(count, 0), ()) if heads is None or actor_features is None else heads(actor_features)
    values = types.new_zeros(count) if critic_features is None else torch.tanh(critic_features.float().squeeze(1))
    return Prediction(types, arguments, values)


# ViLT and FLAVA


class _Transformer(nn.Module):
    """A pretrained vision-language transformer."""

    def __init__(self, path: Path, network: Any) -> None:
        super().__init__()
        self.path = path
        self.tokenizer = _tokenizer(path)
        self.tokenizer.add_special_tokens({"additional_special_tokens": [TARGET_TOKEN]})
        self.network = network

    def words(self, states: States, device: torch.device) -> dict[str, Tensor]:
        """The statement, the target token, then True or False: ViLT's input in the release."""
        texts = [
            f"{states.statements[statement]} {TARGET_TOKEN} {bool(target)}"
            for statement, target in zip(states.statement_of.tolist(), states.targets.tolist(), strict=True)
        ]
        tokens = self.tokenizer(texts, padding=True, truncation=True, max_length=self.max_tokens(), return_tensors="pt")
        return {name: tokens[name].to(device) for name in ("input_ids", "attention_mask")}

    def max_tokens(self) -> int:
        raise NotImplementedError

    def width(self) -> int:
        return int(self.network.config.hidden_size)


class _Vilt(_Transformer):
    """The image is upscaled to 5 x 19 patches, one per cell of the action grid."""

    def __init__(self, path: Path, config: Mapping[str, Any], *, from_config: bool) -> None:
        from transformers import ViltConfig, ViltModel  # pyright: ignore[reportMissingImports]

        if from_config:
            network: Any = ViltModel(ViltConfig(**config))
        else:
            network = _pretrained(ViltModel.from_pretrained, path)
        super().__init__(path, network)
        _resize_embeddings(network, len(self.tokenizer))

    def max_tokens(self) -> int:
        return int(self.network.config.max_position_embeddings)

    def forward(self, states: States) -> Tensor:
        device = self.network.pooler.dense.weight.device
        patch = self.network.config.patch_size
        size = VILT_PATCHES[0] * patch, VILT_PATCHES[1] * patch
        pixels = _resized(states, size, (0.5, 0.5, 0.5), (0.5, 0.5, 0.5), device)
        return self.network(pixel_values=pixels, **self.words(states, device)).pooler_output


class _Flava(_Transformer):
    """The image is resized to FLAVA's square; the output is the multimodal encoder's first vector."""

    def __init__(self, path: Path, config: Mapping[str, Any], *, from_config: bool) -> None:
        from transformers import FlavaConfig, FlavaModel  # pyright: ignore[reportMissingImports]

        if from_config:
            network: Any = FlavaModel(FlavaConfig(**config))
        else:
            network = _pretrained(FlavaModel.from_pretrained, path)
        super().__init__(path, network)
        _resize_embeddings(network.text_model, len(self.tokenizer))

    def max_tokens(self) -> int:
        return int(self.network.config.text_config.max_position_embeddings)

    def forward(self, states: States) -> Tensor:
        device = self.network.logit_scale.device
        side = self.network.config.image_config.image_size
        pixels = _resized(states, (side, side), FLAVA_MEAN, FLAVA_DEVIATION, device)
        return self.network(pixel_values=pixels, **self.words(states, device)).multimodal_embeddings[:, 0]


def _resize_embeddings(network: Any, words: int) -> None:
    """Adds word embeddings for the target token."""
    if network.get_input_embeddings().num_embeddings < words:
        network.resize_token_embeddings(words, mean_resizing=False)


def _resized(
    states: States, size: tuple[int, int], mean: Sequence[float], deviation: Sequence[float], device: torch.device
) -> Tensor:
    """(N, 3, *size)."""
    images = torch.from_numpy(states.images()).to(device).permute(0, 3, 1, 2).float() / MAX_INTENSITY
    images = F.interpolate(images, size=size, mode="bilinear", align_corners=False)
    shape = (1, 3, 1, 1)
    return (images - torch.tensor(mean, device=device).view(shape)) / torch.tensor(deviation, device=device).view(shape)


class JointModel(Model):
    """ViLT or FLAVA, fine-tuned, with policy heads, a value head, or both."""

    pretraining = "pretrained weights"

    def __init__(self, transformer: _Vilt | _Flava, appearance: Appearance, has_actor: bool, has_critic: bool) -> None:
        super().__init__()
        self.factorisation = slot_factorisation(appearance)
        self.transformer = transformer
        width = transformer.width()
        self.heads = _Heads(width, self.factorisation.heads) if has_actor else None
        self.critic = (
            nn.Sequential(nn.Linear(width, 2 * width), nn.LayerNorm(2 * width), nn.GELU(), nn.Linear(2 * width, 1))
            if has_critic
            else None
        )

    def forward(self, states: States) -> Prediction:
        pooled = self.transformer(states)
        return _prediction(self.heads, pooled, None if self.critic is None else self.critic(pooled), len(pooled))

    def details(self) -> Mapping[str, Any]:
        return {"weights": str(self.transformer.path)}
