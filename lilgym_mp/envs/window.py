"""A window for render mode "human". pygame is imported when the first frame is shown."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled

from lilgym_mp.arrays import UInt8Array
from lilgym_mp.extras import install

RENDER_FPS = 4  # the same for every environment


class Window:
    """Shows frames, one every 1 / `fps` seconds."""

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
        if self._surface is None:
            pygame.display.init()
            pygame.display.set_caption("lilgym_mp")
            self._surface = pygame.display.set_mode((frame.shape[1], frame.shape[0]))
            self._clock = pygame.time.Clock()
        pygame.surfarray.blit_array(self._surface, np.ascontiguousarray(frame.transpose(1, 0, 2)))
        pygame.event.pump()
        pygame.display.flip()
        self._clock.tick(self._fps)

    def close(self) -> None:
        if self._surface is not None:
            self._pygame.display.quit()
            self._surface = None
