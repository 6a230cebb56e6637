"""Array archives: what NumPy saves comes back, however it lies in memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from freemesh_ray.storage.array_archive import read_arrays

ARRAYS = {
    "rows": np.arange(12.0).reshape(3, 4),
    "columns": np.asfortranarray(np.arange(12.0).reshape(3, 4)),
    "every other": np.arange(24, dtype=np.float32).reshape(4, 6)[::2, ::3],
    "one": np.array(7),
    "none": np.zeros((0, 3)),
    "truth": np.array([True, False]),
    "text": np.array(["a", "bcd"]),
    "big-endian": np.arange(3, dtype=">i4"),
}


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_what_is_saved_comes_back(tmp_path: Path, save) -> None:
    save(tmp_path / "a.npz", **ARRAYS)
    found = read_arrays(tmp_path / "a.npz")
    assert list(found) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array, strict=True)
