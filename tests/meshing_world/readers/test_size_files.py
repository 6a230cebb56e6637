"""Sizes as users say them: expressions, tables, Gmsh's views, background meshes and points."""

from __future__ import annotations

import math
from pathlib import Path

import meshio
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.domains.load import from_object, load, load_all, own_sizes, wanted_sizes
from envs.errors import UserError
from envs.readers.size_expression import FUNCTIONS
from envs.readers.size_input import size_of
from envs.types import Domain, Floats

SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float64)
L_SHAPE = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], dtype=np.float64)
PLACES = np.array([[0.0, 0.0], [1.0, 0.5], [-2.0, 3.0], [0.3, 0.7]])

#: Python's own evaluation is the oracle: what is drawn holds nothing else than this.
NAMES = {name: getattr(math, name, None) or {"abs": abs, "min": min, "max": max}[name] for name in FUNCTIONS}


def expressions() -> st.SearchStrategy[str]:
    """Expressions of the small language."""
    leaf = st.sampled_from(["x", "y", "pi", "e", "0.5", "2", "1e-3"])
    return st.recursive(
        leaf,
        lambda inner: st.one_of(
            st.tuples(inner, st.sampled_from("+-*/%"), inner).map(lambda t: f"({t[0]} {t[1]} {t[2]})"),
            st.tuples(st.sampled_from(["sin", "exp", "sqrt", "abs", "atan", "floor", "log"]), inner).map(
                "{0[0]}({0[1]})".format
            ),
            st.tuples(st.sampled_from(["min", "max", "hypot", "atan2"]), inner, inner).map(
                "{0[0]}({0[1]}, {0[2]})".format
            ),
            st.tuples(inner, inner, st.sampled_from(["<", ">=", "!="]), inner).map(
                "({0[0]} if {0[1]} {0[2]} {0[3]} and not x > 9 else -{0[3]})".format
            ),
        ),
        max_leaves=8,
    )


@settings(max_examples=150, deadline=None)
@given(text=expressions(), x=st.floats(-3, 3), y=st.floats(-3, 3))
def test_expressions_are_worth_what_python_says(text: str, x: float, y: float) -> None:
    try:
        value = eval(text, {"__builtins__": {}}, {"x": x, "y": y, "pi": math.pi, "e": math.e, **NAMES})
    except (ValueError, ZeroDivisionError, OverflowError):
        value = math.nan
    if math.isfinite(value) and value > 0.0:
        np.testing.assert_allclose(size_of(text)(np.array([[x, y]])), value, rtol=1e-9)  # type: ignore[operator]
    elif not math.isnan(value):
        with pytest.raises(UserError, match=r"give a size above 0 all over the domain$"):
            size_of(text)(np.array([[x, y]]))  # type: ignore[operator]


@pytest.mark.parametrize(("text", "message"), [
    ("__import__('os').system('true')", "column 1: not understood"),
    ("().__class__", "column 1: not understood"),
    ("x.real", "column 1: not understood"),
    ("[x for x in (1,)]", "column 1: not understood"),
    ("open('a')", "column 1: 'open' is no function known here"),
    ("0.1 * z", "column 7: 'z' is not known"),
    ("x ^ 2", r"column 1: \^ is no power here; write \*\*"),
    ("x // 2", "column 1: an operator that is not known"),
    ("x is 1", "column 1: a comparison that is not known"),
    ("min(x)", "column 1: min takes 2 or more arguments, not 1"),
    ("hypot(x, y, 1)", "column 1: hypot takes 2 arguments, not 3"),
    ("abs(*x)", "column 5: not understood"),
    ("(x := 1)", "column 2: not understood"),
    ("'a'", "column 1: no number"),
    ("1j", "column 1: no number"),
    ("True", "column 1: no number"),
    ("1e999", "column 1: a number above 1e300"),
    ("1" * 400, "column 1: a number above 1e300"),
    ("x +", "not understood"),
    ("", "column 1: not understood"),
    ("(" * 500 + "x" + ")" * 500, "not understood"),
    ("-" * 200 + "x", "more than 100 operations in each other"),
    ("x" * 20_000, "20,000 characters, at most 10,000"),
    ("part.xyz", "column 1: not understood"),
])  # fmt: skip
def test_what_is_no_expression_is_one_line(text: str, message: str) -> None:
    with pytest.raises(UserError, match=rf"^size .*{message}") as error:
        size_of(text)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 300


