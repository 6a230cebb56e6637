"""What the scripts of this folder share: how they are started, and how they say what is wrong."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from importlib.util import find_spec
from typing import NoReturn

from envs.errors import INTERRUPTED, UserError
from freemesh_ray.local_ray import environment


def run_script(main: Callable[[], None]) -> NoReturn:
    """Run a script's ``main`` with one thread a process, and exit: what a user can mend is one line on stderr."""
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    environment()
    try:
        main()
    except UserError as error:
        print(f"{os.path.basename(sys.argv[0])}: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    sys.exit(0)


def require_stable_baselines() -> None:
    """Refuse to begin without Stable-Baselines3.

    Raises:
        UserError: it is not installed.
    """
    if find_spec("stable_baselines3") is None:
        raise UserError("Stable-Baselines3 is not installed: pip install stable-baselines3")
