"""The machine that a report is made on."""

from __future__ import annotations

import os
import platform
import re
from pathlib import Path


def machine() -> str:
    """Number and model of the processor's cores, and the operating system."""
    count = os.cpu_count() or 1
    return f"{count} CPU core{'s' if count > 1 else ''} ({model()}), {platform.system()}"


def model(described: Path = Path("/proc/cpuinfo")) -> str:
    """The processor's model: as Linux describes it, or as the platform knows it."""
    try:
        found = re.search(r"^model name\s*:\s*(.+)$", described.read_text(encoding="utf-8"), re.MULTILINE)
    except OSError:
        found = None
    return found[1].strip() if found else platform.processor() or platform.machine()
