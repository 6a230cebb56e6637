"""Policy files of somebody else: a policy that acts, or one line; nothing in them is run."""

from __future__ import annotations

import io
import json
import pickle
import re
import zipfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from confined import confined_pool, each
from mutants import mutants

from envs.mdp.observation import observation_size
from envs.types import MeshingParameters
from freemesh_ray.policies.policy import Policy, PolicyError

pytestmark = pytest.mark.slow

#: Mutated policy files.
FILES = 10_000


class Payload:
    """An object whose unpickling makes a file."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.mark,)


def sound() -> dict[str, np.ndarray]:
    """The arrays of a small policy, with what mutations have to find."""
    random = np.random.default_rng(0)
    sizes = [observation_size(MeshingParameters()), 4, 6]
    arrays = {"about": np.array(json.dumps({"parameters": {"n": 2, "beta": 6, "max_elements": None}, "about": {}}))}
    for i, (a, b) in enumerate(zip(sizes[:-1], sizes[1:], strict=True)):
        arrays |= {f"weight_{i}": random.random((a, b), dtype=np.float32), f"bias_{i}": np.zeros(b, dtype=np.float32)}
    return arrays


def packed(arrays: dict[str, np.ndarray], **more: bytes) -> bytes:
    """The arrays as an archive, and members that are none."""
    file = io.BytesIO()
    np.savez(file, allow_pickle=True, **arrays)  # type: ignore[arg-type]
    with zipfile.ZipFile(file, "a") as archive:
        for name, content in more.items():
            archive.writestr(f"{name}.npy", content)
    return file.getvalue()


def header(shape: str, kind: str = "'<f4'") -> bytes:
    """A ``.npy`` file that is its header alone."""
    text = f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


def refused(path: Path) -> str:
    """The line that a file is refused with."""
    with pytest.raises(PolicyError) as caught:
        Policy.load(path)
    line = str(caught.value)
    assert line.startswith(f"{path}: not a policy file (")
    assert "\n" not in line
    return line


@pytest.mark.parametrize("where", ["weight_0", "about", "more"])
def test_pickles_are_never_run(tmp_path: Path, where: str) -> None:
    mark, path = tmp_path / "was here", tmp_path / "policy.npz"
    payload = np.empty((), dtype=object)
    payload[()] = Payload(mark)
    path.write_bytes(packed(sound() | {where: payload}))
    refused(path)
    path.write_bytes(pickle.dumps(Payload(mark)))
    refused(path)
    assert not mark.exists()
    pickle.loads(pickle.dumps(Payload(mark)))
    assert mark.exists(), "the payload works where pickles are run"


@pytest.mark.parametrize("shape", ["(10**12,)", "(1000000000000,)", "(-1,)", "(1,) * 99", "(2, 99999999999999999999)"])
def test_shapes_are_not_believed(tmp_path: Path, shape: str) -> None:
    path = tmp_path / "policy.npz"
    arrays = sound()
    del arrays["bias_1"]
    path.write_bytes(packed(arrays, bias_1=header(shape)))
    refused(path)
    path.write_bytes(packed(arrays, bias_1=header("(1,)", "'<U1000000000'")))
    refused(path)


def test_what_unpacks_to_very_much_is_not_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "policy.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("weight_0.npy", bytes(60_000_000))
    assert path.stat().st_size < 100_000
    assert "50,000,000 bytes when unpacked" in refused(path)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [({"n": 2.5}, "n = 2.5"), ({"n": True}, "n = True"), ({"beta": "6"}, "beta"), ({"max_elements": 1e300}, "max"),
     ({"extended": 1}, "extended"), ({"density": ["local"]}, "density"), ({"k": 1}, "'k'"), ([], "mapping")],
)  # fmt: skip
def test_parameters_of_other_types_are_refused(tmp_path: Path, parameters: Any, message: str) -> None:
    path = tmp_path / "policy.npz"
    about = np.array(json.dumps({"parameters": parameters, "about": {}}))
    path.write_bytes(packed(sound() | {"about": about}))
    assert message in refused(path)


def test_deep_json_and_weights_of_other_kinds_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "policy.npz"
    weight = sound()["weight_0"]
    for wrong in (
        {"about": np.array("[" * 100_000)},
        {"weight_0": weight.astype(complex)},
        {"weight_0": weight.astype(int)},
        {"weight_0": weight * np.float32(np.nan)},
        {"weight_0": weight * np.float32(1e38)},
        {"weight_0": weight.astype(np.float64) * 1e300},
        {"weight_0": weight.astype("U9")},
    ):
        path.write_bytes(packed(sound() | wrong))
        refused(path)


@pytest.fixture(scope="module")
def pool() -> Iterator[ProcessPoolExecutor]:
    """Processes of little memory."""
    with confined_pool() as children:
        yield children


def is_policy(path: Path, number: int) -> bool:
    """Whether a file is a policy, which must then act; its refusal must be one line."""
    try:
        policy = Policy.load(path)
    except PolicyError as error:
        message = str(error)
        assert re.match(rf"{re.escape(str(path))}: not a policy file \([^\n]*\); give the policy", message)
        assert len(message) < len(str(path)) + 300
        return False
    seen = np.random.default_rng(number).uniform(-10, 10, (3, observation_size(policy.parameters))).astype(np.float32)
    actions = policy.act(seen, True, np.random.default_rng(number))
    assert actions.shape == (3, policy.parameters.action_size)
    assert actions.dtype == np.float32
    assert (np.abs(actions) <= 1.0).all()
    return True


def policies_among_mutants(whole: bool, folder: Path) -> int:
    """How many mutants are policies still: of the whole file, or of one member packed anew; run in the pool."""

    def members() -> Iterator[bytes]:
        names = list(sound())
        for seed, name in enumerate(names):
            file = io.BytesIO()
            np.save(file, sound()[name])
            others = {other: array for other, array in sound().items() if other != name}
            for changed in mutants(file.getvalue(), FILES // 2 // len(names), seed):
                yield packed(others, **{name: changed})

    files = mutants(packed(sound()), FILES // 2, 0) if whole else members()
    return each(files, folder / f"policy-{whole}.npz", is_policy)


def test_mutated_policies_act_or_are_one_line(tmp_path: Path, pool: ProcessPoolExecutor) -> None:
    (tmp_path / "policy.npz").write_bytes(packed(sound()))
    assert is_policy(tmp_path / "policy.npz", 0)
    shares = [pool.submit(policies_among_mutants, whole, tmp_path) for whole in (True, False)]
    assert 0 < sum(share.result() for share in shares) < FILES / 2
