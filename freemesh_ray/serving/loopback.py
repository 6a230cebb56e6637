"""Serve's replicas on the loopback device alone."""

from __future__ import annotations

from typing import Any


def listen_on_loopback() -> None:
    """Let this process's replica listen to other replicas on 127.0.0.1, not on all devices, which Serve has no setting
    for.

    It executes what it is sent. To be called in a replica's constructor: Serve opens the port after it.
    """
    from ray._common.tls_utils import add_port_to_grpc_server
    from ray.serve._private import replica

    def on_loopback(server: Any, address: str) -> int:
        return add_port_to_grpc_server(server, f"127.0.0.1:{address.rpartition(':')[2]}")

    replica.add_port_to_grpc_server = on_loopback
