"""Rendering of environments: render modes, captions, and the window, for which pygame is imported."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar
from weakref import WeakSet

import numpy as np
from gymnasium.error import DependencyNotInstalled

from lilgym_mp.corpus.extras import install
from lilgym_mp.envs.interface import RENDER_FPS, RENDER_MODES
from lilgym_mp.envs.rules import Dynamics, State, Transition
from lilgym_mp.scene import Scene
from lilgym_mp.scene.actions import describe
from lilgym_mp.scene.appearances import Appearance
from lilgym_mp.scene.arrays import UInt8Array
from lilgym_mp.scene.choices import choose


class Renderer:
    """Shows scenes with lines of text, by render mode."""

    def __init__(self, mode: str, modes: Sequence[str] = RENDER_MODES, *, marked: Appearance | None = None) -> None:
        """`marked`: the appearance whose cells frames show. Raises ValueError naming the modes."""
        self.mode = choose("render_mode", mode, {name: name for name in modes})
        self._marked = marked
        self._window: Window | None = None

    def show(self, state: State, dynamics: Dynamics, last: tuple[int, Transition] | None) -> UInt8Array | str | None:
        """`render` of a state of the MDP. `last`: index and transition of the last action."""
        return self.render(state.scene, _caption(state, dynamics, last))

    def render(self, scene: Scene, lines: Sequence[str]) -> UInt8Array | str | None:
        """By mode: an image (304, 784, 3) with a caption, text, or None after updating the window."""
        if self.mode == "ansi":
            from lilgym_mp.scene.render.characters import text

            return text(scene, lines)
        from lilgym_mp.scene.render.frames import frame

        picture = frame(scene, lines, self._marked)
        if self.mode == "rgb_array":
            return picture
        self._window = self._window or Window()
        self._window.show(picture)
        return None

    def close(self) -> None:
        """Closes the window, if one is open; rendering opens another."""
        if self._window is not None:
            self._window.close()
            self._window = None


def _caption(state: State, dynamics: Dynamics, last: tuple[int, Transition] | None) -> list[str]:
    """The statement, the target with the number of actions taken, and the result of the last action, given by its index
    and transition."""
    lines = [
        state.task.statement,
        f"Make it {str(state.task.target).lower()}.  Action {state.steps} of {dynamics.horizon}.",
    ]
    if last is not None:
        action, transition = last
        name = describe(dynamics.appearance.decode(action))
        reason = f" ({transition.invalid})" if transition.invalid else ""
        lines.append(f"{name}: {transition.outcome}{reason}, reward {transition.reward:+.1f}")
    return lines


class Window:
    """Shows RENDER_FPS frames a second. pygame has one window, in which all environments show theirs."""

    _shown: ClassVar[WeakSet[Window]] = WeakSet()  # that have not been closed

    def __init__(self) -> None:
        """Raises DependencyNotInstalled without pygame."""
        try:
            import pygame
        except ImportError:
            message = f'render_mode="human" needs pygame: {install("human")}'
            raise DependencyNotInstalled(message) from None
        self._pygame: Any = pygame
        self._surface: Any = None
        self._clock: Any = None

    def __reduce__(self) -> tuple[type[Window], tuple[()]]:
        """A copy opens its own window."""
        return Window, ()

    def show(self, frame: UInt8Array) -> None:
        """Shows a frame (height, width, 3), and waits so that RENDER_FPS is not exceeded."""
        pygame = self._pygame
        size = (frame.shape[1], frame.shape[0])
        self._surface = pygame.display.get_surface()
        if self._surface is None or self._surface.get_size() != size:
            pygame.display.init()
            pygame.display.set_caption("lilgym_mp")
            self._surface = pygame.display.set_mode(size)
        self._clock = self._clock or pygame.time.Clock()
        self._shown.add(self)
        pygame.surfarray.blit_array(self._surface, np.ascontiguousarray(frame.transpose(1, 0, 2)))
        pygame.event.pump()
        pygame.display.flip()
        self._clock.tick(RENDER_FPS)

    def close(self) -> None:
        """Stops showing frames; the display is closed with the last window that shows any."""
        self._shown.discard(self)
        if not self._shown:
            self._pygame.display.quit()
