"""One tree of settings: ``defaults.yaml``, then overlays, then ``key=value``; what is wrong says where and why.

field (what a value may be) -> algorithms (what each has of its own) -> schema (every key) -> document (YAML)
-> layer (an overlay) -> tree (all of them)
"""

from freemesh_ray.config.algorithms import ALGORITHMS, Algorithm, Hyperparameter
from freemesh_ray.config.document import composed, document, dump, plain, read_plain, shipped
from freemesh_ray.config.field import ConfigError, Field, check
from freemesh_ray.config.layer import Layer, file_layer, set_layer, tree_layer, value_layer, values
from freemesh_ray.config.schema import COUNT, SCHEMA, SHORTHANDS, register
from freemesh_ray.config.tree import Overlay, flatten, load, meshing_parameters, resolve

__all__ = [
    "ALGORITHMS",
    "COUNT",
    "SCHEMA",
    "SHORTHANDS",
    "Algorithm",
    "ConfigError",
    "Field",
    "Hyperparameter",
    "Layer",
    "Overlay",
    "check",
    "composed",
    "document",
    "dump",
    "file_layer",
    "flatten",
    "load",
    "meshing_parameters",
    "plain",
    "read_plain",
    "register",
    "resolve",
    "set_layer",
    "shipped",
    "tree_layer",
    "value_layer",
    "values",
]
