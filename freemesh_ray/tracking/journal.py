"""A run's journal: what it records for the tracking store, as JSON lines in its folder.

The journal is locked while its run lives; the kernel frees the lock of a process that was killed, which is how a later
start on the same machine tells a killed run from one still at work.

A journal says what is delivered, and nothing else: to which store is its reader's to say, and a file that it names is
read only if it lies below `Journal.folder`. One that is claimed is a file of this user's below a given folder, reached
through no link (`freemesh_ray.storage.own_file`).
"""

from __future__ import annotations

import errno
import fcntl
import json
import math
import os
import re
import time
import uuid
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from itertools import islice
from pathlib import Path

from freemesh_ray.storage import own_file
from freemesh_ray.storage.atomic import replacing
from freemesh_ray.storage.owner import Owner
from freemesh_ray.tracking.events import ID, LAST, Event, is_id, parsed

#: Seconds that a resumed run waits for its journal: another run that began at the same moment, as a study's trials do
#: together, may hold it to mark it FAILED.
PATIENCE_SECONDS = 20.0
#: Bytes of a line, of a journal, and of its state; what is longer is none.
LINE_BYTES, JOURNAL_BYTES, STATE_BYTES = 1 << 20, 4 << 30, 1 << 14
#: Bytes of an artifact that it names.
ARTIFACT_BYTES = 1 << 30
#: The form of a page's address behind the store's.
PAGE = re.compile(r"#/[\w/?&=-]{1,500}")
#: Bytes read at a time, and journals that are looked at for one to go on with.
CHUNK, NEWEST = 1 << 18, 20


@dataclass
class State:
    """What is known of a journal's delivery; it says where that went, and never where it goes.

    Attributes:
        uri, experiment: the store, without a password, and the experiment's name.
        run_id: MLflow's id, None until the run was made there.
        sent: bytes of the journal that are delivered.
        owner: `Owner.told` of the process that wrote the journal last.
        page: where the store shows the run, behind its address; None until the run was made there.
    """

    uri: str
    experiment: str
    run_id: str | None = None
    sent: int = 0
    owner: dict[str, str] | None = None
    page: str | None = None

    @classmethod
    def parsed(cls, content: bytes) -> State:
        """What a state's file holds.

        Raises:
            ValueError, TypeError: it is none.
        """
        state = cls(**json.loads(content))
        texts = isinstance(state.uri, str) and isinstance(state.experiment, str)
        known = state.run_id is None or is_id(state.run_id)
        known &= state.page is None or (isinstance(state.page, str) and PAGE.fullmatch(state.page) is not None)
        if not (texts and known and type(state.sent) is int and 0 <= state.sent <= JOURNAL_BYTES):
            raise ValueError("no state of a journal")
        return state


