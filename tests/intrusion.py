"""What another account on the machine gets of processes that run: of their files, sockets, secrets and ports."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Collection
from pathlib import Path
from typing import Any

from checkout import ROOT


def methods() -> list[str]:
    """Every method of every gRPC service that this Ray has."""
    import importlib
    import pkgutil

    from ray.core import generated

    found = {f"/ray.rpc.ObjectManagerService/{name}" for name in ("Push", "Pull", "FreeObjects")}  # C++ alone
    for module in pkgutil.iter_modules(generated.__path__):
        if module.name.endswith("_pb2"):
            services = importlib.import_module(f"ray.core.generated.{module.name}").DESCRIPTOR.services_by_name
            found |= {f"/{one.full_name}/{method.name}" for one in services.values() for method in one.methods}
    return sorted(found)


def ports(processes: set[int]) -> set[int]:
    """What the processes listen on."""
    sockets = set()
    for number in processes:
        for link in Path(f"/proc/{number}/fd").glob("*"):
            try:
                sockets |= set(re.findall(r"^socket:\[(\d+)\]$", os.readlink(link)))
            except OSError:
                continue
    rows = [line.split() for name in ("tcp", "tcp6") for line in Path(f"/proc/net/{name}").read_text().splitlines()[1:]]
    listening = [row for row in rows if row[3] == "0A" and row[9] in sockets]
    strangers = [
        row[1] for row in listening if not row[1].startswith(("0100007F:", "0000000000000000FFFF00000100007F:"))
    ]
    assert strangers == []
    return {int(row[1].rpartition(":")[2], 16) for row in listening}


def got_by_another_account(
    processes: set[int], folder: Path, *, spared: Collection[Path] = (), open_ports: Collection[int] = ()
) -> dict[str, Any]:
    """What `intruder.py` got, a line each, and how many calls were refused for want of a token.

    Args:
        processes: that are attacked.
        folder: all below it is attacked, too, and what the processes have open below the folders for temporary files.
        spared: files that are the test's.
        open_ports: that answer whoever asks, as they should.
    """
    opened: set[str] = set()
    for number in processes:
        for link in Path(f"/proc/{number}/fd").glob("*"):
            try:
                opened.add(os.readlink(link))
            except OSError:
                continue
    others = [Path(path) for path in opened if path.startswith(("/tmp/", "/dev/shm/", "/var/tmp/"))]
    paths = [str(path) for path in [*folder.rglob("*"), *others] if path.exists() and path not in spared]
    listening = ports(processes) - set(open_ports)
    assert len(paths) > 20
    assert len(listening) > 5
    given = {"paths": paths, "processes": sorted(processes), "ports": sorted(listening), "methods": methods()}
    attack = subprocess.run(
        [sys.executable, ROOT / "tests/intruder.py"], input=json.dumps(given), capture_output=True, text=True,
        timeout=300, cwd="/tmp", env={"PATH": os.environ["PATH"]},
    )  # fmt: skip
    assert attack.returncode == 0, attack.stderr
    told = json.loads(attack.stdout)
    print(f"{len(paths)} paths, {len(listening)} ports, {told['refused']} calls refused")
    # Ray tells whoever asks that it is alive; nothing else.
    told["got"] = [line for line in told["got"] if "/api/local_raylet_healthz: " not in line]
    return told
