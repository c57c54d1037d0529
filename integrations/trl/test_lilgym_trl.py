"""Two GRPO steps of a tiny random model by the script: rewards vary and weights change, in one reply and in turns."""

from __future__ import annotations

import json
import subprocess
import sys
from itertools import islice
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
import transformers
import trl
from lilgym_trl import PlanEnvironment, stream, verified_reward
from safetensors.torch import load_file
from tokenizers import AddedToken, Tokenizer, models, pre_tokenizers

from lilgym_mp.contrib.adapters.trl import with_tools
from lilgym_mp.contrib.rlvr import expert_reply, rows

SPECIAL = ("<|endoftext|>", "<|im_start|>", "<|im_end|>", "[UNK]")
NAMES = ("ADD(LEFT, BLUE)", "ADD(MIDDLE, YELLOW)", "REMOVE(LEFT)", "STOP")
CALL = '<tool_call>\n{{"name": "act", "arguments": {{"action": "{}"}}}}\n</tool_call>'


def save_tiny_model(directory: Path, replies: tuple[str, ...]) -> list[int]:
    """Saves a random model; returns the tokens that it must not generate: all but the replies and the end."""
    vocabulary = {token: index for index, token in enumerate(SPECIAL)}
    for row in islice(rows("plan", "tower", 2), 50):
        for word in row.prompt.split():
            vocabulary.setdefault(word, len(vocabulary))
    backend = Tokenizer(models.WordLevel(vocabulary, unk_token="[UNK]"))
    backend.pre_tokenizer = pre_tokenizers.WhitespaceSplit()
    backend.add_special_tokens([AddedToken(token, special=True) for token in SPECIAL])
    backend.add_tokens([AddedToken(reply, normalized=False) for reply in replies])
    tokenizer = transformers.PreTrainedTokenizerFast(
        tokenizer_object=backend, eos_token="<|im_end|>", pad_token="<|endoftext|>", unk_token="[UNK]"
    )
    tokenizer.chat_template = (Path(trl.__file__).parent / "chat_templates" / "qwen3.jinja").read_text()
    tokenizer.save_pretrained(directory)
    config = transformers.Qwen3Config(
        vocab_size=len(tokenizer), hidden_size=32, intermediate_size=64, num_hidden_layers=2, num_attention_heads=2,
        num_key_value_heads=2, head_dim=16, max_position_embeddings=8_192, eos_token_id=tokenizer.eos_token_id,
        pad_token_id=tokenizer.pad_token_id,
    )  # fmt: skip
    torch.manual_seed(0)
    transformers.Qwen3ForCausalLM(config).save_pretrained(directory)
    kept = {tokenizer.eos_token_id, *tokenizer.convert_tokens_to_ids(list(replies))}
    return [token for token in range(len(tokenizer)) if token not in kept]


@pytest.mark.parametrize("turns", [False, True])
def test_script__changes_the_weights_by_varying_rewards(tmp_path: Path, turns: bool):
    replies = tuple(CALL.format(name) for name in NAMES) if turns else tuple(f"{name}\nSTOP" for name in NAMES)
    suppressed = save_tiny_model(tmp_path, replies)
    options = {"num_generations": 16, "per_device_train_batch_size": 32, "learning_rate": 0.01, "report_to": "none"}
    options |= {"generation_kwargs": {"suppress_tokens": suppressed}, "max_tool_calling_iterations": 3}
    words = f"--model {tmp_path} --level 1 --max-actions 2 --steps 2 --out {tmp_path / 'out'} --max-completion-length"
    words = [*words.split(), "800", "--turns"] if turns else [*words.split(), "3"]
    words += ["--option", *(f"{key}={json.dumps(value)}" for key, value in options.items())]
    script = [sys.executable, str(Path(__file__).with_name("lilgym_trl.py"))]
    done = subprocess.run([*script, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2_000:]
    checkpoint = tmp_path / "out" / "checkpoint-2"
    history = json.loads((checkpoint / "trainer_state.json").read_text())["log_history"]
    assert max(entry.get("reward_std", 0) for entry in history) > 0
    before, after = (load_file(path / "model.safetensors") for path in (tmp_path, checkpoint))
    assert any(not torch.equal(weight, before[name]) for name, weight in after.items())


def test_reward__of_right_wrong_and_odd_completions():
    row = next(rows("plan"))
    data = json.dumps(row.to_json())
    right = [{"role": "assistant", "content": expert_reply(row)}]
    parts = [{"role": "assistant", "content": [{"type": "text", "text": expert_reply(row)}]}]
    ended, cut = ([5, 2], [5, 5])
    assert verified_reward([right, right], [data] * 2, completion_ids=[ended, cut], ends={2}) == [1, 0]
    odd = [[{"role": "assistant"}], [], "", expert_reply(row), parts]
    assert verified_reward([right, *odd], [data] * 6) == [1, 0, 0, 0, 1, 1]


@pytest.mark.parametrize(("vocabulary", "works"), [({"<|im_start|>": 1}, True), ({"hello": 1}, False)])
def test_turns__need_a_chat_template_with_tools_or_chatml(vocabulary: dict[str, int], works: bool):
    tokenizer = SimpleNamespace(chat_template="{{ messages }}", get_vocab=lambda: vocabulary)
    if works:
        assert "tools" in with_tools(tokenizer).chat_template
    else:
        with pytest.raises(SystemExit, match="--turns needs a chat template with tools"):
            with_tools(tokenizer)


def test_stream__has_pictures_and_prompts_for_turns():
    (seen,) = stream(level=1, scene="image").take(1)
    assert [part["type"] for part in seen["prompt"][0]["content"]] == ["image", "text"]
    assert seen["images"][0].size == (380, 100)
    (turn,) = stream(level=1, turns=True).take(1)
    assert turn["prompt"][0]["content"].count(json.loads(turn["row"])["task"]["statement"]) == 1
    (seen,) = stream(level=1, turns=True, scene="image").take(1)
    assert [part["type"] for part in seen["prompt"][0]["content"]] == ["image", "text"]
    environment = PlanEnvironment("image")
    environment.reset(seen["row"])
    assert [part["type"] for part in environment.act("hm")] == ["image", "text"]
    assert environment.act("STOP") == "The episode is over: wrong_stop."
    assert [regret is None or regret >= 0 for regret in environment.regrets] == [True, True]
