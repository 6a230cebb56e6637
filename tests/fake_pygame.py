"""What this package asks of pygame, without a screen: pygame is in no lock."""

from __future__ import annotations

from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np


class FakePygame(ModuleType):
    """Remembers what is on its screen.

    Attributes:
        shown: every picture shown, (width, height, 3) uint8.
        ticks: the frames a second that each was shown at.
        open: whether there is a window.
    """

    class error(RuntimeError):
        pass

    def __init__(self, driver: str = "x11") -> None:
        super().__init__("pygame")
        self.shown: list[np.ndarray] = []
        self.ticks: list[int] = []
        self.open = False
        self.display = SimpleNamespace(
            init=lambda: None, get_driver=lambda: driver, set_mode=self.set_mode, set_caption=lambda title: None,
            flip=self.flip, quit=self.quit,
        )  # fmt: skip
        self.time = SimpleNamespace(Clock=lambda: SimpleNamespace(tick=self.ticks.append))
        self.surfarray = SimpleNamespace(make_surface=lambda columns: columns)
        self.event = SimpleNamespace(pump=lambda: None)

    def set_mode(self, size: tuple[int, int]) -> Any:
        self.open, self.drawn = True, np.zeros((*size, 3), dtype=np.uint8)
        return SimpleNamespace(blit=self.blit)

    def blit(self, columns: np.ndarray, corner: tuple[int, int]) -> None:
        assert (columns.shape, columns.dtype, corner) == (self.drawn.shape, np.uint8, (0, 0))
        self.drawn = columns

    def flip(self) -> None:
        assert self.open
        self.shown.append(self.drawn)

    def quit(self) -> None:
        self.open = False
