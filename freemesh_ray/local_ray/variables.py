"""What Ray reads of the environment when it is imported."""

from __future__ import annotations

import os
import secrets
import sys
from pathlib import Path

#: Tells the processes of an embedded Ray of its folder.
FOLDER = "FREEMESH_RAY_FOLDER"


def environment() -> None:
    """Set what Ray reads when it is imported, where the environment does not say it; to be called before."""
    if not os.environ.get("RAY_ADDRESS"):
        # The node's address is then 127.0.0.1, on every system, and all of Ray's servers listen there alone.
        os.environ.setdefault("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", "0")
        # And who has an account on this machine needs a token: one that the user names, or one that dies with this
        # process. A Ray that is imported already has chosen its mode.
        if "ray" not in sys.modules and os.environ.setdefault("RAY_AUTH_MODE", "token") == "token":
            named = os.environ.keys() & {"RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH"}
            if not named:
                os.environ["RAY_AUTH_TOKEN"] = secrets.token_hex(32)
        # Learners talk to each other without one.
        loopback = "lo0" if sys.platform == "darwin" else "lo"
        os.environ.setdefault("GLOO_SOCKET_IFNAME", loopback)
        os.environ.setdefault("NCCL_SOCKET_IFNAME", loopback)
        # Ray's metrics are served to whoever asks; there is no such port.
        os.environ.setdefault("RAY_enable_metrics_collection", "0")
        os.environ.setdefault("AUTOSCALER_METRIC_PORT", "-1")
        os.environ.setdefault("DASHBOARD_METRIC_PORT", "-1")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    os.environ.setdefault("RAY_BACKEND_LOG_LEVEL", "fatal")
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("PYTHONWARNINGS", "ignore::DeprecationWarning")


def own_folder() -> Path | None:
    """The folder of the embedded Ray that this process belongs to; None where Ray is somebody else's."""
    import ray

    node = ray._private.worker._global_node
    folder = Path(os.environ.get(FOLDER, os.devnull))
    return folder if node is not None and folder in Path(node.temp_dir).parents else None
