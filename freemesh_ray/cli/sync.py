"""``freemesh sync``: what a tracking server missed is delivered."""

from __future__ import annotations

import argparse
from typing import Any

from freemesh_ray.cli.arguments import add_command


def add(commands: Any) -> None:
    """Add the command to the grammar."""
    sync = add_command(
        commands,
        "sync",
        "deliver what a tracking server missed",
        "Deliver the metrics, files and models of a run, or of a study and its trials, that the tracking server did\n"
        "not get while it was away.",
    )
    sync.add_argument("folder", metavar="RUN", help="the run's folder, runs/NAME, or one above many")
    sync.add_argument("--uri", metavar="URI", help="another store than the run's own")


def run(options: argparse.Namespace) -> int:
    """Deliver.

    Raises:
        TrackingError: the store cannot be reached.
    """
    from freemesh_ray.config.paths import Paths
    from freemesh_ray.studies.study_folder import StudyFolder
    from freemesh_ray.tracking import sync

    folder = Paths.from_environment().home / options.folder
    runs = StudyFolder(folder).run_folders()
    print(f"delivered {sync(folder, options.uri, also=runs)} entries of {options.folder}")
    return 0
