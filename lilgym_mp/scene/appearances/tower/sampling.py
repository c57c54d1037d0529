"""Random scenes of Tower, and edits of them."""

from __future__ import annotations

from random import Random

from lilgym_mp.scene import BOX_COUNT, Colour, Scene
from lilgym_mp.scene.actions import AddBlock, RemoveBlock
from lilgym_mp.scene.appearances.base import PlacementRules
from lilgym_mp.scene.appearances.sampling import ATTRIBUTE_VALUE_COUNTS, ItemTypes
from lilgym_mp.scene.appearances.tower.rules import Tower

HEIGHTS = (0, 1, 1, 2, 2, 3, 3, 4)  # to draw uniformly from
_TOWER = Tower()
_RULES = PlacementRules(searches_cell=False, keeps_unfit_snaps=False, rounds_in_image=False)  # without effect here


class TowerSampler:
    """Draws scenes of Tower."""

    def scene(self, rng: Random) -> Scene:
        colours = rng.sample(list(Colour), rng.choice(ATTRIBUTE_VALUE_COUNTS))
        scene = Scene.empty()
        while not any(scene.items()):
            for box in range(BOX_COUNT):
                for _ in range(rng.choice(HEIGHTS)):
                    scene = _TOWER.apply(scene, AddBlock(box, rng.choice(colours)), _RULES).scene
        return scene

    legible_scene = scene

    def changed(self, rng: Random, scene: Scene) -> Scene:
        while True:
            changed = _TOWER.apply(scene, _TOWER.decode(rng.randrange(1, _TOWER.action_count)), _RULES)
            if changed.invalid is None and any(changed.scene.items()):
                return changed.scene

    def addition(self, rng: Random, item_types: ItemTypes, box: int) -> AddBlock:
        return AddBlock(box, rng.choice(item_types.colours))

    def removal(self, successor: Scene, box: int) -> RemoveBlock:
        return RemoveBlock(box)
