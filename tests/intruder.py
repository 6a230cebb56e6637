"""Becomes another account, and tells what it gets hold of: of the paths, processes and ports on the standard input."""

from __future__ import annotations

import encodings.idna  # noqa: F401  it, too, cannot be read later
import json
import os
import socket
import sys
from collections.abc import Iterator
from typing import Any

import grpc

#: An account that is not ours.
NOBODY = 65534

HTTP = ("/", "/metrics", "/api/version", "/api/jobs/", "/api/local_raylet_healthz", "/get_or_create_runtime_env")


def opened(path: str) -> Iterator[str]:
    """A file, folder or socket that can be read, changed or connected to."""
    if os.access(path, os.R_OK) or os.access(path, os.W_OK):
        yield f"opens {path}"
    with socket.socket(socket.AF_UNIX) as client:
        client.settimeout(2)
        try:
            client.connect(os.path.relpath(path))  # short enough
        except OSError:
            return
        yield f"connects to {path}"


def looked_into(process: int) -> Iterator[str]:
    """What a process keeps for itself: its variables, among them the token, its memory and its files."""
    for secret in ("environ", "mem", "maps"):
        try:
            with open(f"/proc/{process}/{secret}", "rb") as file:
                yield f"reads {secret} of {process}: {file.read(100)!r}"
        except OSError:
            continue
    try:
        yield f"lists the files of {process}: {os.listdir(f'/proc/{process}/fd')}"
    except OSError:
        return


def answered(port: int) -> Iterator[str]:
    """A request by HTTP without a token that is answered by anything but a refusal."""
    for method in ("GET", "POST"):
        for path in HTTP:
            request = f"{method} {path} HTTP/1.1\r\nHost: x\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
            try:
                with socket.create_connection(("127.0.0.1", port), timeout=2) as client:
                    client.sendall(request.encode())
                    answer = client.recv(100)
            except OSError:
                continue
            if answer.startswith(b"HTTP/") and answer.split()[1] not in (b"401", b"403"):
                yield f"{port} answers {method} {path}: {answer!r}"


def called(port: int, methods: list[str]) -> Iterator[tuple[str, str]]:
    """What gRPC says to a call without a token of each method, with an empty request."""
    with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
        for method in methods:
            try:
                channel.unary_unary(method)(b"", timeout=5)
                yield method, "OK"
            except grpc.RpcError as error:
                yield method, error.code().name
                if error.code() is grpc.StatusCode.UNAVAILABLE:  # no gRPC
                    return


def main(given: dict[str, Any]) -> dict[str, Any]:
    """All that was got, a line each, and how often a token was asked for."""
    got = [line for path in given["paths"] for line in opened(path)]
    got += [line for process in given["processes"] for line in looked_into(process)]
    got += [line for port in given["ports"] for line in answered(port)]
    refused = 0
    for port in given["ports"]:
        for method, code in called(port, given["methods"]):
            refused += code == "UNAUTHENTICATED"
            if code not in ("UNAUTHENTICATED", "UNIMPLEMENTED", "UNAVAILABLE"):
                got.append(f"{port}: {method}: {code}")
    return {"got": got, "refused": refused}


given = json.load(sys.stdin)
grpc.insecure_channel("127.0.0.1:1").close()  # what it imports cannot be read later
os.setgroups([])
os.setgid(NOBODY)
os.setuid(NOBODY)
print(json.dumps(main(given)))
