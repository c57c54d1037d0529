"""The actor-critic network: patches, the order of its logits, and its inputs."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from actor_critic import ActorCritic, FiLM, patches_of

from lilgym_mp.appearances import Scatter, Tower, make_appearance
from lilgym_mp.render import draw
from tests.scenes import B, K, circle, scene, square, tower

VOCABULARY = 12


def network(appearance: Tower | Scatter | None = None) -> ActorCritic:
    torch.manual_seed(0)
    return ActorCritic(appearance or Tower(), VOCABULARY).eval()


def images(*scenes: object) -> torch.Tensor:
    return torch.from_numpy(np.stack([draw(one, "half") for one in scenes]))  # pyright: ignore[reportArgumentType]


def words(count: int = 1) -> torch.Tensor:
    return torch.tensor([[2, 3, 4, 0, 0]] * count)


def test_patches__are_in_row_major_order():
    picture = images(scene(tower(B), [circle(0, 0)], [square(61, 33)]))
    patches = patches_of(picture)
    assert patches.shape == (1, 3, 25, 300)
    middle_box = picture[0, :, 70:120] / 255
    assert torch.allclose(patches[0, 1, 7].view(10, 10, 3), middle_box[10:20, 20:30])


@pytest.mark.parametrize("grid", [(19, 5), (38, 10), (19, 1), (95, 5)])
def test_network__has_a_logit_for_every_action(grid: tuple[int, int]):
    appearance = make_appearance("scatter", grid)
    prediction = ActorCritic(appearance, VOCABULARY)(images(scene(), scene()), words(2), torch.tensor([1, 0]))
    assert prediction.logits.shape == (2, appearance.action_count)
    assert prediction.values.shape == (2,)


def test_network__starts_nearly_uniform_with_bounded_values():
    prediction = network(Scatter())(images(scene([circle(3, 3)])), words(), torch.tensor([1]))
    probabilities = prediction.logits.softmax(1)
    assert probabilities.max() < 3 * probabilities.min()
    assert prediction.values.abs() < 1


def test_grid_head__an_item_affects_its_own_cell_most():
    appearance = Scatter()
    net = network(appearance)
    with torch.no_grad():
        empty = net(images(scene()), words(), torch.tensor([1])).logits[0]
        seen = net(images(scene((), [square(40, 60, colour=K)])), words(), torch.tensor([1])).logits[0]
    change = (seen - empty)[appearance.action_count - 95 :].view(19, 5)  # REMOVE, by column and row
    change = (change - change[5, 0]).abs()  # column 5 is on a separator and depends on the trunk only
    assert divmod(int(change.argmax()), 5) == (7 + 40 // 20, 60 // 20)


@pytest.mark.parametrize("other", ["statement", "target", "image"])
def test_network__depends_on_every_input(other: str):
    net = network()
    seen = {"statement": words(), "target": torch.tensor([1]), "image": images(scene())}
    changed = {"statement": words() + 1, "target": torch.tensor([0]), "image": images(scene(tower(B)))}
    with torch.no_grad():
        before = net(seen["image"], seen["statement"], seen["target"]).logits
        seen[other] = changed[other]
        after = net(seen["image"], seen["statement"], seen["target"]).logits
    assert not torch.allclose(before, after, atol=1e-6)


def test_network__is_invariant_to_padding():
    net = network()
    longer = torch.tensor([[2, 3, 4, 0, 0, 0, 0]])
    with torch.no_grad():
        short = net(images(scene()), words(), torch.tensor([1])).logits
        long = net(images(scene()), longer, torch.tensor([1])).logits
    assert torch.allclose(short, long, atol=1e-6)


def test_network__rejects_too_many_actions():
    with pytest.raises(ValueError, match=r"1,064,001 actions are too many .* coarser grid"):
        ActorCritic(make_appearance("scatter", "native"), VOCABULARY)


def test_film__with_zero_weights_is_the_identity():
    film = FiLM(4, 3)
    torch.nn.init.zeros_(film.scale_and_shift.weight)
    torch.nn.init.zeros_(film.scale_and_shift.bias)
    features = torch.rand(2, 5, 4)
    assert torch.equal(film(features, torch.rand(2, 3)), features)