def lengths(domain: Domain) -> tuple[Floats, Floats]:
    """Lengths and middles of boundary segments."""
    ends = domain.points[domain.segments]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), ends.mean(axis=1)


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(
    low=st.floats(0.01, 0.1), slope=st.floats(0.0, 0.2), angle=st.floats(0, 7), scale=st.sampled_from([1e-4, 1.0, 1e4])
)
def test_a_boundary_follows_a_size(low: float, slope: float, angle: float, scale: float) -> None:
    def size(at: Floats) -> Floats:
        along = at @ [math.cos(angle), math.sin(angle)]
        return low * scale + slope * (along + 2.0 * scale)

    (domain,) = from_object(scale * L_SHAPE, size=size)
    length, middle = lengths(domain)
    ratio = length / size(middle)
    # Sides have whole numbers of segments, at least one.
    whole = size(middle).max() / scale
    assert ratio.max() < 1.0 + max(0.1, 0.7 * whole)
    assert ratio.min() > 0.9 - 0.5 * min(whole, 1.0)


def test_a_uniform_size_is_an_edge_length() -> None:
    same = from_object(L_SHAPE, edge_length=0.1)[0]
    for size in (size_of("0.1"), lambda at: np.full(len(at), 0.1), np.array([[5.0, 0.5, 0.1], [0.0, 0.0, 0.1]])[1:]):
        np.testing.assert_array_equal(from_object(L_SHAPE, size=size)[0].points, same.points)
    finer = from_object(L_SHAPE, size=size_of("0.4"), edge_length=0.1)[0]
    np.testing.assert_array_equal(finer.points, same.points)


def test_sizes_jump_no_faster_than_they_may_grow() -> None:
    (domain,) = from_object(SQUARE * 10, size=size_of("0.05 if x < 5 else 1"))
    x = np.sort(domain.points[domain.points[:, 1] == 0.0][:, 0])
    steps = np.diff(x)
    assert steps[0] == pytest.approx(0.05, rel=0.1)
    assert steps.max() > 0.7
    assert np.maximum(steps[1:] / steps[:-1], steps[:-1] / steps[1:]).max() < 1.4


def test_a_size_is_asked_inside_the_domain_alone() -> None:
    (domain,) = from_object(L_SHAPE, size=size_of("0.1 if x < 1.001 or y < 1.001 else -1"))
    assert lengths(domain)[0] == pytest.approx(0.1)
    with pytest.raises(UserError, match=r"size .*: -1 at \(.*\); give a size above 0 all over the domain"):
        from_object(L_SHAPE, size=size_of("0.1 if x < 1.9 else -1"))


def test_the_inside_keeps_to_what_the_boundary_was_split_by() -> None:
    size = size_of("0.05 + 0.3 * min(min(x, 1 - x), min(y, 1 - y))")
    domain = from_object(SQUARE, size=size)[0]
    assert lengths(domain)[0] == pytest.approx(0.05)
    assert wanted_sizes(domain, size).most == pytest.approx(0.2, rel=0.1), "larger inside than anywhere on the boundary"
    assert wanted_sizes(domain, size, edge_length=0.1).most == 0.1
    assert wanted_sizes(domain, size, most=0.07).most == 0.07
    assert not wanted_sizes(domain, None).stated


# Files


def background(values: Floats) -> meshio.Mesh:
    """Two triangles and a quadrilateral over (-1, -1) to (5, 2), sizes at their corners."""
    points = np.array([[-1, -1, 0], [2, -1, 0], [5, -1, 0], [5, 2, 0], [2, 2, 0], [-1, 2, 0]], dtype=np.float64)
    cells = [("triangle", np.array([[0, 1, 4], [0, 4, 5]])), ("quad", np.array([[1, 2, 3, 4]]))]
    return meshio.Mesh(points, cells, point_data={"size": values})


def linear(at: Floats) -> Floats:
    """A size that triangles hold exactly."""
    return 0.3 + 0.02 * at[:, 0] - 0.05 * at[:, 1]


