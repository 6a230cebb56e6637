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
from freemesh_ray.jobs import command as jobs_command
from freemesh_ray.local_ray import environment as ray_environment
from freemesh_ray.paper_tables import command as paper_command
from freemesh_ray.report import command as report_command
from freemesh_ray.serving import command as serve_command
from freemesh_ray.study import command as study_command

# One thread a process: on few cores, processes that each start a thread a core slow each other down many times over.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

INTERRUPTED = 130
BAD_INPUT = 2
FAILED = 1

#: A mean element quality below this deserves a word on the boundary.
POOR = 0.5

DESCRIPTION = """\
Reinforcement learning that meshes: an agent cuts one quadrilateral after another off the boundary of a 2-D domain
until nothing is left. All quads, the boundary kept exactly.

  freemesh train --config train_default.yaml      train over the curriculum T1 -> T2 -> T3
  freemesh study algorithms                       many trainings, compared as the paper does
  freemesh submit -- study algorithms             either as a job on a Ray cluster
  freemesh mesh part.geojson -o part.inp          mesh a polygon
  freemesh domains                                what is there to mesh
  freemesh compare D7 D8 D9                       our meshes beside those of other meshers
  freemesh paper quality                          the paper's tables, measured anew
  freemesh report algorithms                      a study's figure and table, with intervals
  freemesh serve                                  mesh over HTTP
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


def positive(text: str) -> float:
    """A positive, finite number, for argparse."""
    try:
        if 0.0 < (value := float(text)) < float("inf"):
            return value
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"{text!r}: give a number above 0")


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
        "  freemesh train --set name=try --set curriculum.stages='[T1]' --set budget.minutes=5\n\n"
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
        help="mesh a polygon",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Mesh a polygon: a file (GeoJSON, WKT, DXF, CSV, Gmsh .geo or .msh, JSON list of [x, y]; see\n"
        "docs/polygons.md), a name of the catalogue, random:SEED or part:SEED.",
        epilog="examples:\n"
        "  freemesh mesh part.geojson -o part.inp\n"
        "  freemesh mesh part.dxf --edge-length 2.5 --grading 3 -o part.msh -o part.png\n"
        "  freemesh mesh D4 -o d4.html                     a replay of the mesh growing\n"
        "  freemesh mesh D4 --best-of 8 --quadratic -o d4.bdf\n\n"
        "Of several polygons in a file, each gets a file of its own: part-0.inp, part-1.inp, ...",
    )
    mesh.add_argument("domain", metavar="POLYGON")
    mesh.add_argument("-o", "--output", required=True, action="append", metavar="OUT",
                      help="file to write: .inp .msh .vtu .bdf .obj (mesh), .png .svg (picture), .html (replay); "
                      "repeatable")  # fmt: skip
    outline = mesh.add_argument_group("boundary")
    outline.add_argument("--edge-length", type=positive, metavar="L",
                         help="split the outline into pieces of about this length; corners stay "
                         "(default: its vertices as they are)")  # fmt: skip
    outline.add_argument("--grading", type=positive, default=1.0, metavar="RATIO",
                         help="largest over smallest piece: finer at corners and small features (1)")  # fmt: skip
    outline.add_argument("--fix-parity", action="store_true", help="split the longest segment when the ring is odd")
    quality = mesh.add_argument_group("quality")
    quality.add_argument("--best-of", type=whole(1, 1000), default=1, metavar="K", help="the best of K meshes (1)")
    quality.add_argument("--seed", type=whole(0, 2**32 - 1), default=0, metavar="N", help="of all draws (0)")
    quality.add_argument("--no-smooth", dest="smooth", action="store_false", help="leave vertices where they were put")
    quality.add_argument("--no-clean", dest="clean", action="store_false", help="leave irregular vertices")
    quality.add_argument("--search", action="store_true",
                         help="for each element the best of several of the policy's draws, not its mean")  # fmt: skip
    quality.add_argument("--density", choices=["sparse", "medium", "dense"], default="medium",
                         help="how large elements grow inside (medium)")  # fmt: skip
    quality.add_argument("--policy", metavar="FILE",
                         help="policy.npz of a training (default: the shipped one of that density)")  # fmt: skip
    files = mesh.add_argument_group("files")
    files.add_argument("--quadratic", action="store_true", help="eight nodes an element")
    files.add_argument("--msh-version", choices=["4.1", "2.2"], default="4.1", help="of .msh files (4.1)")

    commands.add_parser(
        "domains", help="list the catalogue", description="List the domains that ship with the package."
    )

    study_command.grammar(commands)
    jobs_command.grammar(commands, whole)
    compare_command.grammar(commands)
    paper_command.grammar(commands, whole)
    report_command.grammar(commands, whole)
    serve_command.grammar(commands, whole, positive, seconds)

    bench = commands.add_parser(
        "bench", help="measure speeds on this machine", description="Measure environment, learner and sampling speed."
    )
    bench.add_argument(
        "--part",
        action="append",
        choices=["env", "learner", "sampling", "mesher", "serving", "curves", "algorithms", "gpu", "scaling"],
        metavar="PART",
        help="env, learner, sampling (default: these three), mesher, serving, gpu (batch sizes on CPU and CUDA), "
        "scaling (env runners and learners, long), curves or algorithms (against Stable-Baselines3, long); repeatable",
    )
    bench.add_argument("--policy", metavar="FILE", help="of the mesher (default: the shipped one)")
    bench.add_argument("--seconds", type=seconds, default=5.0, help="of each measurement (5)")
    bench.add_argument("--out", default="bench", metavar="FOLDER", help="where curves and scaling are written")
    commands.add_parser(
        "compile",
        help="compile all kernels now",
        description="Compile what meshing and training call, once, in about half a minute. An installation with make\n"
        "has done it; otherwise the first mesh and the first training do.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    sync = commands.add_parser(
        "sync",
        help="deliver what a tracking server missed",
        description="Deliver the metrics, files and models of a run, or of a study and its trials, that the tracking "
        "server did not get while it was away.",
    )
    sync.add_argument("folder", metavar="RUN", help="the run's folder, runs/NAME, or one above many")
    sync.add_argument("--uri", metavar="URI", help="another store than the run's own")
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; the exit code."""
    options = parser().parse_args(arguments)
    if options.command != "submit":  # which talks to somebody else's Ray
        ray_environment()
    from envs.types import DomainError
    from freemesh_ray.atomic import OutputError
    from freemesh_ray.checkpoint import CheckpointError
    from freemesh_ray.compare.mesh_file import MeshFileError
    from freemesh_ray.config import ConfigError
    from freemesh_ray.mesher import MeshingError
    from freemesh_ray.policy import PolicyError
    from freemesh_ray.runs import RunError, TrainingError

    try:
        return COMMANDS[options.command](options)
    except (DomainError, ConfigError, OutputError, PolicyError, RunError, CheckpointError, MeshFileError) as error:
        print(f"freemesh: {error}", file=sys.stderr)
        return BAD_INPUT
    except (MeshingError, TrainingError) as error:
        print(f"freemesh: {error}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        print("freemesh: interrupted", file=sys.stderr)
        return INTERRUPTED


def train(options: argparse.Namespace) -> int:
    """``freemesh train``."""
    from freemesh_ray import config
    from freemesh_ray.algorithms.device import check
    from freemesh_ray.console import Progress, train_table
    from freemesh_ray.local_ray import local_ray
    from freemesh_ray.places import Places
    from freemesh_ray.train import prepare
    from freemesh_ray.train import train as run

    settings = Places.here().settled(config.load(options.config, options.set))
    check(settings["learner"])
    prepare(settings, options.resume)
    progress = Progress(sys.stdout)
    with local_ray(settings["runners"]["count"] + settings["learner"]["count"]):
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


def submit(options: argparse.Namespace) -> int:
    """``freemesh submit``."""
    return jobs_command.run(options, parser().parse_args)


def mesh(options: argparse.Namespace) -> int:
    """``freemesh mesh``."""
    from envs.domain import load_all
    from freemesh_ray.api import SUFFIXES, mesh_domain
    from freemesh_ray.compiling import Shown
    from freemesh_ray.console import mesh_line
    from freemesh_ray.mesher.warm_up import NOTICE, warm_up
    from freemesh_ray.policy import SHIPPED, Policy

    outputs = [Path(output) for output in options.output]
    check_outputs(outputs, SUFFIXES)
    domains = load_all(
        options.domain, fix_parity=options.fix_parity, edge_length=options.edge_length, grading=options.grading
    )
    policy = Policy.load(options.policy or SHIPPED[options.density])
    warm_up(policy, Shown(sys.stderr, NOTICE).show)
    wishes = {key: getattr(options, key) for key in ("seed", "best_of", "search", "smooth", "clean")}
    for i, domain in enumerate(domains):
        made = mesh_domain(domain, policy, **wishes)
        paths = [path if len(domains) == 1 else path.with_stem(f"{path.stem}-{i}") for path in outputs]
        for path in paths:
            made.write(path, version=options.msh_version, quadratic=options.quadratic)
        figures = made.quality()
        print(mesh_line(made, figures, paths))
        if options.edge_length is None and figures["eta"] < POOR:
            print(
                f"{domain.name}: the {len(domain.segments)} boundary segments are coarse or uneven; "
                "--edge-length L splits them evenly",
                file=sys.stderr,
            )
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
    from freemesh_ray.policy import DEFAULT, Policy

    parts = options.part or ["env", "learner", "sampling"]
    policy = Policy.load(options.policy or DEFAULT)
    benches.run(parts, seconds=options.seconds, folder=Path(options.out), policy=policy)
    return 0


def compile_kernels(options: argparse.Namespace) -> int:
    """``freemesh compile``."""
    from freemesh_ray import compiling

    return compiling.run()


def sync(options: argparse.Namespace) -> int:
    """``freemesh sync``."""
    from freemesh_ray.places import Places
    from freemesh_ray.studies import StudyFolder
    from freemesh_ray.tracking import TrackingError
    from freemesh_ray.tracking import sync as deliver

    try:
        folder = Places.here().home / options.folder
        runs = StudyFolder(folder).run_folders()
        print(f"delivered {deliver(folder, options.uri, also=runs)} entries of {options.folder}")
    except TrackingError as error:
        print(f"freemesh: {error}", file=sys.stderr)
        return FAILED
    return 0


COMMANDS = {
    "train": train, "study": study_command.run, "submit": submit, "report": report_command.run, "mesh": mesh,
    "domains": domains, "compare": compare_command.run, "paper": paper_command.run, "serve": serve_command.run,
    "bench": bench, "compile": compile_kernels, "sync": sync,
}  # fmt: skip
