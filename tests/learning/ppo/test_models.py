"""PPO's models: deduplicated states, caches, pretrained weights and unusable directories."""

import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from lilgym_mp.corpus import Vocabulary
from lilgym_mp.evaluation import Settings, evaluate
from lilgym_mp.learning.common.agents import open_agent
from lilgym_mp.learning.common.box_transformer import BoxTransformer
from lilgym_mp.learning.common.model import WeightsError
from lilgym_mp.learning.common.states import BoxImageTable
from lilgym_mp.learning.ppo.agent import make_model
from lilgym_mp.learning.ppo.learner import PPORecipe
from lilgym_mp.learning.ppo.pretrained import C3, C10, ConvolutionsAndBert, scene_images
from lilgym_mp.learning.ppo.training import train_ppo
from lilgym_mp.scene.appearances import Scatter, Tower, make_appearance

assert_close = partial(torch.testing.assert_close, atol=1e-5, rtol=1e-4)
STATEMENTS = ("There is a blue block.", "All of it is black.", "Two towers.")


def seen(name="TowerFlipIt", count=6):
    """States of start scenes and their images."""
    env = Settings(name).make_batch("train", count)
    observations, _ = env.reset(seed=0)
    table = BoxImageTable()
    boxes_of = table.indices(observations["image"])
    statement_of = np.arange(count) % len(STATEMENTS)
    states = table.states(STATEMENTS, statement_of, boxes_of, observations["target"].astype(np.int64))
    return states, observations["image"].copy()


@pytest.mark.parametrize("name", ["TowerFlipIt", "ScatterFlipIt"])
@pytest.mark.long
def test_states__reconstruct_the_images_from_distinct_boxes_and_patches(name):
    states, images = seen(name, 40)
    scenes, scene_of = states.scenes()
    distinct = scene_images(states, scenes)
    assert (distinct[scene_of] == images).all()
    assert len(np.unique(distinct.reshape(len(distinct), -1), axis=0)) == len(distinct)
    for rows in (states.boxes().reshape(len(states.box_hashes), -1), states.patches):
        assert len(np.unique(rows, axis=0)) == len(rows)


@pytest.fixture
def ours():
    torch.manual_seed(0)
    return BoxTransformer(Tower(), Vocabulary.from_statements(STATEMENTS))


def test_ours__cached_boxes_equal_new_ones_until_the_cache_is_cleared(ours):
    states, images = seen(count=40)
    first = BoxImageTable()
    with torch.no_grad():
        ours(first.states(STATEMENTS, states.statement_of[:5], first.indices(images[:5]), states.targets[:5]))
        remembered = ours(states)
    assert_close(remembered.values, ours(states).values)
    with torch.no_grad():
        for weight in ours.boxes.parameters():
            weight.mul_(1.5)
        ours.clear_cache()
        renewed = ours(states)
    assert_close(renewed.values, ours(states).values)
    assert not torch.allclose(remembered.values, renewed.values, atol=1e-3)


def flat(found):
    return [found.types, found.values, *found.heads]


def test_ours__prediction_is_independent_of_the_rest_of_the_batch(ours):
    states, images = seen(count=6)
    together = ours(states)
    for row in range(6):
        table = BoxImageTable()
        alone = ours(
            table.states(STATEMENTS, states.statement_of[[row]], table.indices(images[[row]]), states.targets[[row]])
        )
        for one, all_of_it in zip(flat(alone), flat(together), strict=True):
            assert_close(one[0], all_of_it[row])


@pytest.mark.parametrize(("appearance", "separators"), [(Tower(), False), (Scatter(), False), (Scatter(), True)])
def test_ours__every_parameter_has_a_gradient(appearance, separators):
    model = BoxTransformer(appearance, Vocabulary.from_statements(STATEMENTS), separators=separators)
    found = model(seen(f"{appearance.name.title()}FlipIt")[0])
    sum(part.square().sum() for part in flat(found)).backward()
    assert [name for name, weight in model.named_parameters() if weight.grad is None] == []


