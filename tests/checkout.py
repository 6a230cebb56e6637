"""The checkout that the tests run in, and what may lie beside it."""

from __future__ import annotations

from pathlib import Path

#: The repository's root.
ROOT = Path(__file__).resolve().parents[1]
#: The paper authors' public polygons, where a copy lies beside the checkout; otherwise none.
REFERENCES = sorted((ROOT.parent / "shared" / "reference-domains").glob("*.json"))
