"""A language model, or one that sees pictures, loaded by the transformers library from a local directory."""

from __future__ import annotations

import base64
import io
import threading
import time
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from PIL import Image

from lilgym_mp.contrib.llm.agents import Answer, Message, ModelError, described
from lilgym_mp.corpus.extras import install
from lilgym_mp.wrappers.replies import CUT

GATHERING_SECONDS = 0.01  # before a batch is generated, for the requests of other threads


class TransformersAgent:
    """Greedy generation with a model and tokenizer or processor saved in a directory; nothing is downloaded.

    Requests of several threads are answered in batches.
    """

    concurrency = 8

    def __init__(self, directory: str, *, max_new_tokens: int = 256, device: str = "cpu", batch: int = 8) -> None:
        """`batch`: most requests generated together. Raises ModelError without the library or for a directory without
        a model."""
        try:
            import transformers  # pyright: ignore[reportMissingImports]
        except ImportError:
            message = f'the agent "transformers" needs the library: {install("transformers")}'
            raise ModelError(message) from None
        library: Any = transformers
        if not Path(directory).is_dir():
            raise ModelError(f"{directory}: no such directory; save a model and its tokenizer there first")
        local = {"local_files_only": True}
        try:
            self._reader: Any = library.AutoProcessor.from_pretrained(directory, **local)  # or the tokenizer
            self._sees = hasattr(self._reader, "image_processor")
            loader = library.AutoModelForImageTextToText if self._sees else library.AutoModelForCausalLM
            model: Any = loader.from_pretrained(directory, use_safetensors=True, **local)
        except (OSError, ValueError) as error:
            raise ModelError(f"{directory}: {error}") from None
        if not getattr(self._reader, "chat_template", None):
            raise ModelError(f"{directory}: the tokenizer has no chat template")
        self._model: Any = model.to(device).eval()
        self._tokenizer: Any = self._reader.tokenizer if self._sees else self._reader
        self._tokenizer.padding_side = "left"
        if self._tokenizer.pad_token is None:
            self._tokenizer.pad_token = self._tokenizer.eos_token
        ends = self._model.generation_config.eos_token_id
        self._ends = {self._tokenizer.eos_token_id, *(ends if isinstance(ends, list) else [ends])} - {None}
        self._max_new_tokens = int(max_new_tokens)
        self._batch = int(batch)
        self._waiting: deque[tuple[Sequence[Message], Future[Answer]]] = deque()
        self._lock = threading.Lock()

    def answer(self, messages: Sequence[Message]) -> Answer:
        """The model's reply, generated together with requests of other threads that wait at the same time."""
        future = Future[Answer]()
        self._waiting.append((messages, future))
        while not future.done():
            with self._lock:
                if not future.done():
                    time.sleep(GATHERING_SECONDS)
                    self._answer_together(
                        [self._waiting.popleft() for _ in range(min(self._batch, len(self._waiting)))]
                    )
        return future.result()

    def _answer_together(self, requests: Sequence[tuple[Sequence[Message], Future[Answer]]]) -> None:
        try:
            answers = self._answers([messages for messages, _ in requests])
            for (_, future), answer in zip(requests, answers, strict=True):
                future.set_result(answer)
        except Exception as error:
            for _, future in requests:
                future.set_exception(error if isinstance(error, ModelError) else ModelError(described(error)))

    def _answers(self, conversations: Sequence[Sequence[Message]]) -> list[Answer]:
        given = [list(map(self._readable, messages)) for messages in conversations]
        texts = [
            self._reader.apply_chat_template(messages, tokenize=False, add_generation_prompt=True) for messages in given
        ]
        pictures: dict[str, Any] = {}
        if self._sees:
            parts = [[part for message in messages for part in message["content"]] for messages in given]
            images = [[part["image"] for part in each if part["type"] == "image"] for each in parts]
            pictures = {"images": images} if any(images) else {}
        inputs = self._reader(  # the template has written the special tokens
            text=texts, **pictures, padding=True, add_special_tokens=False, return_tensors="pt"
        ).to(self._model.device)
        generated = self._model.generate(
            **inputs,
            max_new_tokens=self._max_new_tokens,
            do_sample=False,
            pad_token_id=self._tokenizer.pad_token_id,
        )[:, inputs["input_ids"].shape[1] :]
        counts = inputs["attention_mask"].sum(1).tolist()
        return [self._answer(count, row) for count, row in zip(counts, generated.tolist(), strict=True)]

    def _answer(self, prompt_tokens: int, tokens: list[int]) -> Answer:
        """Up to the first end, without which it is cut; other special tokens may be tags of thoughts, and are kept."""
        length = next((index for index, token in enumerate(tokens) if token in self._ends), len(tokens))
        text = self._tokenizer.decode(tokens[:length], skip_special_tokens=False)
        problem = CUT if length == len(tokens) else None
        return Answer(text, prompt_tokens, min(length + 1, len(tokens)), problem=problem)

    def _readable(self, message: Message) -> Message:
        """The message with pictures in the library's form. Raises ModelError for a model that does not see."""
        parts = message["content"]
        if isinstance(parts, str):
            return {**message, "content": [{"type": "text", "text": parts}]} if self._sees else message
        if not self._sees:
            raise ModelError("the model in the directory reads no pictures; choose --scene list")
        return {**message, "content": [part if part["type"] == "text" else _image(part) for part in parts]}


def _image(part: dict[str, Any]) -> dict[str, Any]:
    data = part["image_url"]["url"].partition(",")[2]
    return {"type": "image", "image": Image.open(io.BytesIO(base64.b64decode(data)))}
