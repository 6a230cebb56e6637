"""The fillings that a patch may get, in a table: each a row, those first that are worth a trial first."""

from __future__ import annotations

from envs.kernels.jit import inner
from envs.types import Floats

RECTANGLE, STAR, CUT, RINGS = range(4)
#: Columns of a table: the key it is sorted by, irregular vertices left, kind, elements, and numbers of the kind:
#:
#:     rectangle   rows around it, first place, first side
#:     star        the place toggled
#:     cut         both ends, its edges, and three times what it is at the first end with what it is at the second
#:     rings       rows outside, rows around the hole, the place there that the loop's first one is joined to
RANK, LEFT, KIND, ELEMENTS, FIRST, SECOND, THIRD, FOURTH = range(8)
COLUMNS = 8
#: What an irregular vertex counts in the rank.
WORTH = 0.5
#: Options in all, at most.
ROOM = 4096


@inner
def keep(
    options: Floats, first: int, count: int, room: int, left: float, prior: float, kind: int, elements: int,
    numbers: tuple[int, int, int, int],
) -> int:  # fmt: skip
    """Keep an option if it is among the best ``room`` from ``first`` on; how many there are in all."""
    rank = WORTH * left + prior
    end = min(first + room, len(options))
    if first >= end or (count == end and options[end - 1, RANK] <= rank):
        return count
    at = count if count < end else end - 1
    while at > first and options[at - 1, RANK] > rank:
        for column in range(COLUMNS):
            options[at, column] = options[at - 1, column]
        at -= 1
    options[at, RANK], options[at, LEFT], options[at, KIND], options[at, ELEMENTS] = rank, left, kind, elements
    for i in range(len(numbers)):
        options[at, FIRST + i] = numbers[i]
    return min(count + 1, end)


@inner
def in_order(options: Floats, count: int) -> int:
    """Sort the options by rank; how many there are."""
    for i in range(1, count):
        at = i
        while at > 0 and options[at - 1, RANK] > options[at, RANK]:
            for column in range(COLUMNS):
                kept = options[at, column]
                options[at, column], options[at - 1, column] = options[at - 1, column], kept
            at -= 1
    return count
