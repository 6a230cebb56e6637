"""Headless Chromium, driven through its DevTools protocol (https://chromedevtools.github.io/devtools-protocol/)."""

from __future__ import annotations

import asyncio
import base64
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any, Self

import aiohttp

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


class Browser:
    """One page of a browser, in a ``with`` block."""

    def __init__(self, profile: Path, width: int = 1600, height: int = 1000) -> None:
        """Describe it; ``profile`` is an empty folder, the size is that of the window in pixels."""
        self._profile, self._size = profile, f"{width},{height}"
        self._loop = asyncio.new_event_loop()
        self._count = 0

    def __enter__(self) -> Self:
        assert CHROMIUM is not None
        self._process = subprocess.Popen(
            [CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
             "--no-first-run", "--disable-background-networking", "--remote-debugging-port=0",
             f"--user-data-dir={self._profile}", f"--window-size={self._size}", "about:blank"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        self._loop.run_until_complete(self._connect())
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.run_until_complete(self._session.close())
        self._loop.close()
        self._process.kill()
        self._process.wait()

    def open(self, url: str) -> None:
        """Go to an address; a new one of the same page loads it anew."""
        self.command("Page.navigate", url="about:blank")
        self.command("Page.navigate", url=url)

    def evaluate(self, script: str) -> Any:
        """The value of a JavaScript expression."""
        answer = self.command("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(answer["exceptionDetails"])
        return answer["result"].get("value")

    def wait_for(self, script: str, seconds: float = 60) -> None:
        """Wait until a JavaScript expression is truthy.

        Raises:
            TimeoutError: it is not, with what the page shows.
        """
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            try:
                if self.evaluate(f"Boolean({script})"):
                    return
            except RuntimeError:  # the page is between two addresses
                pass
            time.sleep(0.2)
        raise TimeoutError(f"never came true: {script}\nthe page: {self.evaluate('document.body.innerText')}")

    def screenshot(self, path: Path) -> None:
        """A PNG of what the window shows."""
        path.write_bytes(base64.b64decode(self.command("Page.captureScreenshot", format="png")["data"]))

    def command(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send one command of the protocol and wait for its result."""
        return self._loop.run_until_complete(asyncio.wait_for(self._command(method, parameters), 60))

    async def _connect(self) -> None:
        note = self._profile / "DevToolsActivePort"
        deadline = time.monotonic() + 60
        while not (note.exists() and len(note.read_text().splitlines()) == 2):
            if time.monotonic() > deadline:
                raise TimeoutError("the browser did not start")
            await asyncio.sleep(0.1)
        port = note.read_text().splitlines()[0]
        self._session = aiohttp.ClientSession()
        async with self._session.get(f"http://127.0.0.1:{port}/json/list") as answer:
            (page,) = [target for target in await answer.json() if target["type"] == "page"]
        self._socket = await self._session.ws_connect(page["webSocketDebuggerUrl"], max_msg_size=0)

    async def _command(self, method: str, parameters: dict[str, Any]) -> dict[str, Any]:
        self._count += 1
        await self._socket.send_json({"id": self._count, "method": method, "params": parameters})
        while True:  # events come between; nobody asked for them
            answer = await self._socket.receive_json()
            if answer.get("id") == self._count:
                if "error" in answer:
                    raise RuntimeError(answer["error"])
                return answer["result"]
