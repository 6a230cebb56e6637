"""The services of compose.yaml as plain processes on the loopback device, by its command lines and health checks.

Replaced is only what containers give: a host name by 127.0.0.1, a port by a free one, a volume by a folder, and what
Postgres' image does before it starts the server.
"""

from __future__ import annotations

import os
import pwd
import re
import secrets
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Self

import manifests
from manifests import DEPLOY, ROOT, SERVICES
from processes import free_port

sys.path.append(f"{Path(find_spec('ray').origin).parent}/thirdparty_files")
import psutil  # Ray's own

#: A node without what the tests do not look at.
LIGHT = {"RAY_enable_metrics_collection": "0", "RAY_enable_open_telemetry": "0", "RAY_enable_worker_prestart": "0"}
PORTS = ("6379", "8265", "52365", "5000", "5432")


def postgres_programs() -> Path | None:
    """The folder of Postgres' programs, on Debian outside PATH and the newest; None without it."""
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin"), key=lambda path: int(path.parent.name))
    found += [Path(path).parent for path in [shutil.which("initdb")] if path and not found]
    return found[-1] if found else None


@contextmanager
def vanishing() -> Iterator[None]:
    """Look at a process that may end meanwhile."""
    with suppress(psutil.NoSuchProcess):
        yield


class Topology:
    """The services, in a ``with`` block: healthy when it begins, gone when it ends.

    Attributes:
        folder: holds the volumes, ``shared`` and ``artifacts``, and ``tmp``; a short path, Ray's sockets being below.
        secrets: what compose.yaml takes from the environment, made up for this time.
    """

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="freemesh-"))
        self.secrets = {name: secrets.token_hex(32) for name in manifests.required_variables()}
        self._ports = {port: str(free_port()) for port in PORTS}
        self._started: dict[str, psutil.Popen] = {}

    def here(self, text: str) -> str:
        """A text of the deployment as it must be on this machine."""
        text = manifests.expanded(text, self.secrets)
        text = re.sub(r"\b(head|mlflow|postgres)(?=:\d)|\b0\.0\.0\.0\b", "127.0.0.1", text)
        text = re.sub(rf"\b({'|'.join(PORTS)})\b", lambda match: self._ports[match[1]], text)
        return re.sub(r"(?<![\w./])/(?=(shared|artifacts|tmp|etc)\b)", f"{self.folder}/", text)

    def environment(self, name: str) -> dict[str, str]:
        """What the image and compose.yaml tell a service; its programs are this Python's."""
        told = manifests.image_environment() | SERVICES[name]["environment"]
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        own = {"PATH": path, "PYTHONPATH": str(ROOT), "LANG": "C.UTF-8"}
        if name in ("head", "worker"):
            own |= LIGHT
        if name == "postgres":  # its programs would look for a socket below /var/run
            own |= {"PGHOST": "127.0.0.1", "PGPORT": self._ports["5432"]}
        return {key: self.here(value) for key, value in told.items()} | own

    def run(self, name: str, command: list[str], **variables: str) -> subprocess.CompletedProcess[str]:
        """Run a command to its end as a service would."""
        environment = self.environment(name) | variables
        return subprocess.run(
            command, env=environment, cwd=self.folder / "shared", capture_output=True, text=True, timeout=180
        )

    def processes(self) -> list[psutil.Process]:
        """Those that run: the services' own and all that came of them."""
        running = [process for process in self._started.values() if process.is_running()]
        return [*running, *(child for process in running for child in process.children(recursive=True))]

    def _start(self, name: str, command: list[str], **options: Any) -> None:
        """Start a service's process."""
        options = {"env": self.environment(name), "cwd": self.folder / "shared"} | options
        with (self.folder / f"{name}.log").open("wb") as log:
            self._started[name] = psutil.Popen(command, stdout=log, stderr=log, start_new_session=True, **options)

    def _wait(self, *names: str) -> None:
        """Wait until the health checks of started services succeed."""
        deadline = time.monotonic() + 300
        for name in names:
            check = [self.here(word) for word in SERVICES[name]["healthcheck"]["test"][1:]]
            while self.run(name, check).returncode:
                if self._started[name].poll() is not None or time.monotonic() > deadline:
                    raise RuntimeError(f"{name} is not healthy:\n{(self.folder / f'{name}.log').read_text()}")
                time.sleep(0.5)

    def _start_postgres(self) -> None:
        """As its image does: a user whose password the network must give, its database, and the server.

        Postgres refuses to be root, which tests may be.
        """
        programs, told = postgres_programs(), self.environment("postgres")
        data, password = self.folder / "postgres", self.folder / "password"
        data.mkdir()
        password.touch(0o600)
        password.write_text(told["POSTGRES_PASSWORD"])
        options: dict[str, Any] = {"env": told, "cwd": data}
        if os.geteuid() == 0:
            user = pwd.getpwnam("postgres")
            options |= {"user": user.pw_uid, "group": user.pw_gid, "extra_groups": []}
            os.chown(data, user.pw_uid, user.pw_gid)
            os.chown(password, user.pw_uid, user.pw_gid)
            self.folder.chmod(0o711)
        make = ["--pgdata", str(data), "--username", told["POSTGRES_USER"], "--pwfile", str(password)]
        make += ["--auth", "scram-sha-256", "--locale", "C.UTF-8", "--no-sync"]
        subprocess.run([f"{programs}/initdb", *make], check=True, stdout=subprocess.DEVNULL, **options)
        listen = ["-h", "127.0.0.1", "-p", told["PGPORT"], "-k", str(data), "-c", "fsync=off"]
        self._start("postgres", [f"{programs}/postgres", "-D", str(data), *listen], **options)
        self._wait("postgres")
        login = {"PGUSER": told["POSTGRES_USER"], "PGPASSWORD": told["POSTGRES_PASSWORD"]}
        assert self.run("postgres", [f"{programs}/createdb", told["POSTGRES_DB"]], **login).returncode == 0

    def _start_ray(self, name: str, agent: str, *added: str) -> None:
        """A node; what one machine has only once, its address and these ports, each container has for itself."""
        command = [self.here(word) for word in SERVICES[name]["command"]]
        alone = ["--node-ip-address=127.0.0.1", f"--dashboard-agent-listen-port={agent}"]
        self._start(name, [*command, *alone, f"--temp-dir={self.folder}/tmp/{name}", *added])

    def __enter__(self) -> Self:
        for name in ("shared", "artifacts", "tmp", "etc"):
            (self.folder / name).mkdir()
        (self.folder / "etc" / "mlflow_auth.ini").write_text(self.here((DEPLOY / "mlflow_auth.ini").read_text()))
        try:
            self._start_ray("head", str(free_port()), f"--ray-client-server-port={free_port()}")
            self._start_postgres()
            self._start("mlflow", [self.here(word) for word in SERVICES["mlflow"]["command"]])
            self._wait("head")
            self._start_ray("worker", self._ports["52365"])
            self._wait("worker", "mlflow")
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        postgres = self._started.pop("postgres", None)
        left = self.processes()
        for process in left:
            with vanishing():
                process.kill()
        psutil.wait_procs(left, timeout=5)
        if postgres is not None:  # killed, it would leave shared memory behind; it waits for its clients
            postgres.terminate()
            postgres.wait(30)
        shutil.rmtree(self.folder, ignore_errors=True)
