"""The columns of a records file."""

from __future__ import annotations

from typing import NamedTuple

#: Version of what is recorded and how.
FORMAT = 1
#: Key of the file's metadata that holds what is no column, as JSON.
METADATA = b"freemesh.records"
#: Name of the file.
FILE = "records.parquet"
#: What the columns of figures begin with; every one of an evaluation has its own.
FIGURES = "eval_"


class Column(NamedTuple):
    """A column.

    Attributes:
        type: of its values, as Parquet and Arrow name it.
        meaning: as the documents have it.
    """

    type: str
    meaning: str


#: Every column but those of figures, in their order; figures stand before ``vertices``.
COLUMNS: dict[str, Column] = {
    "variant": Column("string", "label; of a search what was drawn"),
    "seed": Column("int64", "of the training"),
    "training": Column("string", "ID and steps, the name of its run folder"),
    "domain": Column("string", "null: an evaluation on the way; else the best policy on a domain of the report"),
    "env_steps": Column("int64", "taken before the evaluation; null beside a domain"),
    "seconds": Column("double", "of training before the evaluation; null beside a domain"),
    "vertices": Column("list<float>", "x, y, x, y, ... of the mesh that the variant's best policy cuts; else null"),
    "quads": Column("list<int32>", "its elements, four vertices each, counter-clockwise"),
    "segments": Column("list<int32>", "its boundary, two vertices each"),
    "complete": Column("bool", "whether it fills the domain"),
}
#: The columns of a mesh.
MESH = ("vertices", "quads", "segments", "complete")
