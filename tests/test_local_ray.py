"""The embedded Ray is this machine's alone."""

from __future__ import annotations

import ipaddress
import json
import os
import subprocess
import sys

import pytest
from processes import ROOT

LISTENING = """
import json
from freemesh_ray.local_ray import local_ray

with local_ray(1):
    import psutil  # Ray's own
    import ray

    ray.get(ray.remote(lambda: None).remote())
    sockets = [each for process in (psutil.Process(), *psutil.Process().children(recursive=True))
               for each in process.net_connections("tcp")]
    print(json.dumps([each.laddr.ip for each in sockets if each.status == "LISTEN"]))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_it_listens_on_the_loopback_device_only() -> None:
    """It asks for no token: whoever reached it could run what they like."""
    variables = {key: value for key, value in os.environ.items() if not key.startswith("RAY_")}
    done = subprocess.run(
        [sys.executable, "-c", LISTENING],
        env=variables | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=180,
    )
    assert done.returncode == 0, done.stderr
    addresses = [ipaddress.ip_address(text) for text in json.loads(done.stdout.splitlines()[-1])]
    assert len(addresses) > 3
    assert all((getattr(each, "ipv4_mapped", None) or each).is_loopback for each in addresses), addresses
