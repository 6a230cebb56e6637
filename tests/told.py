"""What a training tells, given to functions."""

from __future__ import annotations

from collections.abc import Callable

from freemesh_ray.training.callback import Callback
from freemesh_ray.training.status import Status


class Told(Callback):
    """Calls ``report`` after every iteration and ``note`` with every line."""

    def __init__(self, report: Callable[[Status], object], note: Callable[[str], object]) -> None:
        self.report, self.note = report, note

    def on_iteration(self, status: Status) -> None:
        self.report(status)

    def on_note(self, line: str) -> None:
        self.note(line)


def told(
    report: Callable[[Status], object] = lambda status: None, note: Callable[[str], object] = lambda line: None
) -> list[Callback]:
    """The callbacks of a training that tells these functions."""
    return [Told(report, note)]
