"""Who a piece of work belongs to: a user, a machine, and a process since the machine's last start.

A host name does for none of them: machines share names, users share machines, and process ids are given again. So the
machine is its id and its name, a start of it is its boot id, and a process is its id, its namespace and its start. A
machine without an id is not known again when it was started anew. The ids of a machine and of its start are
confidential (machine-id(5)); only digests of them are kept.
"""

from __future__ import annotations

import hashlib
import os
import platform
import pwd
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Self

#: Linux's name of the time since the machine was last started, and where a machine's id lies.
BOOT = Path("/proc/sys/kernel/random/boot_id")
MACHINE = (Path("/etc/machine-id"), Path("/var/lib/dbus/machine-id"))
PROCESSES = Path("/proc")


@dataclass(frozen=True)
class Owner:
    """A process, told apart from all others of all machines.

    Attributes:
        user: digest of the user's id and name.
        machine: digest of the machine's id, if it has one, and host name.
        boot: digest of the boot id; empty where the system tells none.
        process: namespace, id and start (clock ticks since the machine's) of the process, with colons between.
    """

    user: str
    machine: str
    boot: str
    process: str

    @classmethod
    def here(cls) -> Self:
        """This process."""
        uid = os.geteuid()
        try:
            name = pwd.getpwuid(uid).pw_name
        except KeyError:  # a container's user need not be listed
            name = ""
        boot = _text(BOOT)
        return cls(
            user=_digest(f"user {uid} {name}"),
            machine=_digest(f"machine {_machine_id()} {platform.node()}"),
            boot=_digest(f"boot {boot}") if boot else "",
            process=f"{_namespace()}:{os.getpid()}:{_start(os.getpid())}",
        )

    @classmethod
    def parsed(cls, told: object) -> Self | None:
        """What `told` gave, read back; None for anything else."""
        names = cls.__dataclass_fields__
        if not isinstance(told, Mapping) or told.keys() != names.keys():
            return None
        forms = {name: r"\d{0,20}:\d{1,20}:\d{0,20}" if name == "process" else r"[0-9a-f]{0,16}" for name in names}
        fits = all(isinstance(told[name], str) and re.fullmatch(form, told[name]) for name, form in forms.items())
        return cls(**told) if fits else None

    def told(self) -> dict[str, str]:
        """Its attributes, as JSON and tags can hold them."""
        return asdict(self)

    def same_user(self, other: Owner) -> bool:
        """Whether both are of one user."""
        return self.user == other.user

    def same_boot(self, other: Owner) -> bool:
        """Whether both are of one machine, which was not started anew between them, so that locks tell of both."""
        return self.machine == other.machine and self.boot == other.boot

    def ended_with_machine(self, here: Owner, at: float) -> bool:
        """Whether the process was of an earlier start of this machine, and is gone for that.

        Args:
            here: this process.
            at: when it was last at work, in seconds since the epoch. A machine that has the name and id of this one,
                as a clone does, is another if it was at work since this one was started.

        Returns:
            False for every process where this machine has no id: others may have its name.
        """
        known = self.machine == here.machine and _machine_id() != "" and bool(self.boot and here.boot)
        return known and self.boot != here.boot and at < _booted()

    def is_gone(self, here: Owner, at: float) -> bool:
        """Whether this process knows that one to have ended; see `ended_with_machine`."""
        if not self.same_boot(here) or not here.boot:
            return self.ended_with_machine(here, at)
        namespace, process, start = self.process.split(":")
        return namespace != "" and namespace == _namespace() and start != _start(int(process))


def _text(path: Path) -> str:
    """A short file's text; empty where there is none."""
    try:
        with path.open("rb") as file:
            return file.read(1000).decode(errors="replace").strip()
    except OSError:
        return ""


def _machine_id() -> str:
    """This machine's, of 32 hexadecimal digits; empty where it has none, as many containers."""
    return next((found for path in MACHINE if re.fullmatch(r"[0-9a-f]{32}", found := _text(path))), "")


def _digest(text: str) -> str:
    """16 hexadecimal digits."""
    return hashlib.sha256(f"freemesh-ray {text}".encode()).hexdigest()[:16]


def _namespace() -> str:
    """The process ids' namespace, as a number: a container has its own. Empty where the system tells none."""
    try:
        return re.sub(r"\D", "", os.readlink(PROCESSES / "self" / "ns" / "pid"))
    except OSError:
        return ""


def _start(process: int) -> str:
    """When a process was started, in clock ticks since the machine was; empty where there is no such process."""
    fields = _text(PROCESSES / str(process) / "stat").rpartition(")")[2].split()  # the program's name may hold anything
    return fields[19] if len(fields) > 19 else ""


def _booted() -> float:
    """When this machine was started, in seconds since the epoch; 0 where the system does not tell."""
    try:
        lines = (PROCESSES / "stat").read_text().splitlines()
    except OSError:
        return 0.0
    return next((float(line.split()[1]) for line in lines if line.startswith("btime ")), 0.0)
