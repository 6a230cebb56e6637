"""Code of a user's own in a training: what it is told, and how it ends the training early."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from envs.errors import PluginError
from envs.plug_ins.lookup import subclass

if TYPE_CHECKING:
    from freemesh_ray.training.run import Run
    from freemesh_ray.training.run_folder import RunFolder
    from freemesh_ray.training.status import Progress, Status


class StopTraining(Exception):
    """Raised by a callback: the training ends as if its budget were spent, with evaluation, checkpoint and meshes."""


class Started(Protocol):
    """A training that begins or goes on, as a callback sees it: its settings, its files and where it stands."""

    @property
    def config(self) -> Mapping[str, Any]:
        """The resolved settings."""

    @property
    def folder(self) -> RunFolder:
        """Where its files lie."""

    @property
    def progress(self) -> Progress:
        """Steps, updates, time and the best score so far."""


class Callback:
    """What a training tells; a subclass has the methods that it needs.

    They are called in the training's process, between two iterations: the training waits for them. One that raises
    `StopTraining` ends the training early. One that raises anything else ends it with a `PluginError`, after a
    checkpoint: nothing is lost.
    """

    def on_start(self, training: Started) -> None:
        """It begins, or goes on, from a checkpoint or after a failure; its ``config``, ``folder`` and ``progress``."""

    def on_iteration(self, status: Status) -> None:
        """Some env steps are taken, and their updates made."""

    def on_evaluation(self, figures: Mapping[str, float]) -> None:
        """The policy was evaluated: a line of ``evaluations.jsonl``, with ``env_steps`` and ``seconds``."""

    def on_checkpoint(self, path: Path) -> None:
        """A checkpoint was written into folder ``path``; in a trial of a study Ray Tune moves it afterwards."""

    def on_note(self, line: str) -> None:
        """Something is worth a line: a stage, a failure that was recovered from, an interruption."""

    def on_end(self, run: Run) -> None:
        """It came to its end, and every stage is meshed."""


def callbacks_named(config: Mapping[str, Any]) -> list[Callback]:
    """The callbacks that a configuration names, made.

    Raises:
        PluginError: one cannot be had, or is no class of `Callback`.
    """
    what = "a class of freemesh_ray.Callback"
    made: list[Callback] = [subclass(spec, "callbacks", Callback, what)() for spec in config["callbacks"]]
    return made


class Callbacks:
    """The callbacks of a training, called in order. What they raise is kept until the training asks for it.

    Attributes:
        stopped: one raised `StopTraining`.
        interruption: Ctrl-C came in one, or what ends a command as that does; nothing is told after that.
        error: what else one raised; nothing is told after that.
    """

    def __init__(self, callbacks: Sequence[Callback] = ()) -> None:
        """Take them.

        Raises:
            PluginError: one is no `Callback`.
        """
        for callback in callbacks:
            if not isinstance(callback, Callback):
                raise PluginError(f"callbacks: {callback!r:.60} is none: derive its class from freemesh_ray.Callback")
        self._callbacks = tuple(callbacks)
        self.stopped = False
        self.interruption: KeyboardInterrupt | None = None
        self.error: PluginError | None = None

    def tell(self, hook: str, *what: Any) -> None:
        """Call method ``hook`` of each."""
        for callback in self._callbacks:
            if self.error is not None or self.interruption is not None:
                return
            try:
                getattr(callback, hook)(*what)
            except StopTraining:
                self.stopped = True
            except KeyboardInterrupt as interruption:
                self.interruption = interruption
            except (Exception, SystemExit) as error:
                brief = (str(error).strip().splitlines() or ["no message"])[0][:200]
                self.error = PluginError(
                    f"callback {type(callback).__qualname__}: {hook} raised {type(error).__name__} ({brief}): "
                    "mend it, resuming loses nothing"
                )
                self.error.__cause__ = error

    def check(self) -> None:
        """Raise what one raised.

        Raises:
            PluginError: one did.
        """
        if self.error is not None:
            raise self.error
