"""``freemesh submit``: its grammar, what is checked before anything is uploaded, and the line that it runs."""

from __future__ import annotations

import argparse
import os
import shlex
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from envs.errors import INTERRUPTED
from envs.printable import without_login
from freemesh_ray import config
from freemesh_ray.cli import study, train
from freemesh_ray.cli.arguments import Parser, add_command, whole
from freemesh_ray.config import check as check_setting
from freemesh_ray.config import paths
from freemesh_ray.config.schema import FOLDER
from freemesh_ray.formatting.terminal import note, say
from freemesh_ray.ray_jobs import job_server
from freemesh_ray.ray_jobs.package import check_size
from freemesh_ray.ray_jobs.submit_line import CPUS, RUNTIME_ENV, runtime_env, submission
from freemesh_ray.tracking import provenance
from freemesh_ray.training.run_folder import RunError

EPILOG = """\
examples:
  freemesh submit --address http://head:8265 -- train --config train_default.yaml --set name=mine
  freemesh submit --home /shared/freemesh --tracking http://mlflow:5000 -- study algorithms
  freemesh submit --print -- study algorithms     the line alone, to be run by hand

To be run in a checkout, whose code is uploaded. A job that was stopped, or lost its machine, goes on when the same is
submitted again: runs and studies lie below --home, on storage that all nodes see.
"""


def add(commands: Any) -> None:
    """Add the command to the grammar."""
    submit = add_command(
        commands,
        "submit",
        "train or study as a job on a Ray cluster",
        "Submit a training or a study to a Ray cluster as a job, and follow its logs.",
        EPILOG,
    )
    submit.add_argument("--address", metavar="URL", help="of the cluster's dashboard (RAY_API_SERVER_ADDRESS, "
                        "RAY_ADDRESS, else http://127.0.0.1:8265)")  # fmt: skip
    submit.add_argument("--home", metavar="DIR", default=os.environ.get(paths.HOME),
                        help="the cluster's folder for runs and studies (FREEMESH_HOME; ~/freemesh)")  # fmt: skip
    submit.add_argument("--tracking", metavar="URI", default=os.environ.get(paths.STORE),
                        help="MLflow's store (MLFLOW_TRACKING_URI; sqlite:///mlflow.db below the home)")  # fmt: skip
    submit.add_argument("--cpus", type=whole(0, 1024), metavar="N",
                        help="cores of the job's own process (train 1, study 0: it runs on the head)")  # fmt: skip
    submit.add_argument("--submission-id", metavar="ID", help="the job's name")
    submit.add_argument("--no-wait", dest="wait", action="store_false", help="do not follow the logs")
    submit.add_argument("--print", dest="dry", action="store_true", help="print the line and stop")
    submit.add_argument("line", nargs=argparse.REMAINDER, metavar="-- train|study ...", help="what to run")


def run(options: argparse.Namespace) -> int:
    """Check, print and run the line; the exit code is that of ``ray job submit``.

    Raises:
        ConfigError, RunError, DomainError, PluginError: what is wrong with the input.
    """
    command = options.line[1:] if options.line[:1] == ["--"] else options.line
    name, plug_ins = checked(command)
    if any(without_login(word) != word for word in [*command, options.tracking or ""]):
        raise RunError(
            "submit: an address with a password would be in the job's line, for all to see: "
            "set MLFLOW_TRACKING_USERNAME and MLFLOW_TRACKING_PASSWORD on the cluster"
        )
    if options.home:
        check_setting(options.home, FOLDER, "--home", "the home")
    url = job_server.address(options.address)
    variables = {
        paths.HOME: options.home, paths.STORE: options.tracking,
        provenance.GIVEN: provenance.provenance().get(provenance.COMMIT),
    }  # fmt: skip
    environment = runtime_env(RUNTIME_ENV, {key: value for key, value in variables.items() if value}, plug_ins)
    cpus = CPUS[command[0]] if options.cpus is None else options.cpus
    job = options.submission_id or f"{name}-{time.strftime('%Y%m%d-%H%M%S')}"
    id_ = options.submission_id if options.dry else job  # a line that is printed can be run again
    line = submission(url, command, environment, cpus=cpus, submission_id=id_, wait=options.wait)
    say(shlex.join(line))
    if options.dry:
        return 0
    if job in job_server.submitted(url):
        raise RunError(
            f"{job}: a job was submitted under this id before: give another --submission-id, or none; "
            f"`{shlex.join(['ray', 'job', 'delete', '--address', url, job])}` forgets one that is over"
        )
    check_size(Path.cwd(), environment.get("excludes", []))
    try:
        return follow(line)
    except KeyboardInterrupt:
        at = shlex.join(["--address", url, job])
        note(f"\nthe job goes on: `ray job logs {at} --follow`; `ray job stop {at}` ends it")
        return INTERRUPTED


def follow(line: Sequence[str]) -> int:
    """Run a line of ``ray``, the one beside this Python; its exit code."""
    return subprocess.run([str(Path(sys.executable).with_name("ray")), *line[1:]]).returncode


def line_parser() -> argparse.ArgumentParser:
    """The grammar of the lines that can be submitted."""
    top = Parser(prog="freemesh")
    commands = top.add_subparsers(dest="command", required=True, parser_class=Parser)
    for command in (train, study):
        command.add(commands)
    return top


def checked(command: Sequence[str]) -> tuple[str, list[str]]:
    """The name of what a line would run, once it is known that it can be, and the plug-ins that it names.

    Raises:
        ConfigError, RunError, DomainError, PluginError: what is wrong with it.
    """
    if not command or command[0] not in CPUS:
        raise RunError("submit: give what to run: -- train ..., or -- study NAME ...")
    if not (RUNTIME_ENV.is_file() and Path("freemesh_ray").is_dir()):
        raise RunError(f"{Path.cwd()}: is no checkout of freemesh-ray, whose code a job is: submit from one")
    options = line_parser().parse_args(command)
    if options.command == "train":
        from freemesh_ray.training.job import check_plug_ins, check_stages

        files, settings = options.config, config.load(options.config, options.set)
        check_stages(settings)
        check_plug_ins(settings)
        name, trees = settings["name"], [settings]
    else:
        from freemesh_ray.api.run_study import check, trees_of
        from freemesh_ray.studies.definition import load

        if options.study is None:
            raise RunError("submit: study: give a study's name, or its YAML file")
        files, studied = [options.study], load(options.study, options.set, smoke=options.smoke)
        check(studied)
        name, trees = studied.name, trees_of(studied)
    for file in files:
        if Path(file).is_absolute() or ".." in Path(file).parts:
            raise RunError(f"{file}: lies outside the folder that is uploaded: copy it into {Path.cwd()}")
    plug_ins = dict.fromkeys(spec for tree in trees for spec in config.plug_ins_named(tree))
    return f"{options.command}-{name}", list(plug_ins)
