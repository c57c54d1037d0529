"""Beam search over prefix tokens for the most probable programs of a statement."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from lilgym_mp.learning.parsing.network import ParserNetwork, Slots
from lilgym_mp.learning.parsing.pairs import Slot, open_slots_of
from lilgym_mp.learning.parsing.symbols import TOKENS, TokenTable


class Candidate(NamedTuple):
    """A complete program."""

    tokens: tuple[int, ...]
    log_probability: float


class _Partial(NamedTuple):
    """A hypothesis: the first tokens of a program."""

    tokens: tuple[int, ...]
    log_probability: float
    open_slots: tuple[Slot, ...]  # a stack; the next one is last


@torch.inference_mode()
def beam_search(
    network: ParserNetwork, words: Sequence[int], width: int, table: TokenTable = TOKENS
) -> list[Candidate]:
    """At most `width` programs of one statement, the most probable first; may be empty."""
    device = network.logits.weight.device
    memories = network.encode(torch.tensor([words], device=device))
    caches: list[list[Tensor]] = [[memory.keys[:, :, :0], memory.values[:, :, :0]] for memory in memories]
    partials = [_Partial((), 0.0, (Slot(0, 0),))]
    done: list[Candidate] = []
    for length in range(network.sizes.longest_program):
        before = torch.tensor([[partial.tokens[-1] if partial.tokens else 0] for partial in partials], device=device)
        slots = Slots(
            torch.tensor([[partial.open_slots[-1].parent] for partial in partials], device=device),
            torch.tensor([[partial.open_slots[-1].argument] for partial in partials], device=device),
        )
        expanded = [memory.expanded(len(partials)) for memory in memories]
        logits = network.decode(expanded, before, slots, first=length, caches=caches)[:, 0]
        scores = (
            logits.log_softmax(1)
            + torch.tensor([partial.log_probability for partial in partials], device=device)[:, None]
        )
        scores[:, 0] = -torch.inf  # padding is not a token
        values, indices = scores.flatten().topk(min(width, scores.numel()))
        rows, tokens = (indices // scores.shape[1]).tolist(), (indices % scores.shape[1]).tolist()
        grown: list[_Partial] = []
        kept: list[int] = []
        for value, row, token in zip(values.tolist(), rows, tokens, strict=True):
            if value == -float("inf"):
                continue
            partial = partials[row]
            open_slots = (*partial.open_slots[:-1], *open_slots_of(token, table))
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
