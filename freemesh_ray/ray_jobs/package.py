"""What a job uploads: the checkout, packed as Ray packs it, and whether a cluster takes that much."""

from __future__ import annotations

import logging
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

from freemesh_ray.training.run_folder import RunError

MIB = 2**20


def check_size(checkout: Path, excludes: Sequence[str]) -> None:
    """Refuse a checkout that Ray would not upload.

    Args:
        checkout: what is packed, without what .gitignore names.
        excludes: patterns as in .gitignore, of what is left out besides.

    Raises:
        RunError: it is too large, or cannot be packed.
    """
    from ray._private import ray_constants
    from ray._private.runtime_env import packaging

    # What the dashboard takes in a request, and what the cluster passes on.
    limit = min(ray_constants.DASHBOARD_CLIENT_MAX_SIZE, packaging.GCS_STORAGE_MAX_SIZE)
    try:
        with tempfile.TemporaryDirectory() as place:
            package = Path(place) / "package.zip"
            quiet = logging.getLogger(f"{__name__}.ray")
            quiet.setLevel(logging.ERROR)
            packaging.create_package(str(checkout), package, True, excludes=list(excludes), logger=quiet)
            size = package.stat().st_size
            largest = max(zipfile.ZipFile(package).infolist(), key=lambda entry: entry.compress_size)
    except OSError as error:
        raise RunError(f"{checkout}: cannot be packed ({error.strerror or error}): see to it, then submit") from error
    if size >= limit:
        raise RunError(
            f"{checkout}: would upload {size / MIB:,.0f} MiB, Ray takes {limit / MIB:,.0f}: name {largest.filename} "
            f"({largest.compress_size / MIB:,.0f} MiB) in .gitignore, or move it away"
        )
