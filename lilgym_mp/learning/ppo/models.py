"""Models by name."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from lilgym_mp.corpus import Vocabulary
from lilgym_mp.learning.common.box_transformer import BoxTransformer
from lilgym_mp.learning.common.factored_policy import MAX_ACTIONS
from lilgym_mp.learning.common.model import Model, SeparateCritic, WeightsError
from lilgym_mp.learning.common.model_file import check_sizes
from lilgym_mp.learning.ppo.recipe import TRANSFORMERS, PPORecipe
from lilgym_mp.scene.appearances import Appearance

PRETRAINED = "lilgym_mp.contrib.pretrained"  # module of the paper's models, imported when one is used
Make = Callable[[bool, bool], Model]  # called with has_actor and has_critic


def make_model(
    recipe: PPORecipe,
    appearance: Appearance,
    *,
    statements: Iterable[str] = (),
    weights: Path | None = None,
    details: Mapping[str, Any] | None = None,
) -> Model:
    """A new model with the vocabulary of `statements`, or with `details` the one described by a model file.

    Raises WeightsError for an unusable directory of weights, ValueError for an appearance with too many actions.
    """
    if appearance.action_count > MAX_ACTIONS:
        raise ValueError(
            f"{appearance.action_count:,} actions are too many for a flat policy, which takes at most {MAX_ACTIONS:,};"
            " choose a coarser grid"
        )
    if recipe.model in TRANSFORMERS:
        make = import_module(PRETRAINED).model_maker(recipe.model, appearance, weights, details)
    else:
        if weights is not None:
            raise WeightsError(f"the model {recipe.model!r} has no pretrained weights; leave --weights out")
        make = _box_transformer(recipe, appearance, statements, details)
    if recipe.critic == "separate":
        return SeparateCritic(make(True, False), make(False, True))
    return make(True, True)


def _box_transformer(
    recipe: PPORecipe, appearance: Appearance, statements: Iterable[str], details: Mapping[str, Any] | None
) -> Make:
    words = Vocabulary.from_statements(statements) if details is None else Vocabulary(tuple(details["words"]))
    sizes = {} if details is None else dict(details["sizes"])
    if details is not None:
        check_sizes(sizes)
    separators = recipe.model == "ours-separators"
    return lambda has_actor, has_critic: BoxTransformer(appearance, words, separators=separators, **sizes)
