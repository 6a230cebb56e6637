"""The embedded Ray is its process's alone: it listens on the loopback device, and whoever has no token is refused."""

from __future__ import annotations

import ipaddress
import json
import subprocess
import sys
from typing import Any

import pytest
from processes import ROOT, outside

OWN = """
import json, os, subprocess, sys
from freemesh_ray import cli
from freemesh_ray.local_ray import local_ray

cli.main(["domains"])  # commands import Ray at various times

STRANGER = "import ray, sys; ray.init(sys.argv[1], logging_level=50); print(len(ray.nodes()))"

with local_ray(1):
    import psutil  # Ray's own
    import ray

    ray.get(ray.remote(lambda: None).remote())
    sockets = [each for process in (psutil.Process(), *psutil.Process().children(recursive=True))
               for each in process.net_connections("tcp")]
    connect, found = [sys.executable, "-c", STRANGER, ray.get_runtime_context().gcs_address], {}
    others = {"own": {}, "other": {"RAY_AUTH_TOKEN": 64 * "0"}, "none": {"RAY_AUTH_MODE": "disabled"}}
    for who, variables in others.items():
        found[who] = subprocess.run(connect, env=os.environ | variables, capture_output=True).returncode == 0
    print(json.dumps({"addresses": [each.laddr.ip for each in sockets if each.status == "LISTEN"], "let in": found}))
"""


@pytest.fixture(scope="module")
def told() -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-c", OWN],
        env=outside() | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=400,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_it_listens_on_the_loopback_device_only(told: dict[str, Any]) -> None:
    addresses = [ipaddress.ip_address(text) for text in told["addresses"]]
    assert len(addresses) > 3
    assert all((getattr(each, "ipv4_mapped", None) or each).is_loopback for each in addresses), addresses


def test_it_lets_in_who_has_its_token(told: dict[str, Any]) -> None:
    assert told["let in"] == {"own": True, "other": False, "none": False}