class Journal:
    """A run's events, one JSON object a line, locked by whoever holds this object; ``state`` is a file beside it."""

    def __init__(self, path: Path, descriptor: int, state: State) -> None:
        self.path, self.state, self._descriptor = path, state, descriptor
        self._torn = False  # the last line was cut short

    @classmethod
    def new(cls, folder: Path, state: State) -> Journal:
        """An empty journal in ``folder``/tracking, of this process."""
        folder = folder.resolve()
        path = folder / "tracking" / f"{_time_of_next(folder):%Y%m%dT%H%M%S}-{uuid.uuid4().hex[:8]}.jsonl"
        path.parent.mkdir(parents=True, exist_ok=True)
        # No one else may open it: whoever may open it may hold its lock.
        descriptor = own_file.opened(folder, path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_EXCL, 0o600)
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        journal = cls(path, descriptor, state)
        journal.own()
        return journal

    @classmethod
    def claim(cls, path: Path, root: Path, patience: float = 0.0) -> Journal | None:
        """The journal at ``path``.

        Args:
            path: of the journal.
            root: a folder above it, from which on no link is followed.
            patience: seconds to wait for whoever holds it.

        Returns:
            None when its run is at work, here or in another process, or it is no journal, or no file of this user's.
        """
        if not ID.fullmatch(path.stem):
            return None
        try:
            descriptor = own_file.opened(root, path, os.O_RDWR | os.O_APPEND)
        except OSError:
            return None
        deadline = time.monotonic() + patience
        while not _locked(descriptor):
            if time.monotonic() >= deadline:
                os.close(descriptor)
                return None
            time.sleep(0.05)
        try:  # only now: whoever held it may have written the state
            state = State.parsed(own_file.read(root, path.with_suffix(".json"), STATE_BYTES))
            size = os.fstat(descriptor).st_size
            if size > JOURNAL_BYTES:
                raise ValueError("too long for a journal")
            if size and os.pread(descriptor, 1, size - 1) != b"\n":
                os.write(descriptor, b"\n")  # a line cut short by a crash stays a line of its own
        except (OSError, ValueError, TypeError, RecursionError):
            os.close(descriptor)
            return None
        return cls(path, descriptor, state)

    @property
    def id(self) -> str:
        """Ours, known before the store is reached."""
        return self.path.stem

    @property
    def folder(self) -> Path:
        """Where the files lie that it may name: the run's folder; of a journal that was shared, a folder beside it."""
        return self.path.with_suffix("") if self.path.parent.name == "shared" else self.path.parents[1]

    @property
    def owner(self) -> Owner | None:
        """The process that wrote it last; None where the state does not tell."""
        return Owner.parsed(self.state.owner)

    @property
    def size(self) -> int:
        """In bytes."""
        return os.fstat(self._descriptor).st_size

    def last(self) -> Event:
        """The last event; ``{}`` where there is none."""
        return next((event for event, _ in reversed(list(self.read(max(0, self.size - LINE_BYTES)))) if event), {})

    def is_over(self) -> bool:
        """Whether its run has ended, for whoever has claimed it.

        Of a process that this machine has run since its start the lock has told; one of an earlier start is gone; one
        of another machine may be at work, where locks do not hold among machines, unless it has said that it ended.
        """
        last, owner, here = self.last(), self.owner, Owner.here()
        if last.get("kind") in LAST:
            return True
        return owner is not None and (
            owner.same_boot(here) or owner.ended_with_machine(here, last.get("time", math.inf) / 1000)
        )

    def own(self) -> None:
        """Note this process as the one that writes the journal."""
        self.state.owner = Owner.here().told()
        self.save()

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
        return entries(self._descriptor, start)

    def save(self) -> None:
        """Write ``state``, all or nothing.

        Raises:
            OSError: the journal's folder is gone, as a shared one may be; it is not made anew.
        """
        self.path.parent.stat()
        with replacing(self.path.with_suffix(".json")) as draft:
            draft.write_text(json.dumps(asdict(self.state)), encoding="utf-8")

    def release(self) -> None:
        """Give the lock back; the object is of no use afterwards."""
        os.close(self._descriptor)
        self._descriptor = -1  # a late append then fails, and never lands in a file that got the number next


def entries(descriptor: int, start: int = 0) -> Iterator[tuple[Event, int]]:
    """The whole lines of an open journal from byte ``start`` on: (event, the byte behind it).

    A line that is no event, or too long for one, is ``{}``.
    """
    line, known = b"", 0  # bytes of the line, those of them that are forgotten
    while chunk := os.pread(descriptor, CHUNK, start + known + len(line)):
        *whole, rest = (line + chunk).split(b"\n")
        for text in whole:
            start += known + len(text) + 1
            yield ({} if known or len(text) > LINE_BYTES else parsed(text)), start
            known = 0
        line = rest
        if len(line) > LINE_BYTES:
            line, known = b"", known + len(line)


def journals(folder: Path) -> list[Path]:
    """The journals of a run's folder, oldest first."""
    return sorted((folder / "tracking").glob("*.jsonl"))


def _time_of_next(folder: Path) -> datetime:
    """Now, or a second after the newest journal: the clock may have been set back, and names tell which is newest."""
    now = datetime.now(UTC).replace(microsecond=0)
    newest = max((path.name[:15] for path in journals(folder)), default="")
    with suppress(ValueError, OverflowError):  # a name that is no time
        return max(now, datetime.strptime(newest, "%Y%m%dT%H%M%S").replace(tzinfo=UTC) + timedelta(seconds=1))
    return now


def page(folder: Path) -> str | None:
    """Where the store shows the newest run of ``folder``, behind its address; None where it has none."""
    for path in islice(reversed(journals(folder.resolve())), 1):
        with suppress(OSError, ValueError, TypeError, RecursionError):
            return State.parsed(own_file.read(folder.resolve(), path.with_suffix(".json"), STATE_BYTES)).page
    return None


def shared(folder: Path) -> Path:
    """Where the journals that other runs share with the run lie, beside its own in ``folder``."""
    return folder / "shared"


def latest(folder: Path) -> Journal | None:
    """The newest journal of ``folder`` that can be claimed, and that this user recorded."""
    folder, here = folder.resolve(), Owner.here()
    deadline = time.monotonic() + PATIENCE_SECONDS
    for path in islice(reversed(journals(folder)), NEWEST):
        journal = Journal.claim(path, folder, max(0.0, deadline - time.monotonic()))
        if journal and (journal.owner is None or journal.owner.same_user(here)):
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
