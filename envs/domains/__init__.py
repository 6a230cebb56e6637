"""Domains: named, drawn at random, or read from a file; the entry is :mod:`envs.domains.load`."""
