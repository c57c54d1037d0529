"""A causal language model loaded by the transformers library from a local directory."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lilgym_mp.extras import install
from lilgym_mp.llm.agents import AgentError, Answer, Message


class TransformersAgent:
    """Greedy generation with a model and tokenizer saved in a directory; nothing is downloaded."""

    def __init__(self, directory: str, *, max_new_tokens: int = 256, device: str = "cpu") -> None:
        """Raises AgentError without the library or for a directory without a model."""
        try:
            import transformers  # pyright: ignore[reportMissingImports]
        except ImportError:
            message = f'the agent "transformers" needs the library: {install("transformers")}'
            raise AgentError(message) from None
        library: Any = transformers
        if not Path(directory).is_dir():
            raise AgentError(f"{directory}: no such directory; save a model and its tokenizer there first")
        try:
            self._tokenizer: Any = library.AutoTokenizer.from_pretrained(directory, local_files_only=True)
            model: Any = library.AutoModelForCausalLM.from_pretrained(
                directory, local_files_only=True, use_safetensors=True
            )
        except (OSError, ValueError) as error:
            raise AgentError(f"{directory}: {error}") from None
        self._model: Any = model.to(device).eval()
        self._device = device
        self._max_new_tokens = int(max_new_tokens)

    def answer(self, messages: Sequence[Message]) -> Answer:
        prompt = self._prompt(messages)
        tokens = self._tokenizer(prompt, return_tensors="pt").to(self._device)
        count = int(tokens["input_ids"].shape[1])
        end = self._tokenizer.eos_token_id
        generated = self._model.generate(
            input_ids=tokens["input_ids"],
            attention_mask=tokens["attention_mask"],
            max_new_tokens=self._max_new_tokens,
            do_sample=False,
            pad_token_id=self._tokenizer.pad_token_id if self._tokenizer.pad_token_id is not None else end,
        )[0, count:]
        text = self._tokenizer.decode(generated, skip_special_tokens=True)
        return Answer(text, count, int(generated.shape[0]))

    def _prompt(self, messages: Sequence[Message]) -> str:
        """The tokenizer's chat template applied to the messages; without one, the messages concatenated."""
        if getattr(self._tokenizer, "chat_template", None):
            return self._tokenizer.apply_chat_template(list(messages), tokenize=False, add_generation_prompt=True)
        lines = [f"{message['role']}: {message['content']}" for message in messages]
        return "\n\n".join([*lines, "assistant:"])
