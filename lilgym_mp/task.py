"""A task: a statement, its program, the target truth value and the start scene.

Source: SPEC section 2 (Wu et al. 2023, section 4: a context is a statement and a target).
"""

from __future__ import annotations

from dataclasses import dataclass

from lilgym_mp.programs import compile_program
from lilgym_mp.scene import Scene


@dataclass(frozen=True, slots=True)
class Task:
    """Make `statement` have the truth value `target`, from the scene `start`."""

    id: str
    statement: str
    program: str  # source in the program language; compiled on first use
    target: bool
    start: Scene

    def truth(self, scene: Scene) -> bool:
        """The statement's truth value in `scene`; false if the program raises, which it counts."""
        return compile_program(self.program)(scene)

    def solved_by(self, scene: Scene) -> bool:
        """Whether STOP succeeds in `scene`."""
        return compile_program(self.program)(scene) == self.target
