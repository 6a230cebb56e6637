"""The server that takes jobs: whether it answers, before anything is uploaded to it."""

from __future__ import annotations

import json
import os
import urllib.error
import urllib.request
from collections.abc import Mapping
from pathlib import Path

from freemesh_ray.training.run_folder import RunError

#: Where Ray looks for the server, in this order, and where it is when nothing is said.
ADDRESSES, DEFAULT = ("RAY_API_SERVER_ADDRESS", "RAY_ADDRESS"), "http://127.0.0.1:8265"
#: Seconds.
PATIENCE = 10


def address(given: str | None, environment: Mapping[str, str] = os.environ) -> str:
    """The server's address: the one given, else the environment's, else this machine's.

    Raises:
        RunError: it is none of a server.
    """
    found = given or next((environment[name] for name in ADDRESSES if environment.get(name)), DEFAULT)
    if not found.startswith(("http://", "https://")):
        raise RunError(f"{found}: is not where jobs are taken: give --address http://HEAD:8265, the dashboard's")
    return found.rstrip("/")


def token(environment: Mapping[str, str] = os.environ) -> str:
    """The token that Ray would show, from where Ray has it; empty where there is none."""
    if environment.get("RAY_AUTH_TOKEN"):
        return environment["RAY_AUTH_TOKEN"].strip()
    path = Path(environment.get("RAY_AUTH_TOKEN_PATH") or Path.home() / ".ray" / "auth_token")
    return path.read_text().strip() if path.is_file() else ""


def submitted(url: str) -> set[str]:
    """The ids of the jobs that the server knows.

    Raises:
        RunError: it does not answer, or refuses the token.
    """
    request = urllib.request.Request(f"{url}/api/jobs/", headers={"Authorization": f"Bearer {token()}"})
    try:
        with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
            return {job["submission_id"] for job in json.load(answer)}
    except urllib.error.HTTPError as error:
        if error.code in (401, 403):
            raise RunError(
                f"{url}: asks for another token: set RAY_AUTH_MODE=token and RAY_AUTH_TOKEN to the cluster's"
            ) from error
        raise RunError(f"{url}: does not take jobs (HTTP {error.code}): give the dashboard's address") from error
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise RunError(f"{url}: is no dashboard of Ray: give the dashboard's address") from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "reason", error)
        raise RunError(f"{url}: cannot be reached ({reason}): start the cluster, or give --address") from error
