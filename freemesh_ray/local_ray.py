"""An embedded Ray for one command: quiet, local, gone when the command is."""

from __future__ import annotations

import logging
import os
import secrets
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

#: Ray gives itself half a minute to start, which a busy machine may not have.
ATTEMPTS = 5


@contextmanager
def _without_its_greeting() -> Iterator[None]:
    """Keep the line with which Ray's C++ part announces the log level that silences it off stderr."""
    sys.stderr.flush()
    saved = os.dup(2)
    with tempfile.TemporaryFile() as caught:
        os.dup2(caught.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(saved, 2)
            os.close(saved)
            caught.seek(0)
            for line in caught.read().decode(errors="replace").splitlines():
                if "Set ray log level" not in line:
                    print(line, file=sys.stderr)


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
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    os.environ.setdefault("RAY_BACKEND_LOG_LEVEL", "fatal")
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("PYTHONWARNINGS", "ignore::DeprecationWarning")


def _start(slots: int) -> None:
    """Start a Ray with as many slots as processes, whatever the machine has: they share its cores."""
    import ray

    for attempt in range(ATTEMPTS):
        try:
            ray.init(num_cpus=slots, include_dashboard=False, logging_level=logging.ERROR, log_to_driver=False)
            return
        except Exception as error:
            ray.shutdown()
            if "timed out during startup" not in str(error) or attempt == ATTEMPTS - 1:
                raise


@contextmanager
def local_ray(workers: int) -> Iterator[None]:
    """A Ray with room for ``workers`` processes, env runners and learners, beside the training's own.

    An address in RAY_ADDRESS is used instead.
    """
    environment()
    warnings.filterwarnings("ignore", category=DeprecationWarning)
    # RLlib registers its one environment name again for every algorithm.
    warnings.filterwarnings("ignore", message=".*Overriding environment rllib.*")
    import ray

    logging.getLogger("ray").setLevel(logging.ERROR)
    logging.getLogger("ray.rllib").setLevel(logging.ERROR)
    with _without_its_greeting():
        if os.environ.get("RAY_ADDRESS"):
            ray.init(logging_level=logging.ERROR, log_to_driver=False)
        else:
            _start(slots=max(workers + 1, os.cpu_count() or 1))
    try:
        yield
    finally:
        ray.shutdown()
