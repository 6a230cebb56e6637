"""The ``freemesh`` command: parse, call, print. What is wrong with the input is one line and exit code 2."""

from __future__ import annotations

import argparse
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from types import FrameType

from envs.errors import INTERRUPTED, UserError
from freemesh_ray.cli import (
    bench,
    compare,
    compile,
    convergence,
    domains,
    mesh,
    paper,
    report,
    serve,
    study,
    submit,
    sync,
    train,
)  # fmt: skip
from freemesh_ray.cli.arguments import Parser
from freemesh_ray.formatting import terminal
from freemesh_ray.formatting.terminal import OutputLostError, note
from freemesh_ray.local_ray import environment as ray_environment

# One thread a process: on few cores, processes that each start a thread a core slow each other down many times over.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

#: The commands in the order of the help; each file has ``add(commands)`` and ``run(options) -> exit code``.
COMMANDS = {
    "mesh": mesh, "domains": domains, "train": train, "study": study, "report": report, "submit": submit,
    "sync": sync, "compare": compare, "convergence": convergence, "paper": paper, "serve": serve, "bench": bench,
    "compile": compile,
}  # fmt: skip

DESCRIPTION = """\
Reinforcement learning that meshes: an agent cuts one quadrilateral after another off the region of a 2-D domain
that is not meshed until it is used up. All quads, the boundary kept exactly.

  freemesh mesh part.geojson -o part.inp          mesh a polygon
  freemesh train --config train_default.yaml      train over the curriculum T1 -> T2 -> T3
  freemesh study algorithms                       many trainings, compared as the paper does
"""


def parser() -> argparse.ArgumentParser:
    """The grammar of all commands."""
    top = Parser(prog="freemesh", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter)
    top.add_argument("--version", action="version", version=f"freemesh-ray {version('freemesh-ray')}")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND", parser_class=Parser)
    for command in COMMANDS.values():
        command.add(commands)
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; the exit code."""
    terminal.prepare()
    try:
        options = parser().parse_args(arguments)
        if getattr(options, "ray", None):
            os.environ["RAY_ADDRESS"] = options.ray
        if options.command != "submit":  # which talks to somebody else's Ray
            ray_environment()
        with _ended_by_signals():
            return COMMANDS[options.command].run(options)
    except UserError as error:
        note(f"freemesh: {error}")
        return error.exit_code
    except OutputLostError as lost:
        if lost.reason:
            note(f"freemesh: standard output cannot be written ({lost.reason}): send it elsewhere")
        return lost.exit_code
    except KeyboardInterrupt:
        note("freemesh: interrupted")
        return INTERRUPTED


@contextmanager
def _ended_by_signals() -> Iterator[None]:
    """Let a scheduler's signal, and that of a terminal that is closed, be what Ctrl-C is."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:  # as `nohup` leaves it
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, _interrupt) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt
