"""Mesh files of somebody else: a mesh or one line, whatever they state, unpack to or stand for."""

from __future__ import annotations

import base64
import zlib
from pathlib import Path

import pytest

from freemesh_ray.compare import meshio_file
from freemesh_ray.compare.child_process import Limits
from freemesh_ray.compare.foreign_mesh import MeshFileError, read

NODES = "*NODE\n1, 0, 0\n2, 1, 0\n3, 1, 1\n4, 0, 1\n"

#: An XML file whose one word stands for ten of another, which stands for ten of another, and so on.
LAUGHS = (
    '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b0 "ha">'
    + "".join(f'<!ENTITY b{i} "{f"&b{i - 1};" * 10}">' for i in range(1, 12))
    + ']><VTKFile type="UnstructuredGrid" version="0.1">&b11;</VTKFile>'
)


def packed_vtu(size: int) -> str:
    """A mesh of one array that unpacks to very many zeros."""
    content = zlib.compress(bytes(size))
    header = b"".join(n.to_bytes(4, "little") for n in (1, size, size, len(content)))
    text = base64.b64encode(header).decode() + base64.b64encode(content).decode()
    return (
        '<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian" header_type="UInt32" '
        'compressor="vtkZLibDataCompressor"><UnstructuredGrid><Piece NumberOfPoints="4" NumberOfCells="0"><Points>'
        f'<DataArray type="Float64" NumberOfComponents="3" format="binary">{text}</DataArray></Points><Cells/></Piece>'
        "</UnstructuredGrid></VTKFile>"
    )


@pytest.mark.slow
@pytest.mark.parametrize(("name", "content", "message"), [
    ("laughs.vtu", LAUGHS, "cannot be read"),
    ("packed.vtu", packed_vtu(400_000_000), "cannot be read"),
    ("many.msh", "$MeshFormat\n4.1 1 8\n\1\0\0\0\n$EndMeshFormat\n$Nodes\n" + "\xff\0\0\0\0\0\0\x7f" * 9, "cannot be"),
    ("nodes.inp", NODES + "*ELEMENT, TYPE=S4\n1, 1, 2, 3, 9\n", "an element of node 9"),
    ("nan.inp", NODES.replace("1, 1", "nan, 1") + "*ELEMENT, TYPE=S4\n1, 1, 2, 3, 4\n", "not all places"),
    ("far.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 77\n", "of a node that is not there"),
    ("other.xdmf", "<Xdmf/>", "unknown format '.xdmf'; use one of .inp"),
    ("words.vtu", "\x1b[31m<a>", "cannot be read"),
], ids=lambda value: value if len(value) < 20 else "")  # fmt: skip
def test_hostile_meshes_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, content: str, message: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content.encode("latin-1"))
    with pytest.raises(MeshFileError, match=message) as caught:
        read(path)
    assert str(caught.value).isprintable()


@pytest.mark.slow
def test_a_reader_that_takes_too_long_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "mesh.vtu"
    path.write_text("<a/>")
    monkeypatch.setattr(meshio_file, "_read", _spin)
    monkeypatch.setattr(meshio_file, "LIMITS", Limits(meshio_file.LIMITS.memory, seconds=1))
    with pytest.raises(MeshFileError, match="it takes too much time or memory"):
        read(path)


def _spin(path: Path) -> None:
    while True:
        pass
