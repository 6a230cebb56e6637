"""Compiled geometry: bare functions on floats and arrays; whoever calls them has validated the input."""
