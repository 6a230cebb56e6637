"""Polygon files in: every format becomes a list of polygons, each a list of rings as the file states them.

A reader takes the path and the edge length that outlines are to be discretised by, or None; curves are flattened to
suit. The outer ring comes first, then the holes; :mod:`envs.polygons.validation` validates.
"""