@pytest.mark.parametrize("version", ["gmsh", "gmsh22"])
@pytest.mark.parametrize("binary", [False, True])
def test_background_meshes(tmp_path: Path, version: str, binary: bool) -> None:
    mesh = background(np.zeros(6))
    mesh.point_data["size"] = linear(mesh.points)
    if version == "gmsh":  # which meshio writes of one kind of cells alone
        mesh = meshio.Mesh(mesh.points, [("quad", np.array([[0, 1, 4, 5], [1, 2, 3, 4]]))], mesh.point_data)
    path = tmp_path / "background.msh"
    mesh.write(path, file_format=version, binary=binary)
    if not binary:  # meshio writes NumPy's names into its texts
        path.write_text(path.read_text().replace("np.float64(", "").replace(")", ""))
    size = size_of(path)
    places = np.random.default_rng(0).uniform([-1, -1], [5, 2], (200, 2))
    np.testing.assert_allclose(size(places), linear(places), rtol=1e-12)  # type: ignore[operator]
    assert size_of(str(path))(places[:1]) == pytest.approx(linear(places[:1]))  # type: ignore[operator]
    assert size(np.array([[-1.1, 0.5]])) == pytest.approx(linear(np.array([[-1.0, 0.5]])), rel=0.02)  # type: ignore[operator]
    with pytest.raises(UserError, match=r"background\.msh: does not cover the domain: no size at \(9, 0\), .*4 away"):
        size(np.array([[0.0, 0.0], [9.0, 0.0]]))  # type: ignore[operator]
    with pytest.raises(UserError, match=r"does not cover the domain"):
        from_object(10.0 * SQUARE, size=size)


def test_views(tmp_path: Path) -> None:
    path = tmp_path / "size.pos"
    points = np.array([[-1, -1], [5, -1], [5, 2], [-1, 2]])
    corner = lambda i: f"{points[i, 0]},{points[i, 1]},0"  # noqa: E731
    value = linear(points)
    path.write_text(f"""// sizes
View "of all" {{
ST({corner(0)},{corner(1)}, {corner(2)}){{{value[0]},{value[1]},{value[2]}}};
ST ({corner(0)},{corner(2)},{corner(3)}) {{{value[0]},{value[2]},{value[3]}, 7, 7, 7}}; /* two steps */
TIME{{0, 1}};
}};
""")
    places = np.random.default_rng(0).uniform([-1, -1], [5, 2], (50, 2))
    np.testing.assert_allclose(size_of(path)(places), linear(places), rtol=1e-12)  # type: ignore[operator]
    path.write_text(f'View "q" {{SQ({",".join(map(corner, range(4)))}){{{",".join(map(str, value))}}};}};')
    np.testing.assert_allclose(size_of(path)(places), linear(places), rtol=1e-12)  # type: ignore[operator]
    path.write_text('View "p" {SP(1,2,0){0.5}; SP(3,4,0){0.25};};')
    np.testing.assert_array_equal(size_of(path), [[1, 2, 0.5], [3, 4, 0.25]])


def test_tables(tmp_path: Path) -> None:
    path = tmp_path / "sizes.csv"
    path.write_text("size;x;y\n0,5;1;2\n\n0,25;3;4  # a note\n")
    np.testing.assert_array_equal(size_of(path), [[1, 2, 0.5], [3, 4, 0.25]])
    path.write_text("1 2 .5\n")
    (domain,) = from_object(10.0 * SQUARE, size=size_of(path), edge_length=2.0)
    length, middle = lengths(domain)
    assert length[np.hypot(*(middle - [0, 2]).T) < 1.0].max() < 1.0
    assert length.max() > 1.5


