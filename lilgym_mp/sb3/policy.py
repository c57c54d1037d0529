"""The network of `lilgym-mp train ppo` as a policy of SB3's PPO and sb3-contrib's MaskablePPO, and its buffer."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from sb3_contrib.common.maskable.buffers import MaskableDictRolloutBuffer, MaskableDictRolloutBufferSamples
from sb3_contrib.common.maskable.policies import MaskableActorCriticPolicy
from torch import Tensor

from lilgym_mp.corpus import Vocabulary
from lilgym_mp.evaluation import Settings
from lilgym_mp.learning.common.box_transformer import BoxTransformer
from lilgym_mp.learning.common.factored_policy import STOP, FactoredPolicy
from lilgym_mp.learning.common.states import BoxImageTable, States
from lilgym_mp.learning.ppo.rollout import policy_and_values
from lilgym_mp.scene.appearances import make_appearance
from lilgym_mp.wrappers.actions import FORCED_NOW

IMAGE, ITEMS, STATEMENT, TARGET = "image", "item_array", "statement", "target"
UNKNOWN_WORD = "unknownword"
MAX_CACHED_BOXES = 100_000


def seeded_generator() -> np.random.Generator:
    """A generator seeded by torch's, which SB3 seeds."""
    return np.random.default_rng(int(torch.randint(2**62, ())))


