"""The catalogue: one JSON and one SVG for each domain, written by :mod:`envs.domains.catalogue.design`."""