def test_ours__depends_on_statement_target_and_every_box(ours):
    states, _ = seen()

    def types(changed):
        return ours(changed).types[0].detach()

    before = types(states)
    assert not torch.allclose(before, types(states._replace(targets=1 - states.targets)))
    assert not torch.allclose(before, types(states._replace(statements=STATEMENTS[::-1])))
    other = states.patches_of.copy()
    other[states.boxes_of[0, 2]] = 0
    assert not torch.allclose(before, types(states._replace(patches_of=other)))


@pytest.mark.parametrize("critic", ["separate", "shared"])
def test_critic__shares_weights_only_if_shared(critic):
    model = make_model(PPORecipe.of("TowerFlipIt", critic=critic), Tower(), statements=STATEMENTS)
    model(seen()[0]).values.sum().backward()
    touched = {name.partition(".")[0] for name, weight in model.named_parameters() if weight.grad is not None}
    assert (touched == {"critic"}) == (critic == "separate")


# Pretrained


@pytest.mark.parametrize(("layers", "configuration"), [(C3, "TowerFlipIt"), (C10, "ScatterFlipIt")])
@pytest.mark.long
def test_windows__give_the_features_and_gradients_of_whole_images(layers, configuration, monkeypatch):
    encoder = SimpleNamespace(width=4, vectors=lambda statements, device: torch.zeros(len(statements), 4))
    torch.manual_seed(0)
    appearance = Tower() if configuration == "TowerFlipIt" else Scatter()
    model = ConvolutionsAndBert(encoder, layers, appearance, has_actor=False, has_critic=True)
    for most_scenes, count in ((9_999, 3), (9_999, 20), (9_999, 40), (0, 30)):  # whole images; a growing, a new table
        monkeypatch.setattr("lilgym_mp.learning.ppo.pretrained.MOST_SCENES", most_scenes)
        states, _ = seen(configuration, count)
        windows, *others = model.inputs(states)
        assert (len(windows) > 1) == (count > 3)
        images = [torch.from_numpy(scene_images(states, states.scenes()[0]))]
        found = []
        for shown in (windows, images):
            model.zero_grad()
            values = model((shown, *others)).values
            (values * torch.arange(count)).sum().backward()
            found.append(
                [values.detach(), *(p.grad.clone() for p in model.convolutions.parameters() if p.grad is not None)]
            )
        assert len(found[0]) == 1 + len(list(model.convolutions.parameters()))
        for ours, theirs in zip(*found, strict=True):
            assert_close(ours, theirs, rtol=1e-3)


VOCABULARY = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "there", "is", "a", "blue", "block", "all", "true", "false", "."]
TINY = {"hidden_size": 16, "num_hidden_layers": 2, "num_attention_heads": 2, "intermediate_size": 16}


def write_tokenizer(place):
    from tokenizers import Tokenizer, models, normalizers, pre_tokenizers, processors
    from transformers import PreTrainedTokenizerFast

    words = {word: number for number, word in enumerate(VOCABULARY)}
    tokenizer = Tokenizer(models.WordPiece(words, unk_token="[UNK]"))
    tokenizer.normalizer = normalizers.BertNormalizer(lowercase=True)
    tokenizer.pre_tokenizer = pre_tokenizers.BertPreTokenizer()
    tokenizer.post_processor = processors.BertProcessing(("[SEP]", 3), ("[CLS]", 2))
    special = {"unk_token": "[UNK]", "cls_token": "[CLS]", "sep_token": "[SEP]", "pad_token": "[PAD]"}
    PreTrainedTokenizerFast(tokenizer_object=tokenizer, **special).save_pretrained(place)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """Weight directories of tiny random networks, by architecture."""
    transformers = pytest.importorskip("transformers")
    torch.manual_seed(0)
    size = len(VOCABULARY)
    vision = {**TINY, "image_size": 32, "patch_size": 16}
    vilt = transformers.ViltConfig(vocab_size=size, max_position_embeddings=20, **{**vision, "image_size": 64})
    networks = {
        "bert": transformers.BertModel(transformers.BertConfig(vocab_size=size, **TINY)),
        "vilt": transformers.ViltModel(vilt),
        "flava": transformers.FlavaModel(
            transformers.FlavaConfig(
                text_config={**TINY, "vocab_size": size, "max_position_embeddings": 20},
                image_config=vision,
                multimodal_config=TINY,
                hidden_size=16,
                projection_dim=16,
            )
        ),
    }
    places = {}
    for name, network in networks.items():
        places[name] = tmp_path_factory.mktemp("weights") / name
        network.save_pretrained(places[name])
        write_tokenizer(places[name])
    return places


