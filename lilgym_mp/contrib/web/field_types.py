"""Types of request fields, bounded so that every valid value can be stored."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from fastapi import Query
from pydantic import AfterValidator, BaseModel, StringConstraints

from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.envs.proposer_verifier import PRESETS, PROTOCOLS
from lilgym_mp.envs.rules import RULE_SETS
from lilgym_mp.evaluation.runs import FINAL_OUTCOMES
from lilgym_mp.evaluation.settings import CONFIGURATIONS
from lilgym_mp.scene import Colour, Shape, Size
from lilgym_mp.scene.actions import Action, AddItem
from lilgym_mp.scene.appearances import APPEARANCES


def storable(text: str) -> str:
    """The text unchanged. Raises ValueError for NUL characters and lone surrogates, which databases reject."""
    if "\0" in text or any("\ud800" <= character <= "\udfff" for character in text):
        raise ValueError("contains a character that cannot be stored")
    return text


Name = Annotated[str, StringConstraints(max_length=200), AfterValidator(storable)]
ShortText = Annotated[str, StringConstraints(max_length=2_000), AfterValidator(storable)]
RandomId = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_-]{1,64}$")]

if TYPE_CHECKING:  # type checkers know no literals made of tables
    AppearanceName = ColourName = ConfigurationName = OutcomeName = PresetName = str
    ProtocolName = RulesName = ShapeName = SizeName = SplitName = str
else:
    AppearanceName = Literal[*APPEARANCES]
    ColourName = Literal[*Colour.__members__]
    ConfigurationName = Literal[*CONFIGURATIONS]
    OutcomeName = Literal[*FINAL_OUTCOMES]
    PresetName = Literal[*PRESETS]
    ProtocolName = Literal[*PROTOCOLS]
    RulesName = Literal[*RULE_SETS]
    ShapeName = Literal[*Shape.__members__]
    SizeName = Literal[*Size.__members__]
    SplitName = Literal[*SPLITS]


class ItemType(BaseModel):
    """Attributes of the items whose ADDs are wanted; None: any."""

    shape: ShapeName | None = None
    colour: ColourName | None = None
    size: SizeName | None = None

    def matches(self, action: Action) -> bool:
        """Whether the action adds an item of that type, or is no ADD of an item."""
        return not isinstance(action, AddItem) or all(
            wanted in (None, getattr(action, name).name) for name, wanted in self
        )


ItemTypeQuery = Annotated[ItemType, Query()]
