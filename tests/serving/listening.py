"""What a process and its children listen on, as the kernel knows it."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import suppress
from ipaddress import IPv4Address, IPv6Address, ip_address
from pathlib import Path

#: The state of a listening socket in /proc/net/tcp.
LISTENING = "0A"


def family(pid: int) -> list[int]:
    """A process and all that descend from it."""
    parents: dict[int, list[int]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            fields = stat.read_text().rpartition(")")[2].split()
            parents.setdefault(int(fields[1]), []).append(int(stat.parent.name))
    found = [pid]
    for one in found:
        found += parents.get(one, [])
    return found


def named(pid: int, part: str) -> list[int]:
    """The descendants of a process whose command line has ``part`` in it."""
    found = []
    for one in family(pid)[1:]:
        with suppress(OSError):
            if part.encode() in Path(f"/proc/{one}/cmdline").read_bytes():
                found.append(one)
    return found


def listeners(pid: int) -> set[IPv4Address | IPv6Address]:
    """The addresses that a process and its descendants listen on."""
    held = {inode for one in family(pid) for inode in sockets(one)}
    return {address for table in ("tcp", "tcp6") for address, inode in listening(table) if inode in held}


def sockets(pid: int) -> Iterator[str]:
    """The inodes of a process's sockets."""
    for link in Path(f"/proc/{pid}/fd").glob("*"):
        with suppress(OSError):
            target = str(link.readlink())
            if target.startswith("socket:["):
                yield target[8:-1]


def listening(table: str) -> Iterator[tuple[IPv4Address | IPv6Address, str]]:
    """Address and inode of the machine's listening sockets."""
    for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
        fields = line.split()
        if fields[3] == LISTENING:
            # Words of four bytes, each in the machine's order.
            words = bytes.fromhex(fields[1].partition(":")[0])
            packed = b"".join(
                socket.htonl(int.from_bytes(words[i : i + 4])).to_bytes(4) for i in range(0, len(words), 4)
            )
            yield ip_address(packed), fields[9]