class LilGymPolicy(MaskableActorCriticPolicy):
    """Sees the image (of half size) or the item array, the statement as token ids, and the target.

    `predict` also takes the text observations of `gymnasium.make`. With "forced" among the observations
    (`make_vec_env(..., stop_forcing=True)`) it takes STOP there while it collects rollouts, with the log-probability
    that it has unforced.
    """

    def __init__(
        self,
        observation_space: spaces.Dict,
        action_space: spaces.Discrete,
        lr_schedule: Any,
        *,
        settings: Mapping[str, Any],
        words: Sequence[str],
        optimizer_kwargs: dict[str, Any] | None = None,
        use_sde: bool = False,
        **kwargs: Any,
    ) -> None:
        """`settings`: `evaluation.Settings.to_json()` of the environment; `words`: of its vocabulary. `use_sde`: as
        PPO passes it, unused. Raises ValueError if the environment's actions or token ids are others."""
        self.settings, self.vocabulary = Settings.from_json(settings), Vocabulary(tuple(words))
        appearance = make_appearance(self.settings.appearance, self.settings.grid)
        found = int(action_space.n), int(observation_space[STATEMENT].high.max()) + 1
        if found != (appearance.action_count, len(self.vocabulary)):
            raise ValueError(
                f"{self.settings.configuration} with these words has {appearance.action_count} actions and"
                f" {len(self.vocabulary)} token ids, but the environment {found[0]} and {found[1]}"
            )
        self._table, self._texts = BoxImageTable(), dict[bytes, str]()
        optimizer_kwargs = {"eps": 1e-5, "fused": True} if optimizer_kwargs is None else optimizer_kwargs
        super().__init__(observation_space, action_space, lr_schedule, optimizer_kwargs=optimizer_kwargs, **kwargs)

    def _build(self, lr_schedule: Any) -> None:
        self.network = BoxTransformer(make_appearance(self.settings.appearance, self.settings.grid), self.vocabulary)
        self.register_buffer("masked", torch.tensor(False))  # whether it was trained with masks
        self.optimizer = self.optimizer_class(self.network.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        names = ("observation_space", "action_space", "optimizer_class", "optimizer_kwargs")
        own = {"settings": self.settings.to_json(), "words": self.vocabulary.words}
        return {"lr_schedule": self._dummy_schedule, **own} | {name: getattr(self, name) for name in names}

    def set_training_mode(self, mode: bool) -> None:
        if mode != self.training:
            self.network.clear_cache()
        super().set_training_mode(mode)

    def load_state_dict(self, state_dict: Mapping[str, Any], *args: Any, **kwargs: Any) -> Any:
        self.network.clear_cache()
        return super().load_state_dict(state_dict, *args, **kwargs)

    def forward(self, obs: Any, deterministic: bool = False, action_masks: Any = None) -> tuple[Tensor, Tensor, Tensor]:
        policy, values = self._decided(obs, action_masks)
        actions = self._chosen(policy, deterministic).to(values.device)
        if FORCED_NOW in obs:
            actions = torch.where(obs[FORCED_NOW].flatten() > 0, STOP, actions)
        return actions, values, policy.log_prob(actions)

    def evaluate_actions(
        self, obs: Any, actions: Tensor, action_masks: Tensor | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        if action_masks is not None and bool(action_masks.all()):  # what buffers hold without masks
            action_masks = None
        self.masked |= action_masks is not None
        policy, values = self._decided(obs, action_masks)
        log_probs, entropies = policy.evaluate_actions(actions)
        return values, log_probs, entropies

    def predict_values(self, obs: Any) -> Tensor:
        return self._decided(obs)[1]

    def _predict(self, observation: Any, deterministic: bool = False, action_masks: Any = None) -> Tensor:
        return self._chosen(self._decided(observation, action_masks)[0], deterministic)

    def _decided(self, observations: Mapping[str, Tensor], action_masks: Any = None) -> tuple[FactoredPolicy, Tensor]:
        """The policy and the values (N, 1)."""
        legal = None if action_masks is None else np.asarray(action_masks, np.bool_).reshape(-1, self.action_space.n)
        policy, values = policy_and_values(self.network, self._states(observations), legal)
        return policy, values[:, None]

    def _chosen(self, policy: FactoredPolicy, deterministic: bool) -> Tensor:
        return torch.from_numpy(policy.greedy() if deterministic else policy.sample(seeded_generator()))

    def _states(self, observations: Mapping[str, Tensor]) -> States:
        if len(self._table) > MAX_CACHED_BOXES:
            self._table, self._texts = BoxImageTable(), {}
        arrays = {name: values.cpu().numpy() for name, values in observations.items()}
        if ITEMS in arrays:
            boxes = self._table.item_indices(arrays[ITEMS].astype(np.int16))
        else:
            images = arrays[IMAGE].astype(np.uint8, copy=False)
            boxes = self._table.indices(images.transpose(0, 2, 3, 1) if images.shape[1] == 3 else images)
        texts = [self._text(row) for row in arrays[STATEMENT].astype(np.int64)]
        return self._table.states_of(texts, boxes, arrays[TARGET].reshape(-1))

    def _text(self, row: Any) -> str:
        """The statement of token ids (L,)."""
        key = row.tobytes()
        if key not in self._texts:
            self._texts[key] = " ".join(self.vocabulary.decode(row)).replace("?", UNKNOWN_WORD)
        return self._texts[key]

    def obs_to_tensor(self, observation: Any) -> tuple[dict[str, Tensor], bool]:
        """The tensors of one observation or a batch, and whether it is a batch."""
        scene = ITEMS if ITEMS in observation else IMAGE
        is_batch, statements = np.ndim(observation[scene]) == 4, observation[STATEMENT]
        if np.asarray(statements).dtype.kind in "OU":
            length = self.observation_space[STATEMENT].shape[0]
            statements = np.stack([self.vocabulary.encode(text, length) for text in np.atleast_1d(statements).tolist()])
        arrays = [np.asarray(observation[scene]), np.atleast_2d(statements), np.reshape(observation[TARGET], (-1, 1))]
        arrays[0] = arrays[0] if is_batch else arrays[0][None]
        named = zip((scene, STATEMENT, TARGET), arrays, strict=True)
        return {name: torch.as_tensor(array, device=self.device) for name, array in named}, is_batch


class StatementRolloutBuffer(MaskableDictRolloutBuffer):
    """Mini-batches have few statements each, which the network reads once. Advantages are divided by their standard
    deviation over the rollout, but not centred (use `normalize_advantage=False`); a forced STOP's is its return."""

    def compute_returns_and_advantage(self, last_values: Tensor, dones: np.ndarray) -> None:
        super().compute_returns_and_advantage(last_values, dones)
        if FORCED_NOW in self.observations:
            forced = self.observations[FORCED_NOW][..., 0] > 0
            self.advantages[forced] = self.returns[forced]
        self.advantages /= self.advantages.std() + 1e-8

    def get(self, batch_size: int | None = None) -> Generator[MaskableDictRolloutBufferSamples, None, None]:
        next(super().get(1))  # flattens the arrays
        count = self.buffer_size * self.n_envs
        size = batch_size or count
        statements = np.unique(self.observations[STATEMENT], axis=0, return_inverse=True)[1].reshape(-1)
        rng = seeded_generator()
        order, ranks = rng.permutation(count), rng.permutation(statements.max() + 1)
        order = order[np.argsort(ranks[statements[order]], kind="stable")]
        for start in rng.permutation(np.arange(0, count, size)):
            yield self._get_samples(order[start : start + size])
