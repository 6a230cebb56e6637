"""The ``freemesh`` command: parse, call, print. What is wrong with the input is one line and exit code 2."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NoReturn

from freemesh_ray.compare import command as compare_command
from freemesh_ray.paper_tables import command as paper_command

# One thread a process: on few cores, processes that each start a thread a core slow each other down many times over.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

INTERRUPTED = 130
BAD_INPUT = 2
FAILED = 1

DESCRIPTION = """\
Reinforcement learning that meshes: an agent cuts one quadrilateral after another off the boundary of a 2-D domain
until nothing is left. All quads, the boundary kept exactly.

  freemesh train --config train_default.yaml      train over the curriculum T1 -> T2 -> T3
  freemesh mesh part.geojson -o part.inp          mesh a polygon with a trained policy
  freemesh domains                                what is there to mesh
  freemesh compare D7 D8 D9                       our meshes beside those of other meshers
  freemesh paper quality                          the paper's tables, measured anew
  freemesh bench                                  how fast it is here
"""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(BAD_INPUT, f"{self.prog}: {message}; see {self.prog} --help\n")


def whole(low: int, high: int) -> Callable[[str], int]:
    """A whole number in [low, high], for argparse."""

    def number(text: str) -> int:
        try:
            if low <= (value := int(text)) <= high:
                return value
        except ValueError:
            pass
        raise argparse.ArgumentTypeError(f"{text!r}: give a whole number in [{low}, {high}]")

    return number


def seconds(text: str) -> float:
    """A positive, finite duration, for argparse."""
    try:
        if 0.0 < (value := float(text)) < 86_400.0:
            return value
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"{text!r}: give a number of seconds above 0, below a day")


def parser() -> argparse.ArgumentParser:
    """The command's grammar."""
    top = _Parser(prog="freemesh", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND", parser_class=_Parser)

    train = commands.add_parser(
        "train",
        help="train a policy",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Train a policy, keep the best one, and mesh every training domain with it.",
        epilog="examples:\n"
        "  freemesh train --config train_default.yaml --resume\n"
        "  freemesh train --set name=try --set sac.gamma=0.95 --set curriculum.stages='[T1]' --set budget.minutes=5\n\n"
        "Files named without a folder are looked for in tune_configs, too. Every key and its meaning stands in\n"
        "tune_configs/defaults.yaml. Ctrl-C saves a checkpoint; the same command with --resume goes on from it.",
    )
    train.add_argument(
        "--config", action="append", default=[], metavar="FILE", help="YAML overlay on the defaults; repeatable"
    )
    train.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="one setting; comes last; repeatable"
    )
    train.add_argument("--resume", action="store_true", help="go on from the run's last checkpoint, if there is one")

    mesh = commands.add_parser(
        "mesh",
        help="mesh a domain with a trained policy",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Mesh a domain: a catalogue name, random:SEED, or a file (GeoJSON, WKT, JSON list of [x, y]).",
        epilog="examples:\n"
        "  freemesh mesh D4 -o d4.png\n"
        "  freemesh mesh part.geojson -o part.inp --policy runs/default/policy.npz",
    )
    mesh.add_argument("domain", metavar="DOMAIN")
    mesh.add_argument("-o", "--output", required=True, action="append", metavar="OUT",
                      help="file to write: .vtu .msh .inp (mesh), .png .svg (picture); repeatable")  # fmt: skip
    mesh.add_argument("--policy", metavar="FILE", help="policy.npz of a training (default: that of the newest run)")
    mesh.add_argument("--runs", default="runs", metavar="FOLDER", help="where the newest run is looked for")
    mesh.add_argument("--fix-parity", action="store_true", help="split the longest segment when the ring is odd")
    mesh.add_argument(
        "--attempts", type=whole(0, 1000), default=32, metavar="N", help="sampled if the first fails (32)"
    )
    mesh.add_argument("--seed", type=whole(0, 2**32 - 1), default=0, metavar="N", help="of the sampling (0)")

    commands.add_parser(
        "domains", help="list the catalogue", description="List the domains that ship with the package."
    )

    compare_command.grammar(commands)
    paper_command.grammar(commands, whole)

    bench = commands.add_parser(
        "bench", help="measure speeds on this machine", description="Measure environment, learner and sampling speed."
    )
    bench.add_argument(
        "--part",
        action="append",
        choices=["env", "learner", "sampling", "mesher", "curves"],
        metavar="PART",
        help="env, learner, sampling (default: these three), mesher (needs a policy) or curves (against "
        "Stable-Baselines3, long); repeatable",
    )
    bench.add_argument("--policy", metavar="FILE", help="of the mesher (default: that of the newest run)")
    bench.add_argument("--runs", default="runs", metavar="FOLDER", help="where the newest run is looked for")
    bench.add_argument("--seconds", type=seconds, default=5.0, help="of each measurement (5)")
    bench.add_argument("--out", default="bench", metavar="FOLDER", help="where curves are written")
    sync = commands.add_parser(
        "sync",
        help="deliver what a tracking server missed",
        description="Deliver the metrics and files of a run that its tracking server did not get while it was away.",
    )
    sync.add_argument("folder", metavar="RUN", help="the run's folder, runs/NAME")
    sync.add_argument("--uri", metavar="URI", help="another store than the run's own")
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; the exit code."""
    options = parser().parse_args(arguments)
    from envs.types import DomainError
    from freemesh_ray.atomic import OutputError
    from freemesh_ray.checkpoint import CheckpointError
    from freemesh_ray.compare.mesh_file import MeshFileError
    from freemesh_ray.config import ConfigError
    from freemesh_ray.mesher import MeshingError
    from freemesh_ray.policy import PolicyError
    from freemesh_ray.runs import RunError

    try:
        return COMMANDS[options.command](options)
    except (DomainError, ConfigError, OutputError, PolicyError, RunError, CheckpointError, MeshFileError) as error:
        print(f"freemesh: {error}", file=sys.stderr)
        return BAD_INPUT
    except MeshingError as error:
        print(f"freemesh: {error}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        print("freemesh: interrupted", file=sys.stderr)
        return INTERRUPTED


def train(options: argparse.Namespace) -> int:
    """``freemesh train``."""
    from freemesh_ray import config
    from freemesh_ray.console import Progress, train_table
    from freemesh_ray.local_ray import local_ray
    from freemesh_ray.train import prepare
    from freemesh_ray.train import train as run

    settings = config.load(options.config, options.set)
    prepare(settings, options.resume)
    progress = Progress(sys.stdout)
    with local_ray(settings["runners"]["count"]):
        from freemesh_ray.algorithms.build import build

        stop = StopSignal()
        trained = run(
            settings,
            resume=options.resume,
            make=build,
            report=progress.show,
            note=progress.note,
            interrupted=stop.was_given,
        )
    progress.finish()
    print(train_table(trained, settings))
    return 0


class StopSignal:
    """Ctrl-C, or a scheduler's SIGTERM: remembered, so that training stops between two iterations and loses nothing.

    A second one interrupts at once. To be made after Ray is started, which sets a handler of its own.
    """

    def __init__(self) -> None:
        self._given = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._remember)

    def _remember(self, number: int, frame: object) -> None:
        if self._given:
            raise KeyboardInterrupt
        self._given = True

    def was_given(self) -> bool:
        """Whether to stop."""
        return self._given


def mesh(options: argparse.Namespace) -> int:
    """``freemesh mesh``."""
    from envs.domain import load
    from freemesh_ray import export, mesher, plots
    from freemesh_ray.console import mesh_line
    from freemesh_ray.policy import Policy
    from freemesh_ray.runs import newest_policy

    outputs = [Path(output) for output in options.output]
    check_outputs(outputs, (*export.SUFFIXES, *plots.SUFFIXES))
    domain = load(options.domain, fix_parity=options.fix_parity)
    policy = Policy.load(options.policy or newest_policy(Path(options.runs)))
    made = mesher.mesh(policy, domain, attempts=options.attempts, seed=options.seed)
    for path in outputs:
        if path.suffix.lower() in plots.SUFFIXES:
            plots.draw_mesh(made, path)
        else:
            export.write(made, path)
    print(mesh_line(made, outputs))
    return 0


def check_outputs(paths: Sequence[Path], known: Sequence[str]) -> None:
    """Before any work: every output has a known format and a place that can be written to.

    Raises:
        OutputError: one has not.
    """
    from freemesh_ray.atomic import OutputError, check_writable

    for path in paths:
        if path.suffix.lower() not in known:
            raise OutputError(f"{path}: unknown format {path.suffix or '(none)'}: use one of {', '.join(known)}")
        check_writable(path)


def domains(options: argparse.Namespace) -> int:
    """``freemesh domains``."""
    from envs.domain import catalogue, load
    from freemesh_ray.console import domain_table

    print(domain_table([load(name) for name in catalogue()]))
    return 0


def bench(options: argparse.Namespace) -> int:
    """``freemesh bench``."""
    from freemesh_ray import bench as benches
    from freemesh_ray.policy import Policy
    from freemesh_ray.runs import newest_policy

    parts = options.part or ["env", "learner", "sampling"]
    policy = Policy.load(options.policy or newest_policy(Path(options.runs))) if "mesher" in parts else None
    benches.run(parts, seconds=options.seconds, folder=Path(options.out), policy=policy)
    return 0


def sync(options: argparse.Namespace) -> int:
    """``freemesh sync``."""
    from freemesh_ray.tracking import TrackingError
    from freemesh_ray.tracking import sync as deliver

    try:
        print(f"delivered {deliver(options.folder, options.uri)} entries of {options.folder}")
    except TrackingError as error:
        print(f"freemesh: {error}", file=sys.stderr)
        return FAILED
    return 0


COMMANDS = {
    "train": train, "mesh": mesh, "domains": domains, "compare": compare_command.run, "paper": paper_command.run,
    "bench": bench, "sync": sync,
}  # fmt: skip
