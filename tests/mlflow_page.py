"""A page of MLflow's in a browser. ``python tests/mlflow_page.py ADDRESS FILE.png`` keeps a picture of its charts."""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

from browser import Browser

CLOSE = "document.querySelector('[data-component-id=\"mlflow.assistant.chat_panel.close\"]')"
#: Seconds that charts take to be drawn.
DRAWING = 10.0


def close_assistant(browser: Browser) -> None:
    """Close what opens beside every page at a first visit."""
    browser.wait_for(CLOSE)
    browser.evaluate(f"{CLOSE}.click()")


def keep(browser: Browser, name: str, folder: Path) -> None:
    """A picture of the page, in the folder that FREEMESH_SCREENSHOTS names."""
    place = Path(os.environ.get("FREEMESH_SCREENSHOTS", folder))
    place.mkdir(parents=True, exist_ok=True)
    browser.screenshot(place / name)
    assert (place / name).stat().st_size > 10_000


def main(address: str, file: str) -> None:
    """Keep a picture."""
    with tempfile.TemporaryDirectory() as profile, Browser(Path(profile), 1600, 1200) as browser:
        browser.open(address)
        close_assistant(browser)
        browser.wait_for("document.querySelector('.js-plotly-plot')")
        time.sleep(DRAWING)
        browser.screenshot(Path(file))


if __name__ == "__main__":
    main(*sys.argv[1:])
