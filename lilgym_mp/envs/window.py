"""The window of render_mode="human", for which pygame is imported."""

from __future__ import annotations

from typing import Any, ClassVar
from weakref import WeakSet

import numpy as np
from gymnasium.error import DependencyNotInstalled

from lilgym_mp.corpus.extras import install
from lilgym_mp.scene.arrays import UInt8Array


class Window:
    """Shows frames, one every 1 / `fps` seconds. pygame has one window, in which all environments show theirs."""

    _shown: ClassVar[WeakSet[Window]] = WeakSet()  # that have not been closed

    def __init__(self, fps: int) -> None:
        """Raises DependencyNotInstalled without pygame."""
        try:
            import pygame
        except ImportError:
            message = f'render_mode="human" needs pygame: {install("human")}'
            raise DependencyNotInstalled(message) from None
        self._pygame: Any = pygame
        self._fps = fps
        self._surface: Any = None
        self._clock: Any = None

    def __reduce__(self) -> tuple[type[Window], tuple[int]]:
        """A copy opens its own window."""
        return Window, (self._fps,)

    def show(self, frame: UInt8Array) -> None:
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
        self._clock.tick(self._fps)

    def close(self) -> None:
        self._shown.discard(self)
        if not self._shown:
            self._pygame.display.quit()
