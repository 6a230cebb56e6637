"""``freemesh sync``: what a tracking server missed is delivered."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from envs.errors import UserError
from freemesh_ray.cli.arguments import add_command, add_settings
from freemesh_ray.formatting.terminal import say


def add(commands: Any) -> None:
    """Add the command to the grammar."""
    sync = add_command(
        commands,
        "sync",
        "deliver what a tracking server missed",
        "Deliver the metrics, files and models of a run, or of a study and its trials, that the tracking server did\n"
        "not get while it was away: of runs below paths.runs and paths.studies, to tracking.uri.",
    )
    sync.add_argument("folder", metavar="RUN", help="the run's folder, runs/NAME, or one above many")
    sync.add_argument("--uri", metavar="URI", help="another store than tracking.uri says; it gets everything")
    add_settings(sync, "that says where: paths.runs, paths.studies, tracking.uri")


def run(options: argparse.Namespace) -> int:
    """Deliver.

    Raises:
        ConfigError: a setting is wrong.
        StudyError: the study's list of trials is damaged.
        TrackingError: the store cannot be reached, or not all could be delivered.
        UserError: there is no such folder.
    """
    from freemesh_ray import config
    from freemesh_ray.config.paths import Paths
    from freemesh_ray.config.store_login import set_aside
    from freemesh_ray.studies.study_folder import StudyFolder
    from freemesh_ray.tracking import sync

    paths = Paths.from_environment()
    settings = paths.resolved(config.load([], options.set))
    folder = paths.home / options.folder
    if not folder.is_dir():
        raise UserError(f"{options.folder}: no such folder: give a run's folder, or one above many")
    if options.uri is not None:
        config.check(set_aside(options.uri), config.SCHEMA["tracking.uri"], "--uri", "the store")
    count = sync(
        folder,
        options.uri or settings["tracking"]["uri"],
        within=[Path(path) for path in settings["paths"].values()],
        also=StudyFolder(folder).run_folders(),
        elsewhere=options.uri is not None,
    )
    say(f"delivered {count} entries of {options.folder}" if count else f"{options.folder}: nothing to deliver")
    return 0
