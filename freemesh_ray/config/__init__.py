"""One tree of settings: ``defaults.yaml``, then overlays, then ``key=value``; what is wrong says where and why.

field (what a value may be) -> algorithms (what each has of its own) -> schema (every key) -> document (YAML)
-> layer (an overlay) -> tree (all of them)
"""

from freemesh_ray.config.algorithms import ALGORITHMS, Algorithm, Hyperparameter
from freemesh_ray.config.document import composed, document, dump, plain, read_plain, shipped
from freemesh_ray.config.field import ConfigError, Field, check
from freemesh_ray.config.layer import Layer, file_layer, know_algorithms, set_layer, tree_layer, value_layer, values
from freemesh_ray.config.schema import COUNT, SCHEMA, SHORTHANDS, algorithm_name, register
from freemesh_ray.config.tree import (
    Overlay,
    flatten,
    load,
    look_beside,
    meshing_parameters,
    plug_ins,
    plug_ins_named,
    resolve,
)

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
    "algorithm_name",
    "check",
    "composed",
    "document",
    "dump",
    "file_layer",
    "flatten",
    "know_algorithms",
    "load",
    "look_beside",
    "meshing_parameters",
    "plain",
    "plug_ins",
    "plug_ins_named",
    "read_plain",
    "register",
    "resolve",
    "set_layer",
    "shipped",
    "tree_layer",
    "value_layer",
    "values",
]
