"""The window of ``render_mode="human"``; needs pygame-ce (extra ``human``).

pygame has one window per process, which all environments with this render mode share.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.imports import imported

__all__ = ["Window"]


class Window:
    """A window that shows frames at a fixed rate; it opens with the first frame."""

    def __init__(self, title: str) -> None:
        self._pygame = imported("pygame", "render_mode='human' shows frames with pygame-ce", "human")
        self._title = title
        self._clock: Any = None

    def show(self, frame: NDArray[np.uint8], fps: int) -> None:
        """Show a frame (H, W, 3), no sooner than 1 / `fps` seconds after the last one."""
        pygame, size = self._pygame, (frame.shape[1], frame.shape[0])
        if self._clock is None:
            pygame.display.init()
            self._clock = pygame.time.Clock()
        screen = pygame.display.get_surface() if pygame.display.get_init() else None
        if screen is None or screen.get_size() != size:
            # This is the first frame, or another environment has closed or resized the window.
            pygame.display.init()
            screen = pygame.display.set_mode(size)
        pygame.display.set_caption(self._title)
        screen.blit(pygame.surfarray.make_surface(frame.swapaxes(0, 1)), (0, 0))
        # Without this call the desktop reports that the program does not respond.
        pygame.event.pump()
        self._clock.tick(fps)
        pygame.display.flip()

    def close(self) -> None:
        """Close the window if it is open."""
        if self._clock is not None:
            self._clock = None
            self._pygame.display.quit()
