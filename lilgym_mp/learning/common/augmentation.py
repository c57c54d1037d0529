"""Data augmentation: permutes the colours of statements, programs, scenes, actions and tasks alike."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations

from lilgym_mp.corpus import words
from lilgym_mp.corpus.spelling import normalised_words
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import Colour, Item, Scene
from lilgym_mp.scene.actions import Action, AddBlock, AddItem

CACHE_SIZE = 32_768  # statement-program pairs

_COLOURS = {colour.name.lower(): colour for colour in Colour}
_COLOUR = re.compile(rf"(?<![a-z])({'|'.join(_COLOURS)})(?![a-z])", re.IGNORECASE)  # as a word
# Common words that look like misspelt colours, and words often typed together with the next one
_ORDINARY = {"block", "blocks", "back", "lack", "bellow"}
_SHORT = {"a", "an", "the", "is", "of", "in", "at", "on", "with", "and", "one"}


@dataclass(frozen=True, slots=True)
class Recolouring:
    """A permutation of the colours, the identity by default; it commutes with environment steps."""

    colours: tuple[Colour, ...] = tuple(Colour)  # colours[c] replaces colour c

    def text(self, text: str) -> str:
        """The statement or program with new colours, in the letter case of the old ones."""
        return _COLOUR.sub(self._renamed, text)

    def _renamed(self, found: re.Match[str]) -> str:
        old = found[0]
        new = self.colours[_COLOURS[old.lower()]].name
        return new if old.isupper() else new.capitalize() if old[0].isupper() else new.lower()

    def scene(self, scene: Scene) -> Scene:
        """The scene with new colours."""
        return Scene.of(*(map(self._item, box.items) for box in scene.boxes))

    def _item(self, item: Item) -> Item:
        return item._replace(colour=self.colours[item.colour])

    def action(self, action: Action) -> Action:
        """The action on the recoloured scene."""
        if isinstance(action, AddBlock | AddItem):
            return action._replace(colour=self.colours[action.colour])
        return action

    def task(self, task: Task) -> Task | None:
        """The recoloured task with the same id, or None unless it is `recolourable`."""
        if not recolourable(task.statement, task.program):
            return None
        return Task(task.id, self.text(task.statement), self.text(task.program), task.target, self.scene(task.start))


RECOLOURINGS = tuple(map(Recolouring, permutations(Colour)))  # the identity first


@lru_cache(maxsize=CACHE_SIZE)
def recolourable(statement: str, program: str) -> bool:
    """Whether both name the same colours, and the statement has none that may be misspelt.

    Only then do they keep the same meaning in all RECOLOURINGS.
    """
    found = [word.lower() for word in _COLOUR.findall(statement)]
    if set(found) != {word.lower() for word in _COLOUR.findall(program)}:
        return False
    checked_words = " ".join(word for word in words(statement) if word not in _ORDINARY)
    repaired = normalised_words(checked_words, _SHORT | _COLOURS.keys())
    return Counter(word for word in repaired if word in _COLOURS) == Counter(found)
