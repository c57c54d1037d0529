"""The paper's models: C3+BERT, C10+BERT, ViLT and FLAVA, with weights from a local directory through `transformers`.

Sources: Wu et al. 2023, section 6 and appendix C; what it leaves open follows the authors' released baselines, and
what those leave open is ours: C10's layers, FLAVA's image size, the heads on ViLT's and FLAVA's pooled vector.
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
BRIGHTEST = 255.0
LONGEST = 64  # word pieces of a statement
JOINED, TARGET = 512, 32  # widths of C3 and C10
VILT_PATCHES = 5, 19  # as the action grid
FLAVA_MEAN, FLAVA_DEVIATION = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)
TARGET_TOKEN = "<TARGET>"


def maker(
    model: str, appearance: Appearance, weights: Path | None, details: Mapping[str, Any] | None
) -> Callable[[bool, bool], Model]:
    """What makes the model, of whether it has_actor and whether it has_critic; `details` are those of a model file.

    Raises WeightsError.
    """
    place = Path(details["weights"]) if details is not None else weights
    config = check_weights(place, model, ARCHITECTURES[model])
    assert place is not None
    _check_library(model)
    if model in ("vilt", "flava"):
        transformer = _Vilt if model == "vilt" else _Flava
        fresh = details is not None  # the model file has the tensors
        return lambda has_actor, has_critic: JointModel(
            transformer(place, config, fresh=fresh), appearance, has_actor, has_critic
        )
    encoder = FrozenBert(place)
    if details is not None and details["weights_sha256"] != encoder.digest:
        raise WeightsError(f"{place}: not the weights that the agent was trained with: their SHA-256 differs")
    layers = C3 if model == "c3-bert" else C10
    return lambda has_actor, has_critic: ConvolutionsAndBert(encoder, layers, appearance, has_actor, has_critic)


def _check_library(model: str) -> None:
    try:
        import transformers  # noqa: F401  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise WeightsError(f"the model {model!r} needs the package transformers: {install('transformers')}") from None


@contextmanager
def _quiet() -> Iterator[None]:
    """No progress bar and no notes of the library on tensors that are not used: what lacks is an error here."""
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


def _pretrained(load: Any, place: Path, **options: Any) -> Any:
    """The pretrained network. Raises WeightsError where the directory does not have all of it."""
    found_only = {"local_files_only": True, "use_safetensors": True, "output_loading_info": True}
    try:
        with _quiet():
            network, found = load(place, **found_only, **options)
    except (OSError, ValueError, RuntimeError, KeyError) as error:
        raise WeightsError(f"{place}: cannot be loaded: {str(error).strip().splitlines()[0]}") from None
    except Exception as error:  # safetensors has an exception of its own, which is no OSError
        if type(error).__name__ != "SafetensorError":
            raise
        raise WeightsError(f"{place}: its safetensors file is damaged: {error}") from None
    lacking = sorted(found["missing_keys"]) + sorted(map(str, found["mismatched_keys"]))
    if lacking:
        raise WeightsError(f"{place}: incomplete: {len(lacking)} tensors are missing, such as {lacking[0]}")
    return network


def _tokenizer(place: Path) -> Any:
    from transformers import AutoTokenizer  # pyright: ignore[reportMissingImports]

    try:
        return AutoTokenizer.from_pretrained(place, local_files_only=True)
    except Exception as error:  # the library raises whatever its parsers raise
        raise WeightsError(f"{place}: its tokenizer cannot be loaded: {error}") from None


# C3+BERT and C10+BERT


class FrozenBert:
    """A BERT that is never trained: the mean of its layers' hidden states over a statement's word pieces.

    The vectors are calculated once for each statement. It is no module, so that its weights are in no model file.
    """

    def __init__(self, place: Path) -> None:
        from transformers import BertModel  # pyright: ignore[reportMissingImports]

        self.place, self.digest = place, weights_digest(place)
        self._tokenizer = _tokenizer(place)
        self._network = _pretrained(BertModel.from_pretrained, place, add_pooling_layer=False).eval()
        self.width = int(self._network.config.hidden_size)
        self.parameter_count = sum(weight.numel() for weight in self._network.parameters())
        self._known: dict[str, Tensor] = {}

    def vectors(self, statements: Sequence[str], device: torch.device) -> Tensor:
        """(S, width)."""
        new = [statement for statement in statements if statement not in self._known]
        for first in range(0, len(new), LONGEST):
            some = new[first : first + LONGEST]
            self._known.update(zip(some, self._read(some, device), strict=True))
        return torch.stack([self._known[statement] for statement in statements]).to(device)

    @torch.no_grad()
    def _read(self, statements: list[str], device: torch.device) -> Tensor:
        self._network.to(device)
        found = self._tokenizer(
            statements,
            padding=True,
            truncation=True,
            max_length=LONGEST,
            return_special_tokens_mask=True,
            return_tensors="pt",
        ).to(device)
        layers = self._network(
            input_ids=found["input_ids"], attention_mask=found["attention_mask"], output_hidden_states=True
        ).hidden_states
        mean = torch.stack(layers).float().mean(0)  # (S, T, width)
        words = (found["attention_mask"] * (1 - found["special_tokens_mask"]))[..., None]
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
    """Ten convolutions, of a design of our own: the paper says no more than their number."""
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
    """Image, statement and target, each a vector, joined for a network of the policy and one of the value.

    Where it both has_actor and has_critic these share the convolutions and the target's embedding, as in the release.
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
        images = torch.from_numpy(states.images()).to(device).permute(0, 3, 1, 2).float() / BRIGHTEST
        statements = self._encoder.vectors(states.statements, device)
        parts = (
            self.image(self.convolutions(images)),
            statements[torch.from_numpy(states.statement_of).to(device)],
            self.target(torch.from_numpy(states.targets).to(device)),
        )
        joined = torch.cat(parts, 1)
        acting = None if self.actor is None else self.actor(joined)
        return _prediction(self.heads, acting, None if self.critic is None else self.critic(joined), len(images))

    def details(self) -> Mapping[str, Any]:
        return {"weights": str(self._encoder.place), "weights_sha256": self._encoder.digest}

    @property
    def frozen_parameters(self) -> int:
        return self._encoder.parameter_count


