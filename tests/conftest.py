"""One hypothesis profile for all tests: the same examples on every machine, however slow."""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")
