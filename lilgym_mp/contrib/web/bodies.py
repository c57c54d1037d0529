"""Field types of requests, parts of responses shared by several pages, and PNG images of scenes."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from PIL import Image
from pydantic import StringConstraints

from lilgym_mp.corpus.records import SPLITS
from lilgym_mp.envs.proposer_verifier import PRESETS, PROTOCOLS
from lilgym_mp.envs.rules import Dynamics
from lilgym_mp.evaluation import CONFIGURATIONS
from lilgym_mp.evaluation.episodes import scenes
from lilgym_mp.programs.tracing import BOX_TITLES, item_text, trace
from lilgym_mp.scene import BOX_PITCH, Item, Scene
from lilgym_mp.scene.actions import Action, ActionType, describe
from lilgym_mp.scene.appearances import APPEARANCES
from lilgym_mp.scene.appearances.base import action_arrays
from lilgym_mp.scene.render.frames import smooth_picture

IMAGE_CACHE_SIZE = 2_000
SCALE = 2  # 760 x 200 pixels
COMPRESSION = 3  # zlib level; higher levels take longer than sending the bytes they save

JSON = dict[str, Any]
"""Part of a response."""


Name = Annotated[str, StringConstraints(max_length=200)]
RandomId = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_-]{1,64}$")]

if TYPE_CHECKING:  # type checkers know no literals made of tables
    AppearanceName = ConfigurationName = PresetName = ProtocolName = SplitName = str
else:
    AppearanceName = Literal[*APPEARANCES]
    ConfigurationName = Literal[*CONFIGURATIONS]
    PresetName = Literal[*PRESETS]
    ProtocolName = Literal[*PROTOCOLS]
    SplitName = Literal[*SPLITS]


def pick(source: object, *names: str) -> JSON:
    """The attributes of these names."""
    return {name: getattr(source, name) for name in names}


def parts_body(source: str, scene: Scene, step_limit: int | None = None) -> list[JSON]:
    """The subexpressions of a program with their values, and the items (box, index) in each value."""
    return [part._asdict() for part in trace(source, scene, step_limit)]


@lru_cache(IMAGE_CACHE_SIZE)
def png(scene: Scene) -> bytes:
    """The scene at twice its native size, antialiased, with the look of the films, as a PNG file."""
    buffer = io.BytesIO()
    Image.fromarray(smooth_picture(scene, SCALE)).save(buffer, "PNG", compress_level=COMPRESSION)
    return buffer.getvalue()


def scene_body(scene: Scene) -> JSON:
    """`picture` is a data URL: a PNG at twice the native size of 380 x 100 pixels."""
    items = [
        _item_body(box, index, item)
        for box, content in enumerate(scene.boxes)
        for index, item in enumerate(content.items)
    ]
    boxes = [
        f"{title} box: {', '.join(item['description'] for item in items if item['box'] == box) or 'empty'}"
        for box, title in enumerate(BOX_TITLES)
    ]
    return {
        "picture": f"data:image/png;base64,{base64.b64encode(png(scene)).decode()}",
        "items": items,
        "description": "; ".join(boxes),
    }


def steps_body(dynamics: Dynamics, start: Scene, actions: Sequence[Action]) -> list[JSON]:
    """The actions, each with the scene after it."""
    _, *visited = scenes(dynamics, start, actions)
    pairs = zip(actions, visited, strict=True)
    return [{"action": describe(action), "scene": scene_body(scene)} for action, scene in pairs]


def _item_body(box: int, index: int, item: Item) -> JSON:
    """An item's description, and its bounding square in native pixels of the whole image."""
    return {
        "box": box,
        "index": index,
        "x": box * BOX_PITCH + item.x,
        "y": item.y,
        "side": item.side,
        "shape": item.shape.name.lower(),
        "colour": item.colour.name.lower(),
        "description": item_text(box, index, item),
    }


def changed_item(before: Scene, after: Scene) -> JSON | None:
    """The item that an edit adds or removes; None if the scenes are equal."""
    for box, (old, new) in enumerate(zip(before.boxes, after.boxes, strict=True)):
        if old != new:
            longer, shorter = sorted((old.items, new.items), key=len, reverse=True)
            pairs = zip(longer, shorter, strict=False)
            index = next((index for index, (one, other) in enumerate(pairs) if one != other), len(shorter))
            return _item_body(box, index, longer[index])
    return None


def removable_items(dynamics: Dynamics, scene: Scene) -> dict[str, JSON]:
    """The item that each legal REMOVE removes, by the action's name."""
    appearance = dynamics.appearance
    placement = dynamics.rules.placement
    removals = action_arrays(appearance)[:, 0] == ActionType.REMOVE
    found: dict[str, JSON] = {}
    for index in np.flatnonzero(removals & appearance.legal_mask(scene, placement)).tolist():
        action = appearance.decode(index)
        item = changed_item(scene, appearance.apply(scene, action, placement).scene)
        if item is not None:
            found[describe(action)] = item
    return found
