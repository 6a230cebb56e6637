"""Starting an embedded Ray, and ending it."""

from __future__ import annotations

import logging
import os
import signal
import sys
import tempfile
import threading
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from freemesh_ray.local_ray.private_folder import private_folder
from freemesh_ray.local_ray.session import Session
from freemesh_ray.local_ray.variables import FOLDER, environment
from freemesh_ray.storage.environment import variables_set

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


@contextmanager
def _in_groups_of_their_own() -> Iterator[None]:
    """Start Ray's processes in process groups of their own: signals to a command's group are for the command."""
    from ray._private import services

    before = services.ConsolePopen

    class Apart(before):  # type: ignore[misc, valid-type]
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, process_group=0, **options)

    services.ConsolePopen = Apart
    try:
        yield
    finally:
        services.ConsolePopen = before


def _start(slots: int, folder: Path) -> None:
    """Start a Ray with as many slots as processes, whatever the machine has: they share its cores."""
    import ray

    if os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] == "0":  # a Ray that was imported before does not know
        ray._private.ray_constants.ENABLE_RAY_CLUSTER = False
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
def _own_handler_of_sigterm() -> Iterator[None]:
    """Keep the handler of SIGTERM, if there is one: Ray sets its own, which ends the process."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGTERM)
    own = callable(before)
    try:
        yield
    except SystemExit as stop:
        if not own or stop.code != signal.SIGTERM:
            raise
        signal.signal(signal.SIGTERM, before)
        signal.raise_signal(signal.SIGTERM)
    finally:
        if own:
            signal.signal(signal.SIGTERM, before)


@contextmanager
def _temporary_files_in(folder: Path) -> Iterator[None]:
    """Keep files of Ray's and torch's, which would have names that others can guess, in a folder of our own."""
    ours = {FOLDER: str(folder), "RAY_TMPDIR": str(folder), "TORCHINDUCTOR_CACHE_DIR": str(folder / "torch")}
    with variables_set(ours):
        yield


@contextmanager
def local_ray(workers: int, fix: str = "start it again", *, supervised: bool = False) -> Iterator[Session]:
    """A Ray with room for ``workers`` processes, env runners and learners, beside the training's own.

    One that this process is connected to is used instead, and stays; else one whose address is in RAY_ADDRESS.

    Args:
        workers: as said.
        fix: what the line tells the user to do with which this process ends when processes of Ray's die.
        supervised: another process says a line when this one is killed; else Ray's guard does.

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
    # Of actors that fail it tells all; who called them tells what matters.
    for name in ("ray.rllib.utils.actor_manager", "ray.rllib.env.env_runner_group"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with ExitStack() as stack:
        if ray.is_initialized():
            yield Session()
        elif os.environ.get("RAY_ADDRESS"):
            stack.callback(ray.shutdown)
            with _own_handler_of_sigterm(), _without_its_greeting():
                ray.init(logging_level=logging.ERROR, log_to_driver=False)
            yield Session()
        else:
            folder = stack.enter_context(private_folder())
            stack.enter_context(_temporary_files_in(folder))
            session = stack.enter_context(Session(folder, fix, supervised=supervised))
            stack.callback(ray.shutdown)
            with _own_handler_of_sigterm(), _without_its_greeting(), _in_groups_of_their_own():
                _start(max(workers + 1, os.cpu_count() or 1), folder)
            session.watch()
            stack.callback(session.unwatch)
            yield session