FAULTS = {
    "empty.csv": ("\n", "the file is empty"),
    "short.csv": ("1,2\n", r"line 1: '1,2' where x, y and a size are needed"),
    "text.csv": ("x,y,size\n1,2,three\n", "line 2: .* where x, y and a size are needed"),
    "head.csv": ("x,y,size\n", "no rows"),
    "zero.csv": ("1,2,0\n", r"size 0 at \(1, 2\); give positive numbers"),
    "nan.csv": ("1,2,nan\n", r"size nan at \(1, 2\)"),
    "far.csv": ("1000,0,1\n", "the nearest one, .* is far from the domain"),
    "none.pos": ("View \"a\" {};", "no sizes in it"),
    "vector.pos": ('View "a" {VP(0,0,0){1,2,3};};', "line 1: VP elements are no sizes here"),
    "short.pos": ('View "a" {\nST(0,0,0,1,0,0,1,1,0){1,2};};', "line 2: ST has 3 nodes"),
    "broken.pos": ('View "a" {SP(0,0,x){1};};', "something else than numbers"),
    "words.pos": ("View \"a\" {\nhello\n};", "line 2: 'hello' is not understood"),
    "negative.pos": ('View "a" {ST(0,0,0,1,0,0,1,1,0){1,-2,1};};', r"size -2 at \(1, 0\)"),
    "flat.pos": ('View "a" {ST(0,0,0,1,0,0,2,0,0){1,2,1};};', "no triangles with an area"),
    "none.msh": ("hello", "not a valid Gmsh mesh with node data"),
    "plain.msh": (
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n3\n1 0 0 0\n2 1 0 0\n3 0 1 0\n$EndNodes\n"
        "$Elements\n1\n1 2 2 1 1 1 2 3\n$EndElements\n", "no node data"),
    "part.msh": (
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n3\n1 0 0 0\n2 1 0 0\n3 0 1 0\n$EndNodes\n"
        "$Elements\n1\n1 2 2 1 1 1 2 3\n$EndElements\n$NodeData\n1\n\"s\"\n1\n0\n3\n0\n1\n2\n1 1\n2 1\n$EndNodeData\n",
        r"size nan at \(0, 1\)"),
    "vector.msh": (
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n3\n1 0 0 0\n2 1 0 0\n3 0 1 0\n$EndNodes\n"
        "$Elements\n1\n1 2 2 1 1 1 2 3\n$EndElements\n$NodeData\n1\n\"s\"\n1\n0\n3\n0\n3\n1\n1 1 1 1\n$EndNodeData\n",
        "node data of 3 components"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_files_that_are_none_are_one_line(tmp_path: Path, name: str) -> None:
    text, message = FAULTS[name]
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(UserError, match=message) as error:
        from_object(SQUARE, size=size_of(path))
    assert "\n" not in str(error.value)
    assert name in str(error.value) or name == "far.csv"


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"gone\.csv: no such file"):
        size_of(str(tmp_path / "gone.csv"))
    with pytest.raises(UserError, match=r"a\.txt: no file of sizes; use one of \.csv, \.pos, \.msh"):
        size_of(tmp_path / "a.txt")


# Points of scripts

SCRIPT = """
lc = 1;
Point(1) = {0, 0, 0, lc/10}; Point(2) = {10, 0, 0, lc}; Point(3) = {10, 10, 0, lc}; Point(4) = {0, 10, 0, lc};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
"""


def test_points_of_a_script_have_sizes(tmp_path: Path) -> None:
    path = tmp_path / "part.geo"
    path.write_text(SCRIPT)
    (domain,) = load_all(path, size=own_sizes(path))
    low = np.sort(domain.points[domain.points[:, 1] == 0.0][:, 0])
    steps, middle = np.diff(low), 0.5 * (low[1:] + low[:-1])
    np.testing.assert_allclose(steps, 0.1 + 0.09 * middle, rtol=0.1)
    high = np.diff(np.sort(domain.points[domain.points[:, 1] == 10.0][:, 0]))
    assert high == pytest.approx(1.0, rel=0.05)
    assert len(load(path).segments) == 4, "nothing else reads them"


@pytest.mark.parametrize(("more", "least"), [
    ("MeshSize {1, 2} = 0.05;", 0.05), ("Characteristic Length {1} = 0.5;", 0.5), ("MeshSize {:} = 0.3;", 0.3),
    ("MeshSize {PointsOf{Surface{1};}} = 0.01;", 0.01), ("MeshSize {1:4} = 0;", None),
    ("Transfinite Curve {1} = 5;", None),
])  # fmt: skip
def test_later_statements_on_sizes(tmp_path: Path, more: str, least: float | None) -> None:
    path = tmp_path / "part.geo"
    path.write_text(SCRIPT + more)
    found = own_sizes(path)
    if least is None:
        assert found is None
    else:
        assert found is not None
        assert found[:, 2].min() == pytest.approx(least)
    path.write_text(SCRIPT.replace(", lc/10", "").replace(", lc}", "}"))
    assert own_sizes(path) is None
    assert own_sizes("T1") is None
    assert own_sizes(tmp_path / "part.wkt") is None
