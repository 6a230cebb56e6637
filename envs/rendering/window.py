"""A window on the screen, by pygame, which is imported only for it: the extra ``play``."""

from __future__ import annotations

import os

import numpy as np
from gymnasium.error import DependencyNotInstalled


class Window:
    """Shows one picture after another.

    Args:
        width, height: pixels.
        title: what the window is called.

    Raises:
        DependencyNotInstalled: pygame is not installed, or there is no screen.
    """

    def __init__(self, width: int, height: int, title: str) -> None:
        try:
            import pygame
        except ImportError:
            raise DependencyNotInstalled("render_mode='human' needs pygame: pip install 'freemesh-ray[play]'") from None
        self._pygame = pygame
        try:
            pygame.display.init()
            if pygame.display.get_driver() == "offscreen" and "SDL_VIDEODRIVER" not in os.environ:
                raise pygame.error("SDL finds none")  # and would draw where nobody sees it
            self._surface = pygame.display.set_mode((width, height))
        except pygame.error as error:
            raise DependencyNotInstalled(
                f"render_mode='human' needs a screen ({error}): use render_mode='rgb_array'"
            ) from None
        pygame.display.set_caption(title)
        self._clock = pygame.time.Clock()

    def show(self, picture: np.ndarray, fps: int) -> None:
        """Show a picture, (height, width, 3) uint8, and wait until 1 / ``fps`` s have passed since the last."""
        self._surface.blit(self._pygame.surfarray.make_surface(picture.swapaxes(0, 1)), (0, 0))
        self._pygame.event.pump()
        self._pygame.display.flip()
        self._clock.tick(fps)

    def close(self) -> None:
        """Take the window off the screen; again: nothing happens."""
        self._pygame.display.quit()