SHORT = {
    "envs": 2,
    "same_statement": 1,
    "rollout": 8,
    "batch_size": 8,
    "epochs": 1,
    "held_out": 0.0,
    "patience": 0,
}


@pytest.mark.parametrize(
    ("model", "critic"), [("c3-bert", "separate"), ("c10-bert", "shared"), ("vilt", "shared"), ("flava", "separate")]
)
def test_pretrained__trained_agent_is_saved_and_reloaded(tmp_path, own, tiny, model, critic):
    settings = Settings("TowerFlipIt", corpus=own, horizon=3)
    recipe = PPORecipe.of("TowerFlipIt", "paper", model=model, critic=critic, stop_forcing=True, microbatch=3, **SHORT)
    weights = tiny[model if model in tiny else "bert"]
    agent = train_ppo(settings, recipe, tmp_path, steps=8, weights=weights, device="cpu")
    assert agent.description.supervision.endswith("no mask of legal actions; pretrained weights")
    again = open_agent(tmp_path, "cpu")
    played = [evaluate(each.policy(settings), settings, "dev") for each in (agent, again)]
    assert played[0] == played[1]
    train_ppo(settings, recipe, tmp_path, steps=16, weights=weights, device="cpu", resume=True)


@pytest.mark.parametrize("capability", ["AVX2", "AVX512"])
def test_pretrained__is_trained_in_bfloat16_on_cpus_with_avx512(tmp_path, own, tiny, monkeypatch, capability):
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: capability)
    weights = []
    for reduced in (False, True):
        recipe = PPORecipe.of("TowerScratch", "paper", model="c3-bert", reduced_precision=reduced, **SHORT)
        settings, out = Settings("TowerScratch", corpus=own), tmp_path / str(reduced)
        train_ppo(settings, recipe, out, steps=8, weights=tiny["bert"], device="cpu")
        weights.append(load_file(out / "agent.safetensors")["actor.image.weight"])
    assert torch.equal(*weights) == (capability == "AVX2")


@pytest.mark.parametrize(("name", "millions"), [("c3-bert", 2.59), ("c10-bert", 3.05)])
def test_convolutions_and_bert__have_the_documented_parameter_counts_at_full_size(tiny, name, millions):
    recipe = PPORecipe.of("TowerScratch", "release", model=name)
    model = make_model(recipe, Tower(), weights=tiny["bert"])
    width, full = 16, 768
    at_full_size = model.trained_parameters + 2 * 512 * (full - width)  # the statement joins two layers of 512
    assert round(at_full_size / 1e6, 2) == millions
    assert model.frozen_parameters > 0
    assert not any("encoder" in name for name in model.state_dict())


