"""Compose's topology on the loopback device: the main job run on it, and what it refuses and to whom."""

from __future__ import annotations

import base64
import json
import shutil
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from typing import Any

import manifests
import pytest

pytest.importorskip("psycopg2", reason="psycopg2 is not installed: pip install psycopg2-binary")
topology = pytest.importorskip("topology")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(topology.postgres_programs() is None, reason="Postgres is not installed"),
    pytest.mark.skipif(shutil.which("wget") is None, reason="wget, which the health checks call, is not installed"),
]


@pytest.fixture(scope="module")
def running() -> Iterator[Any]:
    t=time.time()
    with topology.Topology() as started:
        print("UP", time.time()-t)
        yield started


def test_x(running):
    for port in ("8265","5000"):
        print(running.here(f"http://127.0.0.1:{port}"))
    import subprocess
    for p in running.processes():
        try: 
            for c in p.net_connections(): 
                if c.status=="LISTEN": print(p.name(), p.cmdline()[:3], c.laddr)
        except Exception as e: print(e)
    words=next(w for w in manifests.readme_lines() if "train" in w and w[:2]==["ray","job"])
    print(words)
    words=[running.here(w) for w in words]
    i=words.index("--working-dir"); del words[i:i+2]
    words[words.index("train_default.yaml")]="train_smoke.yaml"
    t=time.time()
    r=running.run("head",words); print(time.time()-t, r.returncode); print(r.stdout[-6000:],r.stderr[-3000:])
    subprocess.run(["find",str(running.folder/"shared"), str(running.folder/"artifacts"),"-maxdepth","4"])
    t=time.time()
