"""The two lanes of a mesher: quick requests never wait for costly ones."""

from __future__ import annotations

from typing import Final

QUICK: Final = "quick"
COSTLY: Final = "costly"
LANES: Final = (QUICK, COSTLY)

#: By how much the workers of a lane give way to other processes.
NICENESS: Final = {QUICK: 0, COSTLY: 10}
