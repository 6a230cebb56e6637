"""Serve's replicas on the loopback device alone."""

from __future__ import annotations

from typing import Any


def listen_on_loopback() -> None:
    """Let this process's replica listen to other replicas on 127.0.0.1 alone, for which Serve has no setting.

    A replica runs what it is sent, so that nobody else may reach it. To be called in its constructor: Serve opens the
    port later.
    """
    from ray._common.tls_utils import add_port_to_grpc_server
    from ray.serve._private import replica

    def on_loopback(server: Any, address: str) -> int:
        return add_port_to_grpc_server(server, f"127.0.0.1:{address.rpartition(':')[2]}")

    replica.add_port_to_grpc_server = on_loopback
