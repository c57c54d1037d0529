"""Types of request fields, bounded so that every valid value can be stored."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, StringConstraints

from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.envs.proposer_verifier import PRESETS, PROTOCOLS
from lilgym_mp.evaluation.settings import CONFIGURATIONS
from lilgym_mp.scene.appearances import APPEARANCES


def storable(text: str) -> str:
    """The text unchanged. Raises ValueError for NUL characters and lone surrogates, which databases reject."""
    if "\0" in text or any("\ud800" <= character <= "\udfff" for character in text):
        raise ValueError("contains a character that cannot be stored")
    return text


Name = Annotated[str, StringConstraints(max_length=200), AfterValidator(storable)]
RandomId = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_-]{1,64}$")]

if TYPE_CHECKING:  # type checkers know no literals made of tables
    AppearanceName = ConfigurationName = PresetName = ProtocolName = SplitName = str
else:
    AppearanceName = Literal[*APPEARANCES]
    ConfigurationName = Literal[*CONFIGURATIONS]
    PresetName = Literal[*PRESETS]
    ProtocolName = Literal[*PROTOCOLS]
    SplitName = Literal[*SPLITS]
