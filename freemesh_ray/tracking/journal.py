"""A run's journal: what it records for the tracking store, as JSON lines in its folder.

The journal is locked while its run lives; the kernel frees the lock of a process that was killed, which is how a later
start tells a killed run from one still at work.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import time
import uuid
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

Event = dict[str, Any]

#: Seconds that a resumed run waits for its journal: another run that began at the same moment, as a study's trials do
#: together, may hold it to mark it FAILED.
PATIENCE_SECONDS = 20.0


@dataclass
class State:
    """Where a journal goes and how much of it has arrived.

    Attributes:
        uri, experiment: the store and the experiment's name.
        run_id: MLflow's id, None until the run was made there.
        sent: bytes of the journal that are delivered.
    """

    uri: str
    experiment: str
    run_id: str | None = None
    sent: int = 0


class Journal:
    """A run's events, one JSON object a line, locked by whoever holds this object; ``state`` is a file beside it."""

    def __init__(self, path: Path, descriptor: int, state: State) -> None:
        self.path, self.state, self._descriptor = path, state, descriptor
        self._torn = False  # the last line was cut short

    @classmethod
    def new(cls, folder: Path, state: State) -> Journal:
        """An empty journal in ``folder``/tracking."""
        name = f"{datetime.now(UTC):%Y%m%dT%H%M%S}-{uuid.uuid4().hex[:8]}.jsonl"
        path = folder.resolve() / "tracking" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_EXCL, 0o644)
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        journal = cls(path, descriptor, state)
        journal.save()
        return journal

    @classmethod
    def claim(cls, path: Path, patience: float = 0.0) -> Journal | None:
        """The journal at ``path``; None when its run is at work, here or in another process, or it is unreadable.

        Args:
            path: of the journal.
            patience: seconds to wait for whoever holds it.
        """
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_APPEND)
        except OSError:
            return None
        deadline = time.monotonic() + patience
        while not _locked(descriptor):
            if time.monotonic() >= deadline:
                os.close(descriptor)
                return None
            time.sleep(0.05)
        try:  # only now: whoever held it may have written the state
            state = State(**json.loads(path.with_suffix(".json").read_text(encoding="utf-8")))
            if not (isinstance(state.uri, str) and isinstance(state.experiment, str) and state.sent >= 0):
                raise ValueError("no state of a journal")
        except (OSError, ValueError, TypeError, RecursionError):
            os.close(descriptor)
            return None
        journal = cls(path, descriptor, state)
        size = os.fstat(descriptor).st_size
        if size and os.pread(descriptor, 1, size - 1) != b"\n":
            os.write(descriptor, b"\n")  # a line cut short by a crash stays a line of its own
        return journal

    @property
    def id(self) -> str:
        """Ours, known before the store is reached."""
        return self.path.stem

    def append(self, event: Event) -> None:
        """Add one line; a single write, so threads need no lock among themselves.

        Raises:
            OSError: it was not written, as on a full disk.
        """
        line = (b"\n" if self._torn else b"") + (json.dumps(event) + "\n").encode()
        written = os.write(self._descriptor, line)
        self._torn = written < len(line)
        if self._torn:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def read(self, start: int = 0) -> Iterator[tuple[Event, int]]:
        """The whole lines from byte ``start`` on: see `entries`."""
        return self.entries(self.path, start)

    @staticmethod
    def entries(path: Path, start: int = 0) -> Iterator[tuple[Event, int]]:
        """The whole lines of the journal at ``path`` from byte ``start`` on: (event, the byte behind it).

        A line that is no event is ``{}``.
        """
        with path.open("rb") as file:
            file.seek(start)
            for line in file:
                if not line.endswith(b"\n"):
                    return
                start += len(line)
                try:
                    event = json.loads(line)
                except (ValueError, RecursionError):
                    event = {}
                yield (event if isinstance(event, dict) else {}), start

    def save(self) -> None:
        """Write ``state``, all or nothing."""
        target = self.path.with_suffix(".json")
        draft = target.with_suffix(".tmp")
        draft.write_text(json.dumps(asdict(self.state)), encoding="utf-8")
        os.replace(draft, target)

    def release(self) -> None:
        """Give the lock back; the object is of no use afterwards."""
        os.close(self._descriptor)
        self._descriptor = -1  # a late append then fails, and never lands in a file that got the number next


def journals(folder: Path) -> list[Path]:
    """The journals of a run's folder, oldest first."""
    return sorted((folder / "tracking").glob("*.jsonl"))


def shared(folder: Path) -> Path:
    """Where the journals that other runs share with the run lie, beside its own in ``folder``."""
    return folder / "shared"


def latest(folder: Path, run_id: str | None) -> Journal | None:
    """The newest journal of ``folder`` that can be claimed, and that is of ``run_id`` when one is given."""
    for path in reversed(journals(folder)):
        journal = Journal.claim(path, PATIENCE_SECONDS)
        if journal and run_id in (None, journal.state.run_id):
            return journal
        if journal:
            journal.release()
    return None


def _locked(descriptor: int) -> bool:
    """Whether the lock could be had."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def new_event(kind: str, **content: Any) -> Event:
    """An entry for a journal, with the time."""
    return {"kind": kind, "time": now(), **content}


def now() -> int:
    """Milliseconds since the epoch."""
    return int(time.time() * 1000)
