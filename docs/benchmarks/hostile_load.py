"""What a service's other clients notice of an attack: idle connections, half-sent requests, and the costliest meshes.

    .venv/bin/python docs/benchmarks/hostile_load.py [--idle 2000] [--costly 8] [--replicas 2] [--seconds 30]

A client posts a polygon of 40 vertices again and again, each time over a new connection, first alone and then under
attack, which is a process of its own. Its connections are opened again a few seconds after they were cut off. All of it
shares one machine.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import os
import subprocess
import sys
import time
from collections import Counter
from contextlib import suppress

import numpy as np
from script import run_script

from envs.errors import FAILED
from freemesh_ray.policies.policy import SHIPPED, Policy
from freemesh_ray.serving.limits import Limits
from freemesh_ray.serving.service import running_service

#: What each idle connection has sent when it falls silent, or goes on with a byte a second.
BEGINNINGS = (
    b"",
    b"POST /mesh HTTP/1.1\r\nHost: localhost\r\nX-Slow: ",
    b"POST /mesh HTTP/1.1\r\nHost: localhost\r\nContent-Length: 60000\r\n\r\n{",
    b"POST /mesh HTTP/1.1\r\nHost: localhost\r\nContent-Length: 8000000\r\n\r\n" + b" " * 70_000,
)

#: Seconds until a connection that was cut off is opened again.
PAUSE = 5.0

#: The slowest answer but for one in a hundred may take so long, in seconds.
SLOWEST = 1.0


def polygon(vertices: int, size: float) -> bytes:
    """A wavy disc as GeoJSON."""
    turns = np.arange(vertices + 1) % vertices * (2 * math.pi / vertices)
    radii = size * (1.0 + 0.2 * np.sin(3 * turns))
    ring = np.stack([radii * np.cos(turns), radii * np.sin(turns)], axis=1)
    return json.dumps({"type": "Polygon", "coordinates": [ring.tolist()]}).encode()


def costliest(limits: Limits) -> tuple[str, bytes]:
    """The path and the body of about the largest meshes that are made."""
    side = math.sqrt(0.98 * limits.elements)
    square = {"type": "Polygon", "coordinates": [[[0, 0], [side, 0], [side, side], [0, side], [0, 0]]]}
    return f"/mesh?edge_length=1&best_of={limits.best_of}&effort=thorough", json.dumps(square).encode()


async def post(port: int, path: str, body: bytes) -> int:
    """The status of an answer; 0 where the connection is cut off."""
    try:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
    except OSError:
        return 0
    try:
        head = f"POST {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Length: {len(body)}\r\n\r\n"
        writer.write(head.encode() + body)
        answer = await reader.read()
        return int(answer.split(b" ", 2)[1]) if answer else 0
    except (OSError, IndexError, ValueError):
        return 0
    finally:
        writer.close()


async def stay_idle(port: int, beginning: bytes, cut: list[int]) -> None:
    """Keep a connection open that does not get on."""
    while True:
        with suppress(OSError):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            try:
                writer.write(beginning)
                while not reader.at_eof():
                    with suppress(TimeoutError):
                        await asyncio.wait_for(reader.read(1000), 1.0)
                    if beginning:
                        writer.write(b"x")
                        await writer.drain()
            finally:
                cut[0] += 1
                writer.close()
        await asyncio.sleep(PAUSE)


async def ask_for_costly_ones(port: int, limits: Limits, statuses: Counter[int]) -> None:
    """Ask for the costliest meshes, one after another."""
    path, body = costliest(limits)
    while True:
        statuses[await post(port, path, body)] += 1


async def measured(port: int, seconds: float) -> tuple[list[float], Counter[int]]:
    """The times and statuses of the small polygon's answers."""
    body, times, statuses = polygon(40, 1.0), [], Counter[int]()
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        began = time.monotonic()
        statuses[await post(port, "/mesh", body)] += 1
        times.append(time.monotonic() - began)
        await asyncio.sleep(0.02)
    return times, statuses


def told(title: str, times: list[float], statuses: Counter[int]) -> str:
    """A line of the report."""
    p50, p99 = (1000 * np.percentile(times, share) for share in (50, 99))
    return (
        f"{title}: {len(times)} answers, statuses {dict(statuses)}, p50 {p50:.0f} ms, p99 {p99:.0f} ms, slowest "
        f"{1000 * max(times):.0f} ms"
    )


async def attack(port: int, limits: Limits, options: argparse.Namespace) -> None:
    """Attack until the standard input is closed, and tell of it."""
    cut, costly = [0], Counter[int]()
    tasks = [asyncio.create_task(stay_idle(port, BEGINNINGS[i % len(BEGINNINGS)], cut)) for i in range(options.idle)]
    tasks += [asyncio.create_task(ask_for_costly_ones(port, limits, costly)) for _ in range(options.costly)]
    await asyncio.to_thread(sys.stdin.read)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    print(f"idle connections cut off {cut[0]} times; costly requests answered: {dict(costly)}")


def compare(port: int, options: argparse.Namespace) -> bool:
    """Measure without and with the attack; whether the service held."""
    print(told("alone", *asyncio.run(measured(port, options.seconds / 3))), flush=True)
    command = [sys.executable, __file__, "--attack", "--port", str(port)]
    numbers = ["--idle", str(options.idle), "--costly", str(options.costly)]
    attacking = subprocess.Popen([*command, *numbers], stdin=subprocess.PIPE)
    try:
        time.sleep(min(5.0, options.seconds))
        times, statuses = asyncio.run(measured(port, options.seconds))
        print(told("under attack", times, statuses), flush=True)
        attacking.communicate(timeout=60)
    finally:
        attacking.kill()
        attacking.wait()
    return set(statuses) == {200} and bool(np.percentile(times, 99) < options.slowest)


def main() -> None:
    """Start a service, attack it, and say what its other client noticed."""
    parser = argparse.ArgumentParser(description="A service under attack.")
    parser.add_argument("--idle", type=int, default=2000)
    parser.add_argument("--costly", type=int, default=8)
    parser.add_argument("--replicas", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--slowest", type=float, default=SLOWEST)
    parser.add_argument("--port", type=int, default=8437)
    parser.add_argument("--attack", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    limits = Limits()
    if options.attack:
        asyncio.run(attack(options.port, limits, options))
        return
    print(
        f"{options.idle} idle connections, {options.costly} costly clients, {options.replicas} replicas, "
        f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}",
        flush=True,
    )
    policies = {density: Policy.load(file) for density, file in SHIPPED.items()}
    with running_service(policies, limits, port=options.port, replicas=options.replicas):
        held = compare(options.port, options)
    print("held" if held else f"NOT held: all 200, and 99 of 100 within {options.slowest:g} s, was wanted")
    sys.exit(0 if held else FAILED)


if __name__ == "__main__":
    run_script(main)
