"""Matplotlib without its notice of a temporary cache: where the home folder cannot be written to, it makes a folder for
its fonts, removes it at the end, and says so on standard error. That is no matter of who asked for a mesh.

Import this before matplotlib: its messages about anything else are shown as ever.
"""

from __future__ import annotations

import logging

#: What the notices begin with.
NOTICES = ("mkdir -p failed for path", "Matplotlib created a temporary cache directory")


def _is_no_cache_notice(record: logging.LogRecord) -> bool:
    return not str(record.msg).startswith(NOTICES)


logging.getLogger("matplotlib").addFilter(_is_no_cache_notice)