def _two_layers(inputs: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, JOINED), nn.LeakyReLU(), nn.Linear(JOINED, JOINED), nn.LeakyReLU())


class _Heads(nn.Module):
    """The type, and each argument, all from one vector."""

    def __init__(self, width: int, heads: Sequence[Any]) -> None:
        super().__init__()
        self.types = nn.Linear(width, len(ActionType))
        self.arguments = nn.ModuleList(nn.Linear(width, head.size) for head in heads)

    def forward(self, vectors: Tensor) -> tuple[Tensor, tuple[Tensor, ...]]:
        return self.types(vectors).float(), tuple(head(vectors).float() for head in self.arguments)


def _prediction(heads: _Heads | None, acting: Tensor | None, judging: Tensor | None, count: int) -> Prediction:
    """Empty logits of a model that does not act, values of 0 of one that does not judge."""
    types, arguments = (torch.zeros(count, 0), ()) if heads is None or acting is None else heads(acting)
    values = types.new_zeros(count) if judging is None else torch.tanh(judging.float().squeeze(1))
    return Prediction(types, arguments, values)


# ViLT and FLAVA


class _Transformer(nn.Module):
    """A pretrained network that reads image and words together."""

    def __init__(self, place: Path, network: Any) -> None:
        super().__init__()
        self.place = place
        self.tokenizer = _tokenizer(place)
        self.tokenizer.add_special_tokens({"additional_special_tokens": [TARGET_TOKEN]})
        self.network = network

    def words(self, states: States, device: torch.device) -> dict[str, Tensor]:
        """The statement, then the token of the target, then True or False: what the release shows ViLT."""
        texts = [
            f"{states.statements[statement]} {TARGET_TOKEN} {bool(target)}"
            for statement, target in zip(states.statement_of.tolist(), states.targets.tolist(), strict=True)
        ]
        found = self.tokenizer(texts, padding=True, truncation=True, max_length=self.longest(), return_tensors="pt")
        return {name: found[name].to(device) for name in ("input_ids", "attention_mask")}

    def longest(self) -> int:
        raise NotImplementedError

    def width(self) -> int:
        return int(self.network.config.hidden_size)


class _Vilt(_Transformer):
    """The image is enlarged to 5 x 19 patches, as the action grid has cells."""

    def __init__(self, place: Path, config: Mapping[str, Any], *, fresh: bool) -> None:
        from transformers import ViltConfig, ViltModel  # pyright: ignore[reportMissingImports]

        if fresh:
            network: Any = ViltModel(ViltConfig(**config))
        else:
            network = _pretrained(ViltModel.from_pretrained, place)
        super().__init__(place, network)
        _make_room(network, len(self.tokenizer))

    def longest(self) -> int:
        return int(self.network.config.max_position_embeddings)

    def forward(self, states: States) -> Tensor:
        device = self.network.pooler.dense.weight.device
        patch = self.network.config.patch_size
        size = VILT_PATCHES[0] * patch, VILT_PATCHES[1] * patch
        pixels = _enlarged(states, size, (0.5, 0.5, 0.5), (0.5, 0.5, 0.5), device)
        return self.network(pixel_values=pixels, **self.words(states, device)).pooler_output


class _Flava(_Transformer):
    """The image is enlarged to the square that FLAVA knows; the multimodal encoder's first vector counts."""

    def __init__(self, place: Path, config: Mapping[str, Any], *, fresh: bool) -> None:
        from transformers import FlavaConfig, FlavaModel  # pyright: ignore[reportMissingImports]

        if fresh:
            network: Any = FlavaModel(FlavaConfig(**config))
        else:
            network = _pretrained(FlavaModel.from_pretrained, place)
        super().__init__(place, network)
        _make_room(network.text_model, len(self.tokenizer))

    def longest(self) -> int:
        return int(self.network.config.text_config.max_position_embeddings)

    def forward(self, states: States) -> Tensor:
        device = self.network.logit_scale.device
        side = self.network.config.image_config.image_size
        pixels = _enlarged(states, (side, side), FLAVA_MEAN, FLAVA_DEVIATION, device)
        return self.network(pixel_values=pixels, **self.words(states, device)).multimodal_embeddings[:, 0]


def _make_room(network: Any, words: int) -> None:
    """Word embeddings for the target's token, which the pretrained ones lack."""
    if network.get_input_embeddings().num_embeddings < words:
        network.resize_token_embeddings(words, mean_resizing=False)


def _enlarged(
    states: States, size: tuple[int, int], mean: Sequence[float], deviation: Sequence[float], device: torch.device
) -> Tensor:
    """(N, 3, *size)."""
    images = torch.from_numpy(states.images()).to(device).permute(0, 3, 1, 2).float() / BRIGHTEST
    images = F.interpolate(images, size=size, mode="bilinear", align_corners=False)
    shape = (1, 3, 1, 1)
    return (images - torch.tensor(mean, device=device).view(shape)) / torch.tensor(deviation, device=device).view(shape)


class JointModel(Model):
    """ViLT or FLAVA, trained throughout, with heads for the policy or the value, or both."""

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
        return {"weights": str(self.transformer.place)}
