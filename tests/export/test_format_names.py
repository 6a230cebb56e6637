"""Names that a format cannot hold are changed, never two into one, and told; what a format does not keep is told."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapes import block, grid, holed, named

from envs.mesh import Groups, Mesh
from freemesh_ray.export import ELEMENT_TYPES, FORMATS, SUFFIXES, write
from freemesh_ray.export.finite_elements import FiniteElements, NodeSet
from freemesh_ray.export.names import NameRule, free, renamed
from freemesh_ray.export.plane import plane_elements
from freemesh_ray.storage.atomic import OutputError

RULES = [
    NameRule(8),
    NameRule(64, letter_first=True, capitals=True, reserved=frozenset({"ALL"})),
    *(f.rule for f in FORMATS.values()),
]


def with_points(names: list[str]) -> FiniteElements:
    """Finite elements with points of these names, and no other parts."""
    mesh = plane_elements(grid())
    points = tuple(NodeSet(name, mesh.elements[:1, :1]) for name in names)
    return replace(mesh, sides=(), regions=(), points=points)


@given(st.sampled_from(RULES), st.lists(st.text(max_size=12), unique=True, max_size=12))
def test_names_stay_apart_and_are_such_as_the_format_holds(rule: NameRule, names: list[str]):
    mesh, changes = renamed(with_points(names), rule)
    new = [point.name for point in mesh.points]
    assert len({name.upper() if rule.capitals else name for name in new}) == len(names)
    assert not rule.reserved & set(new)
    for old, name in zip(names, new, strict=True):
        assert 0 < len(name) <= rule.most
        assert re.fullmatch(f"[{rule.allowed}]+", name)
        assert name == name.strip()
        assert not rule.letter_first or name[0].isalpha()
        assert not rule.capitals or name == name.upper()
        kept = old.upper() if rule.capitals else old
        assert (name != kept) == ((old, name) in [(change.old, change.new) for change in changes])


@given(st.sampled_from(RULES), st.lists(st.text("ab", min_size=1, max_size=3), unique=True, max_size=8))
def test_names_that_can_be_held_are_kept_whatever_others_become(rule: NameRule, names: list[str]):
    found, _ = renamed(with_points([f" {name}" for name in names] + names), rule)
    kept = [point.name for point in found.points][len(names) :]
    assert kept == [name.upper() if rule.capitals else name for name in names]


@pytest.mark.parametrize(("suffix", "old", "new"), [
    (".inp", "left", "LEFT"), (".inp", "left side", "LEFT_SIDE"), (".inp", "1st", "N_1ST"), (".inp", "all", "ALL_2"),
    (".inp", "Größe", "GRO_E"), (".su2", "Café", "Cafe"), (".unv", "x" * 30, "x" * 24), (".msh", 'a "b"', "a _b_"),
    (".msh", "Größe 1", "Größe 1"), (".bdf", "left side", "left side"), (".foam", "frontAndBack", "frontAndBack_2"),
    (".e", "→", "unnamed"), (".vtu", "a\nb", "a_b"),
])  # fmt: skip
def test_examples(suffix: str, old: str, new: str):
    (point,) = renamed(with_points([old]), FORMATS[suffix].rule)[0].points
    assert point.name == new


def test_a_side_and_a_region_of_one_name_are_told_apart():
    mesh = plane_elements(
        replace(grid(), groups=Groups(sides={"steel": grid().segments[:2]}, regions={"steel": [0, 1]}))
    )
    found, changes = renamed(mesh, FORMATS[".msh"].rule)
    assert [side.name for side in found.sides] == ["steel", "boundary"]
    assert [region.name for region in found.regions] == ["steel_2", "domain"]
    assert [(change.kind, change.old, change.new) for change in changes] == [("regions", "steel", "steel_2")]


@given(st.text("ab_2", max_size=6), st.sets(st.text("ab_2", max_size=6)))
def test_free_names_are_not_taken(name: str, taken: set[str]):
    found = free(name, taken, 6)
    assert found not in taken
    assert len(found) <= 6
    assert found == name or name in taken


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_is_changed_or_left_out_is_told_in_one_line_each(tmp_path: Path, suffix: str):
    mesh = replace(named(), groups=replace(named().groups, points={"Ω": 40}))
    path, form = tmp_path / f"mesh{suffix}", FORMATS[suffix]
    notes = write(mesh, path)
    assert all(note.startswith(f"{path}: ") and note.isprintable() and "\n" not in note for note in notes)
    lost = [kind for kind in ("sides", "regions", "lines", "points") if not getattr(form, kind)]
    told = [note for note in notes if "left out" in note]
    assert told == [
        note for note in [f"{path}: {suffix} keeps no {' and no '.join(lost)}: left out "] if lost and told
    ] or (len(told) == 1 and told[0].startswith(f"{path}: {suffix} keeps no {' and no '.join(lost)}: left out "))
    assert bool(told) == bool(lost)
    changed = [note for note in notes if "cannot hold" in note]
    spaced = form.sides and re.search(f"[^{form.rule.allowed}]", "left side")
    assert bool(changed) == bool(spaced or (form.points and not re.fullmatch(f"[{form.rule.allowed}]", "Ω")))
    assert not spaced or "'left side' is " in changed[0]
    assert write(holed(), path) == ()


def test_a_note_names_no_more_than_a_few(tmp_path: Path):
    mesh = grid(6, 6)
    points = {f"point {i}": i for i in range(20)}
    (note,) = write(replace(mesh, groups=Groups(points=points)), tmp_path / "mesh.inp")
    assert note.endswith("'point 4' is POINT_4 and 15 more")


# ---- what can be chosen ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "options", "nodes"), [
    ("a.msh", {"order": 2}, 9), ("a.msh", {"quadratic": True}, 8), ("a.msh", {"quadratic": True, "order": 2}, 8),
    ("a.msh", {"order": 4}, 25), ("a.inp", {"order": 2}, 8), ("a.mesh", {"quadratic": True}, 9), ("a.inp", {}, 4),
    ("a.inp", {"element_type": "CPS8R"}, 8), ("a.inp", {"element_type": "CAX8", "order": 2}, 8),
    ("a.k", {"order": 2}, 8),
])  # fmt: skip
def test_orders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, options: dict, nodes: int):
    found = []
    monkeypatch.setattr(
        "freemesh_ray.export.plane.plane_elements", lambda mesh, n: found.append(n) or plane_elements(mesh, n)
    )
    write(grid(shift=9.0), tmp_path / name, **options)
    assert found == [nodes]


@pytest.mark.parametrize(("name", "options", "message"), [
    ("a.inp", {"order": 3}, ".inp holds elements of orders 1, 2, not of order 3: write .vtu, .msh, .mesh, .ism"),
    ("a.su2", {"order": 2}, ".su2 holds elements of order 1, not of order 2: write .vtu, .msh, .inp,"),
    ("a.msh", {"order": 5}, ".msh holds elements of orders 1, 2, 3, 4, not of order 5: use one of 1, 2, 3, 4"),
    ("a.msh", {"order": 3, "quadratic": True}, "quadratic elements are of order 2, not 3: say one of the two"),
    ("a.msh", {"element_type": "CPS4"}, ".msh has no element types to choose: leave CPS4 out"),
    ("a.inp", {"element_type": "CPS5"}, f"unknown element type CPS5: use one of {ELEMENT_TYPES[0]}"),
    ("a.inp", {"element_type": "C3D8"}, "unknown element type C3D8: use one of CPE4"),
    ("a.inp", {"element_type": "CPS4", "order": 2}, "CPS4 is of order 1, not 2: leave out the order"),
    ("a.inp", {"element_type": "CAX4"}, "CAX4 turns around x = 0, and a node is at (-"),
])  # fmt: skip
def test_what_a_format_does_not_hold_is_one_line(tmp_path: Path, name: str, options: dict, message: str):
    with pytest.raises(OutputError) as caught:
        write(grid(), tmp_path / name, **options)
    assert str(caught.value).startswith(f"{tmp_path / name}: {message}")
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("name", "nodes", "options", "message"), [
    ("a.obj", 8, {}, ".obj holds no hexahedra of 8 nodes: write .vtu, .msh, .inp,"),
    ("a.su2", 20, {}, ".su2 holds no hexahedra of 20 nodes: write .vtu, .msh, .inp,"),
    ("a.inp", 8, {"order": 2}, "its hexahedra are of order 1, not 2: sweep the mesh with that order"),
    ("a.inp", 20, {"element_type": "C3D8"}, "C3D8 has 8 nodes, and the hexahedra 20: choose another"),
    ("a.inp", 8, {"element_type": "CPS4"}, "unknown element type CPS4: use one of C3D8"),
])  # fmt: skip
def test_hexahedra_that_a_format_does_not_hold_are_one_line(
    tmp_path: Path, name: str, nodes: int, options: dict, message: str
):
    with pytest.raises(OutputError) as caught:
        write(block(nodes), tmp_path / name, **options)
    assert str(caught.value).startswith(f"{tmp_path / name}: {message}")
    assert not list(tmp_path.iterdir())


def test_the_element_type_is_that_of_the_deck(tmp_path: Path):
    for kind in ELEMENT_TYPES:
        solid = kind.startswith("C3D")
        write(block(20 if "20" in kind else 8) if solid else grid(shift=9.0), tmp_path / "a.inp", element_type=kind)
        assert re.findall(r"^\*ELEMENT, TYPE=(\w+), ELSET=ALL$", (tmp_path / "a.inp").read_text(), flags=re.M) == [kind]


def test_openfoam_keeps_what_else_lies_in_its_folder(tmp_path: Path):
    (tmp_path / "constant" / "polyMesh").mkdir(parents=True)
    (tmp_path / "constant" / "polyMesh" / "blockMeshDict").write_text("mine")
    write(named(), tmp_path / "case.foam")
    first = (tmp_path / "constant" / "polyMesh" / "points").read_bytes()
    mesh: Mesh = grid()
    write(mesh, tmp_path / "case.foam")
    names = {path.name for path in (tmp_path / "constant" / "polyMesh").iterdir()}
    zones = {"cellZones", "faceZones", "pointZones"}
    assert names == {"points", "faces", "owner", "neighbour", "boundary", "blockMeshDict"} | zones
    assert (tmp_path / "constant" / "polyMesh" / "points").read_bytes() != first
    assert (tmp_path / "constant" / "polyMesh" / "blockMeshDict").read_text() == "mine"
