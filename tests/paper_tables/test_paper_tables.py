"""The paper's tables: their arithmetic against known answers, the printed figures, and the command."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hostile_names import HOSTILE

from envs.domains.load import from_rings, load
from envs.mdp.observation import observation_size
from envs.mesh import Mesh
from envs.types import Domain, MeshingParameters
from freemesh_ray import export
from freemesh_ray.cli import command
from freemesh_ray.cli.paper import TABLES
from freemesh_ray.compare.comparison import Compared, compare
from freemesh_ray.compare.mixed_mesh import PeerError, assembled
from freemesh_ray.compare.named_meshers import OURS, RAW, Mesher
from freemesh_ray.compare.row import Row
from freemesh_ray.compare.stages import ALONE, SMOOTHED, stages
from freemesh_ray.formatting.markdown import escaped
from freemesh_ray.mesh_geometry.metrics import by_element
from freemesh_ray.mesher import MeshingError, MeshResult, mesh_domain
from freemesh_ray.paper_tables.density import density
from freemesh_ray.paper_tables.front_shape import front_shape
from freemesh_ray.paper_tables.generalisation import action_types, generalisation
from freemesh_ray.paper_tables.observation import observation
from freemesh_ray.paper_tables.outliers import beyond, outliers
from freemesh_ray.paper_tables.published import published, spread_of
from freemesh_ray.paper_tables.quality import LINES, quality
from freemesh_ray.paper_tables.repeated import repeat
from freemesh_ray.paper_tables.scalability import coarsening, scalability
from freemesh_ray.policies.evaluation import run_episodes
from freemesh_ray.policies.policy import SHIPPED, Policy
from tests.play import turns

RING = [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]]
QUADS = np.array([[7, 0, 1, 8], [1, 2, 3, 8], [5, 8, 3, 4], [5, 6, 7, 8]])


def square(name: str = "square") -> Domain:
    return from_rings(RING, name=name)


def squares(domain: Domain) -> Mesh:
    """Four squares: the first brings a vertex, two bring none, the last is what they leave."""
    return Mesh(domain.name, np.vstack([domain.points, [1.0, 1.0]]), QUADS, domain.segments, True)


def make(domain: Domain) -> MeshResult:
    if domain.name == "hard":
        raise MeshingError("hard: no")
    mesh = squares(domain)
    return MeshResult(mesh, mesh, 0.5, 0.5)


def uniform(parameters: MeshingParameters | None = None) -> Policy:
    """A policy that draws nearly uniform actions: enough for a square of eight vertices."""
    bias = np.array([0, 0, 0, 0.3, 0.3, 0.3], dtype=np.float32)
    parameters = parameters or MeshingParameters()
    return Policy([(np.zeros((observation_size(parameters), 6), dtype=np.float32), bias)], parameters)


def cells(text: str, first: str) -> list[str]:
    """The cells of the line that begins with ``first``."""
    (line,) = [line for line in text.splitlines() if re.match(rf"\| {re.escape(first)} +\|", line)]
    return [cell.strip() for cell in line.strip("|").split("|")]


# ---- scalability -----------------------------------------------------------------------------------------------------


def test_scalability() -> None:
    text = scalability([square(), square("hard")], make)
    assert cells(text, "scalability") == ["scalability", "square", "paper, domain 1", "hard", "paper, domain 2"]
    assert cells(text, "vertices")[1:] == ["8", "102", "8", "150"]
    assert cells(text, "perimeter")[1:] == ["8.0", "15.1", "8.0", "15.1"]
    assert cells(text, "elements")[1:] == ["4", "289", "-", "665"]
    assert cells(text, "elements/s")[1:] == ["8", "321", "-", "256"]


def test_coarsening_is_the_ratio_of_mean_areas() -> None:
    ring = [[0, 0], [1, 0], [3, 0], [4, 0], [4, 1], [4, 3], [4, 4], [3, 4], [1, 4], [0, 4], [0, 3], [0, 1]]
    inner = [[1, 1], [3, 1], [3, 3], [1, 3]]
    quads = [[0, 1, 12, 11], [1, 2, 13, 12], [2, 3, 4, 13], [13, 4, 5, 14], [14, 5, 6, 7], [15, 14, 7, 8],
             [10, 15, 8, 9], [11, 12, 15, 10], [12, 13, 14, 15]]  # fmt: skip
    domain = from_rings(ring, name="frame")
    mesh = Mesh("frame", np.vstack([domain.points, inner]), np.array(quads), domain.segments, True)
    assert coarsening(mesh) == {"coarsening": pytest.approx(4.0 / (12.0 / 8.0))}
    assert coarsening(squares(square())) == {}
    assert cells(scalability([square()], make), "interior elements' area over boundary elements'")[1:] == ["-", "-"]


def test_the_papers_speeds_are_about_what_its_text_says() -> None:
    paper = published("scalability")
    speeds = np.array(paper["elements"]) / np.array(paper["seconds"])
    assert speeds.mean() == pytest.approx(237, abs=3)  # "approximately 237 elements per second on average"
    np.testing.assert_allclose(np.array(paper["vertices"]) / paper["perimeter"], paper["density"], atol=0.07)


# ---- generalisation --------------------------------------------------------------------------------------------------


def test_actions_of_four_squares() -> None:
    domain = square()
    assert action_types(squares(domain), domain).tolist() == [2, 1, 0]
    text, _, _ = generalisation([domain, square("hard")], make).partition("front when cut")
    assert cells(text, "square")[1:7] == ["yes", "2", "1", "0", "3", "33%"]
    assert cells(text, "hard")[1:7] == ["no", *["-"] * 5]
    assert cells(text, "all")[1:7] == ["1/2", "2", "1", "0", "3", "33%"]


def test_the_shape_of_what_is_left() -> None:
    mesh = squares(square())
    whole = front_shape(mesh, 0.0)
    assert whole == pytest.approx((np.pi / 4, 1.0, 1))
    l_shape = front_shape(mesh, 0.25)  # three of four squares
    assert l_shape == pytest.approx((4 * np.pi * 3 / 64, 3 / 3.5, 1))
    order = np.array([1, 3, 0, 2])  # what is left are two squares that share a corner
    pieces = front_shape(Mesh(mesh.name, mesh.vertices, mesh.quads[order], mesh.segments, True), 0.5)
    assert pieces == pytest.approx((np.pi / 4, 1.0, 2))
    assert cells(generalisation([square()], make), "front when cut")[1:] == ["0%", "25%", "50%", "75%", "90%"]
    text = generalisation([square()], make).partition("front when cut")[2]
    assert cells(text, "square")[1:3] == ["0.79, 1.00", "0.59, 0.86"]


@pytest.mark.parametrize("type2", [False, True])
def test_action_types_are_the_kinds_of_the_accepted_actions(type2: bool) -> None:
    adds = np.array([0, 1, 0, 2])  # right, one, left, two
    completed = 0
    for seed in range(12):
        domain = load(f"random:{seed}?vertices=24&holes=0&spikiness=0.1")
        recorded = np.zeros(3, dtype=int)
        for turn in turns(domain, seed, tries=64, type2=type2):
            if turn.chosen is None:
                continue
            recorded[adds[turn.episodes.out.action_type[turn.chosen]]] += 1
            if turn.episodes.out.terminated[turn.chosen]:
                completed += 1
                mesh = turn.episodes.mesh(turn.chosen)
                assert action_types(mesh, domain).tolist() == recorded.tolist()
                assert recorded.sum() == len(mesh.quads) - 1
    assert completed >= 3


# ---- quality ---------------------------------------------------------------------------------------------------------


def test_quality_pools_elements_and_averages_counts() -> None:
    def shaken(domain: Domain) -> list:
        if domain.name == "b":
            return [assembled("bent", squares(domain).vertices, QUADS, [], 1.0)]
        vertices = np.vstack([domain.points, [1.3, 1.0]])
        triangles = [[5, 8, 3], [5, 3, 4], [5, 6, 7], [5, 7, 8]]
        return [assembled("bent", vertices, QUADS[:2], triangles, 1.0)]

    domains = [square("a"), square("b")]
    compared = compare(domains, [Mesher("bent", shaken)], None, lambda row: None)
    text = quality(compared)
    assert cells(text, "quality")[1:] == ["paper, Blossom-Quad", "paper, Pave", "paper, FreeMesh-RL", "bent"]
    eta = np.concatenate([by_element(shaken(domain)[0])["eta"] for domain in domains])
    assert len(eta) == 6
    assert cells(text, "element quality (H)")[1:] == [
        "0.72 ± 0.12", "0.79 ± 0.12", "0.79 ± 0.13", f"{eta.mean():.2f} ± {eta.std():.2f}",
    ]  # fmt: skip
    assert cells(text, "triangles (L)")[-1] == "2.0 ± 2.0"


def test_outliers_are_beyond_the_whiskers_of_the_box_plots() -> None:
    from matplotlib.cbook import boxplot_stats

    values = np.random.default_rng(0).standard_t(2, 500)
    assert beyond(values) == len(boxplot_stats(values)[0]["fliers"]) > 10
    assert beyond(np.ones(9)) == 0
    good = Mesher("good", lambda domain: [assembled("good", squares(domain).vertices, QUADS, [], 1.0)])
    text = outliers(compare([square()], [good], None, lambda row: None))
    assert cells(text, "stretch")[1:] == ["0.0% (0)"]


def test_what_follows_the_policy_is_told_apart() -> None:
    policy, domain = Policy.load(SHIPPED["medium"]), load("D4")
    (alone,), followed = (column.run(domain) for column in stages(policy, lambda one: mesh_domain(policy, one)))
    (episode,) = run_episodes(policy, domain, 1, stochastic=False, seed=0)
    assert [mesh.mesher for mesh in (alone, *followed)] == [ALONE, RAW, SMOOTHED, OURS]
    assert len(alone) == len(episode.mesh.quads)
    etas = [by_element(mesh)["eta"].mean() for mesh in followed]
    assert etas[0] < etas[1] < etas[2]
    assert len(followed[0]) == len(followed[1])
    stuck = Policy([(np.zeros((observation_size(MeshingParameters()), 6), np.float32), np.full(6, -3, np.float32))],
                   MeshingParameters())  # fmt: skip
    with pytest.raises(PeerError, match=r"^the policy alone stopped after \d+ elements$"):
        stages(stuck, make)[0].run(domain)


def test_failures_are_told() -> None:
    def failing(domain: Domain) -> list:
        raise MeshingError("no way")

    good = Mesher("good", lambda domain: [assembled("good", squares(domain).vertices, QUADS, [], 1.0)])
    text = quality(compare([square()], [good, Mesher("never", failing)], None, lambda row: None))
    assert "- square: never failed and is left out of its means: no way" in text


@pytest.mark.parametrize("name", HOSTILE)
def test_failures_of_hostile_names_begin_no_markup(name: str) -> None:
    failed = Row(name, "peer", None, None, f"{name} is wrong")
    text = quality([Compared(square(), [failed], [])])
    (line,) = [each for each in text.split("\n") if "is left out of its means" in each]
    assert line == "- " + escaped(f"{name}: peer failed and is left out of its means: {name} is wrong")


def test_every_printed_metric_has_three_methods() -> None:
    paper = published("quality")
    assert set(paper["metrics"]) == set(LINES)
    assert all(np.shape(values) == (3, 2) for values in paper["metrics"].values())


@pytest.mark.parametrize("name", TABLES)
def test_every_table_names_its_source(name: str) -> None:
    assert len(published(name)["source"]) > 20


# ---- observation and density -----------------------------------------------------------------------------------------


def test_repeated_episodes_are_those_of_their_seeds() -> None:
    domain, policy = square(), uniform()
    found = repeat(policy, domain, 4)
    alone = [run_episodes(policy, domain, 1, stochastic=True, seed=seed)[0] for seed in range(4)]
    completed = [len(result.mesh.quads) for result in alone if result.completed]
    assert found.elements.tolist() == completed
    assert found.eta.shape == (sum(completed),)
    assert len(found.seconds) == len(completed)


def test_observation_sets_the_papers_labels_beside_its_figures() -> None:
    text = observation({"O1": uniform(MeshingParameters(beta=4.0)), "mine": uniform()}, square(), 3)
    assert cells(text, "O1")[1] == "4_2_3"
    assert cells(text, "O1")[4] == "0.722 ± 0.140"
    assert cells(text, "O1")[6] == "198.8 ± 22.1"
    assert cells(text, "mine")[1] == "6_2_3"
    assert cells(text, "mine")[4] == "-"


def test_density_gives_the_differences() -> None:
    policies = {name: uniform(MeshingParameters(upsilon=u)) for name, u in (("dense", 0.5), ("medium", 1.0), ("x", 2))}
    domain = square()
    text = density(policies, domain, 5)
    assert cells(text, "dense")[1:3] == ["0.5", "0.5"]
    assert cells(text, "x")[1:3] == ["2", "-"]
    means = [repeat(policies[name], domain, 5).elements.mean() for name in ("dense", "medium")]
    assert cells(text, "dense - medium")[1:] == [f"{means[0] - means[1]:.1f}", "50"]
    assert "sparse" not in text


def test_nothing_has_no_spread() -> None:
    assert spread_of(np.empty(0), ".1f") == "-"
    assert spread_of(np.array([1.0, 3.0]), ".1f") == "2.0 ± 1.0"


# ---- the command -----------------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("square.json").write_text(str(RING))
    uniform().save("policy.npz")
    export.write(squares(square()), "pave.inp")
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("name", TABLES)
def test_every_table_is_printed_and_written(name: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    extra = ["--peers", "none", "--mesh", "pave=pave.inp"] if name == "quality" else []
    arguments = ["paper", name, "square.json", "--policy", "policy.npz", "--out", "tables", "--episodes", "2", *extra]
    assert command.main(arguments) == 0
    out = capsys.readouterr().out
    assert out == (folder / f"tables/{name}.md").read_text()
    assert out.startswith(f"| {name}")
    assert "Paper: " in out
    if name == "quality":
        assert "| pave |" in re.sub(" +", " ", out.splitlines()[0])
        assert (folder / "tables/square.png").exists()


@pytest.mark.slow
@pytest.mark.parametrize(("arguments", "words"), [
    (["beauty"], "scalability"),
    (["scalability", "--policy", "missing.npz"], "missing.npz"),
    (["scalability", "--policy", "a=policy.npz", "--policy", "b=policy.npz"], "give --policy once"),
    (["observation", "--policy", "policy.npz", "--policy", "policy.npz"], "is given twice"),
    (["observation", "--episodes", "0", "--policy", "policy.npz"], "[1, 1000]"),
    (["density", "--policy", "none.npz"], "freemesh train"),
    (["scalability", "D1", "--policy", "policy.npz", "--out", "/proc/none"], "/proc"),
])  # fmt: skip
def test_bad_input_is_one_line(
    arguments: list[str], words: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(folder.rglob("*"))
    try:
        code = command.main(["paper", *arguments])
    except SystemExit as exit_:
        code = exit_.code
    out, err = capsys.readouterr()
    assert code == 2
    assert out == ""
    assert err.count("\n") == 1
    assert words in err
    assert sorted(folder.rglob("*")) == before
