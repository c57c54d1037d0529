"""The actions of Tower by index: STOP, the ADDs by box and colour, the REMOVEs by box."""

from __future__ import annotations

from lilgym_mp.scene import BOX_COUNT, Colour
from lilgym_mp.scene.actions import STOP, AddBlock, RemoveBlock, Stop, TowerAction
from lilgym_mp.scene.appearances.base import ArrayForm

ACTIONS: tuple[TowerAction, ...] = (
    STOP,
    *(AddBlock(box, colour) for box in range(BOX_COUNT) for colour in Colour),
    *(RemoveBlock(box) for box in range(BOX_COUNT)),
)
ARRAY_FORM = ArrayForm("tower", {"box": range(BOX_COUNT), "colour": tuple(Colour)}, (Stop, AddBlock, RemoveBlock))
INDICES = {action: index for index, action in enumerate(ACTIONS)}
