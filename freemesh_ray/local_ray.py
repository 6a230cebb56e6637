"""An embedded Ray for one command: quiet, local, gone when the command is."""

from __future__ import annotations

import logging
import os
import secrets
import shutil
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from freemesh_ray.storage.atomic import OutputError
from freemesh_ray.storage.lock import FILE, InUseError, held

#: Ray gives itself half a minute to start, which a busy machine may not have.
ATTEMPTS = 5

#: What the folder of an embedded Ray begins with.
FOLDER = "ray-"

#: Bytes of a socket's path at most (`sun_path` less its zero), and the longest that Ray adds to its folder, which is
#: one within ours: Ray opens it to everybody.
SOCKET_PATH = 103 if sys.platform == "darwin" else 107
SOCKET = "/r/session_2026-01-01_00-00-00_000000_4194304/sockets/plasma_store.0"

#: A folder younger than this may be about to be locked.
NEW_SECONDS = 60.0

#: Where Ray's folder may lie besides the user's own place for temporary files, the first that will do.
SHORT_FOLDERS = ("/tmp", "/dev/shm", "/var/tmp")


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


@contextmanager
def private_folder(environment: Mapping[str, str] = os.environ) -> Iterator[Path]:
    """A folder of this user's alone for the sockets and logs of a Ray, with a path as short as sockets need it.

    It lies below RAY_TMPDIR, which nothing replaces, or below TMPDIR or the first of `SHORT_FOLDERS` that is short
    enough and can be written to. It is locked, and removed at the end; what a killed process left there is removed too.

    Raises:
        OutputError: there is no such place.
    """
    own = environment.get("RAY_TMPDIR")
    parents = [own] if own else [environment.get("TMPDIR") or "/tmp", *SHORT_FOLDERS]
    for parent in parents:
        try:
            folder = Path(tempfile.mkdtemp(prefix=FOLDER, dir=parent)).resolve()
        except OSError:
            continue
        try:
            if len(os.fsencode(folder)) + len(SOCKET) <= SOCKET_PATH:
                with held(folder, "wait") as locked:
                    if locked:
                        _remove_left(Path(parent))
                    yield folder
                return
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    raise OutputError(
        f"{', '.join(dict.fromkeys(parents))}: no place for Ray's sockets: set RAY_TMPDIR to a folder that can be "
        f"written to, with a path of {SOCKET_PATH - len(SOCKET) - len(f'/{FOLDER}12345678')} bytes at most"
    )


def _remove_left(parent: Path) -> None:
    """Remove the folders of this user's below ``parent`` that nobody holds any more."""
    for folder in parent.glob(f"{FOLDER}*/{FILE}"):
        with suppress(OSError, InUseError):
            about = folder.stat()
            if about.st_uid == os.getuid() and time.time() - about.st_mtime > NEW_SECONDS:
                with held(folder.parent, "wait"):
                    shutil.rmtree(folder.parent, ignore_errors=True)


def _start(slots: int, folder: Path) -> None:
    """Start a Ray with as many slots as processes, whatever the machine has: they share its cores."""
    import ray

    for attempt in range(ATTEMPTS):
        try:
            ray.init(
                num_cpus=slots, include_dashboard=False, logging_level=logging.ERROR, log_to_driver=False,
                _temp_dir=str(folder / "r"),
            )  # fmt: skip
            return
        except Exception as error:
            ray.shutdown()
            if "timed out during startup" not in str(error) or attempt == ATTEMPTS - 1:
                raise


@contextmanager
def local_ray(workers: int) -> Iterator[None]:
    """A Ray with room for ``workers`` processes, env runners and learners, beside the training's own.

    An address in RAY_ADDRESS is used instead.

    Raises:
        OutputError: see `private_folder`.
    """
    environment()
    warnings.filterwarnings("ignore", category=DeprecationWarning)
    # RLlib registers its one environment name again for every algorithm.
    warnings.filterwarnings("ignore", message=".*Overriding environment rllib.*")
    import ray

    logging.getLogger("ray").setLevel(logging.ERROR)
    logging.getLogger("ray.rllib").setLevel(logging.ERROR)
    with ExitStack() as stack:
        with _without_its_greeting():
            if os.environ.get("RAY_ADDRESS"):
                ray.init(logging_level=logging.ERROR, log_to_driver=False)
            else:
                _start(max(workers + 1, os.cpu_count() or 1), stack.enter_context(private_folder()))
        stack.callback(ray.shutdown)
        yield
