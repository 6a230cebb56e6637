"""A service whose checkout and home cannot be written to: it compiles its kernels elsewhere, and leaves no trace."""

from __future__ import annotations

import http.client
import json
import shutil
import sys
from pathlib import Path

import pytest
from checkout import ROOT
from processes import Server, free_port

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="root is denied nothing elsewhere"),
]

#: Runs a module for which modes count, whoever runs it: root gives up what lets it write anywhere (PR_CAPBSET_DROP).
CONFINED = """
import ctypes, os, sys
for capability in range(64):
    ctypes.CDLL(None).prctl(24, capability, 0, 0, 0)
os.environ.pop("NUMBA_CACHE_DIR", None)
os.execv(sys.executable, [sys.executable, "-c", "import os, runpy, sys; assert not os.access(sys.path[1], os.W_OK); "
         "sys.argv[1:] = sys.argv[2:]; runpy.run_module('freemesh_ray', run_name='__main__')", *sys.argv])
"""
SHEET = {"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]]}


def test_a_read_only_checkout_and_home(tmp_path: Path) -> None:
    checkout, temporary, port = tmp_path / "checkout", tmp_path / "tmp", free_port()
    for package in ("envs", "freemesh_ray"):
        shutil.copytree(ROOT / package, checkout / package, ignore=shutil.ignore_patterns("__pycache__"))
    temporary.mkdir(mode=0o700)
    before = sorted(checkout.rglob("*"))
    for path in [checkout, *before]:
        path.chmod(0o555 if path.is_dir() else 0o444)
    arguments = ["-c", CONFINED, "serve", "--port", str(port)]
    variables = {"PYTHONPATH": str(checkout), "HOME": str(checkout), "TMPDIR": str(temporary)}
    try:
        with Server(arguments, port, "/health", tmp_path / "log", **variables) as server:
            connection = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
            connection.request("POST", "/mesh?edge_length=1", json.dumps(SHEET))
            assert connection.getresponse().status == 200
            assert server.stop() == 0, server.log.read_text()
            assert server.log.read_text().count("\n") == 1
        assert sorted(checkout.rglob("*")) == before
        assert not list(temporary.glob("ray-*"))
    finally:
        for path in [checkout, *before]:
            path.chmod(0o755 if path.is_dir() else 0o644)
