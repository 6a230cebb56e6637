"""Rings of coordinates become the boundary vertices of a validated domain."""
