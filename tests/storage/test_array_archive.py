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


@pytest.mark.parametrize("order", "<>")
def test_a_text_of_numbers_that_are_no_letters_is_refused(tmp_path: Path, order: str) -> None:
    """Python's texts with such a one are no texts: to look at them may end the process."""
    for number, sound in ((0x10FFFF, True), (0x110000, False), (0xFFFFFFFF, False)):
        text = np.array([65, number], dtype=f"{order}u4").view(f"{order}U2")
        np.savez(tmp_path / "a.npz", text=text)
        if sound:
            assert read_arrays(tmp_path / "a.npz")["text"].tolist() == ["A\U0010ffff"]
        else:
            with pytest.raises(ValueError, match="a text with what is no letter"):
                read_arrays(tmp_path / "a.npz")


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_what_is_saved_comes_back(tmp_path: Path, save) -> None:
    save(tmp_path / "a.npz", **ARRAYS)
    found = read_arrays(tmp_path / "a.npz")
    assert list(found) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array, strict=True)