def test_frozen_bert__averages_layers_and_word_pieces(tiny):
    from transformers import BertModel

    from lilgym_mp.learning.ppo.pretrained import FrozenBert

    encoder = FrozenBert(tiny["bert"])
    found = encoder.vectors(["There is a block.", "blue"], torch.device("cpu"))
    network = BertModel.from_pretrained(tiny["bert"]).eval()
    numbers = [VOCABULARY.index(word) for word in ("[CLS]", "blue", "[SEP]")]
    with torch.no_grad():
        layers = network(torch.tensor([numbers]), output_hidden_states=True).hidden_states
    assert len(layers) == 3
    assert_close(found[1], torch.stack(layers).mean(0)[0, 1])
    assert not found.requires_grad


def test_vilt__depends_on_the_target_and_trains_its_token_embedding(tiny):
    recipe = PPORecipe.of("TowerScratch", "release", model="vilt")
    model = make_model(recipe, make_appearance("tower"), weights=tiny["vilt"]).eval()
    states, _ = seen(count=2)
    found = model(states)
    with torch.no_grad():
        assert not torch.allclose(found.types, model(states._replace(targets=1 - states.targets)).types)
    found.types.square().sum().backward()
    embeddings = model.get_submodule("actor.transformer.network").get_input_embeddings().weight
    assert embeddings.grad[len(VOCABULARY)].abs().sum() > 0


@pytest.mark.parametrize(
    ("damage", "fault"),
    {
        "none": "needs pretrained weights: name a directory with --weights, of the architecture bert",
        "nowhere": "not a directory of weights: it does not exist",
        "other": r"config\.json: architecture 'vilt'; the model 'c3-bert' needs bert",
        "bad config": r"config\.json: cannot be read",
        "pickle": r"cannot be loaded: .*model\.safetensors",
        "no tokenizer": "cannot be loaded",
        "cut": "cannot be loaded|is damaged",
        "few tensors": r"incomplete: \d+ tensors are missing, such as embeddings",
    }.items(),
)
def test_weights__unusable_directories_are_rejected_with_the_reason(tmp_path, tiny, damage, fault):
    from safetensors.torch import save_file

    place = tmp_path / "weights"
    shutil.copytree(tiny["vilt" if damage == "other" else "bert"], place)
    tensors, config = place / "model.safetensors", place / "config.json"
    if damage == "bad config":
        config.write_text("{")
    elif damage == "pickle":
        tensors.rename(place / "pytorch_model.bin")
    elif damage == "no tokenizer":
        (place / "tokenizer.json").unlink()
    elif damage == "cut":
        tensors.write_bytes(tensors.read_bytes()[:100])
    elif damage == "few tensors":
        kept = {name: tensor for name, tensor in load_file(tensors).items() if "embeddings" not in name}
        save_file(kept, tensors, {"format": "pt"})
    named = {"none": None, "nowhere": tmp_path / "nowhere"}.get(damage, place)
    with pytest.raises(WeightsError, match=fault):
        make_model(PPORecipe.of("TowerScratch", "paper", model="c3-bert"), Tower(), weights=named)


def test_weights__changed_since_training_are_rejected(tmp_path, own, tiny):
    place = tmp_path / "weights"
    shutil.copytree(tiny["bert"], place)
    recipe = PPORecipe.of("TowerScratch", "paper", model="c3-bert", **SHORT)
    train_ppo(Settings("TowerScratch", corpus=own), recipe, tmp_path / "run", steps=8, weights=place, device="cpu")
    (place / "more.safetensors").write_bytes(b"")
    with (place / "model.safetensors").open("ab") as file:
        file.write(b"0")
    with pytest.raises(ValueError, match=r"cannot be loaded|is damaged|not the weights that the agent"):
        open_agent(tmp_path / "run", "cpu")
    shutil.rmtree(place)
    with pytest.raises(ValueError, match="it does not exist"):
        open_agent(tmp_path / "run", "cpu")


def test_weights__are_rejected_by_ours():
    with pytest.raises(WeightsError, match="'ours' has no pretrained weights; leave --weights out"):
        make_model(replace(PPORecipe.of("TowerScratch")), Tower(), weights=Path("somewhere"))
