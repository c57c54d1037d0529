"""The likeliest programs of statements, by beam search over prefix tokens."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from lilgym_mp.learning.parsing.network import ParserNetwork, Slots
from lilgym_mp.learning.parsing.pairs import Slot, parts_of


class Candidate(NamedTuple):
    """A whole program."""

    tokens: tuple[int, ...]
    log_probability: float


class _Partial(NamedTuple):
    """The beginning of a program."""

    tokens: tuple[int, ...]
    log_probability: float
    open_slots: tuple[Slot, ...]  # the next one last


@torch.inference_mode()
def beam_search(network: ParserNetwork, words: Sequence[int], width: int) -> list[Candidate]:
    """The likeliest programs of one statement that a beam of that width finds, the likeliest first; may be none."""
    device = network.logits.weight.device
    memories = network.read(torch.tensor([words], device=device))
    caches: list[list[Tensor]] = [[memory.keys[:, :, :0], memory.values[:, :, :0]] for memory in memories]
    partials = [_Partial((), 0.0, (Slot(0, 0),))]
    done: list[Candidate] = []
    for length in range(network.sizes.longest_program):
        before = torch.tensor([[partial.tokens[-1] if partial.tokens else 0] for partial in partials], device=device)
        slots = Slots(
            torch.tensor([[partial.open_slots[-1].parent] for partial in partials], device=device),
            torch.tensor([[partial.open_slots[-1].part] for partial in partials], device=device),
        )
        spread = [memory._replace(**_spread(memory, len(partials))) for memory in memories]
        logits = network.decoded(spread, before, slots, first=length, caches=caches)[:, 0]
        scores = (
            logits.log_softmax(1)
            + torch.tensor([partial.log_probability for partial in partials], device=device)[:, None]
        )
        scores[:, 0] = -torch.inf  # the padding is no token
        values, places = scores.flatten().topk(min(width, scores.numel()))
        rows, tokens = (places // scores.shape[1]).tolist(), (places % scores.shape[1]).tolist()
        grown: list[_Partial] = []
        kept: list[int] = []
        for value, row, token in zip(values.tolist(), rows, tokens, strict=True):
            if value == -float("inf"):
                continue
            partial = partials[row]
            open_slots = (*partial.open_slots[:-1], *parts_of(token))
            if open_slots:
                grown.append(_Partial((*partial.tokens, token), value, open_slots))
                kept.append(row)
            else:
                done.append(Candidate((*partial.tokens, token), value))
        done.sort(key=lambda candidate: -candidate.log_probability)
        best_done = done[width - 1].log_probability if len(done) >= width else -float("inf")
        alive = [index for index, partial in enumerate(grown) if partial.log_probability > best_done]
        if not alive:
            break
        partials = [grown[index] for index in alive]
        order = torch.tensor([kept[index] for index in alive], device=device)
        for cache in caches:
            cache[:] = [part[order] for part in cache]
    return done[:width]


def _spread(memory, count: int):
    return {"keys": memory.keys.expand(count, -1, -1, -1), "values": memory.values.expand(count, -1, -1, -1)}
