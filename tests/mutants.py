"""Mutants of sound files: what damage, other programs and ill will make of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

import numpy as np

#: What is put between bytes, or in the place of one.
SPLINTERS = [
    b"nan", b"inf", b"-inf", b"1e999", b"-1", b"99999999999", b"0", b"1e308", b"1e-300", b"\x00", b"\xff\xff\xff\x7f",
    b"{", b"}", b"[", b"]", b"(", b")", b";", b",", b"\n", b" ", b"/*", b"$End", b"\r", b"\xe2\x82\xac", b":", b"^",
    b"\r\n", b"\xef\xbb\xbf", b"\xff\xfe", b"\xd9\xa1", b"\xe2\x80\xa8", b"\x1a", b'"', b"'", b"#", b"//", b"$", b"\\",
]  # fmt: skip

#: What takes the place of a number.
NUMBERS = [
    b"0", b"-0", b"1", b"-1", b"2", b"3", b"7", b"255", b"65536", b"2147483647", b"-2147483648", b"4294967296",
    b"1000000000", b"9223372036854775807", b"-9223372036854775808", b"18446744073709551615", b"1" * 30, b"9" * 400,
    b"1e9", b"1e18", b"1e100", b"1e101", b"1e154", b"1e308", b"-1e308", b"1e309", b"1e-9", b"1e-300", b"5e-324",
    b"nan", b"-nan", b"inf", b"-inf", b"NaN", b"Infinity", b"1e", b"0x10", b"1_000", b"1,5", b".5", b"5.", b"+1",
    b"0.30000000000000004", b"1e99999999999", b"\xd9\xa1\xd9\xa2", b"\xef\xbc\x91", b"1d3", b"6.283185307179586", b"",
]  # fmt: skip

NUMBER = re.compile(rb"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
WORD = re.compile(rb"[A-Za-z_$]{2,}")

#: What opens and closes in one format or another, for nesting without end.
NESTS = [(b"(", b")"), (b"[", b"]"), (b"{", b"}"), (b'{"a":', b"}"), (b"-", b""), (b"/*", b"*/"), (b"2^", b"")]

#: Bytes of a mutant at most: what is repeated stays small, what it stands for need not.
MOST_BYTES = 100_000

Rng = np.random.Generator


def pick(rng: Rng, choices: list[bytes]) -> bytes:
    """One of the choices."""
    return choices[int(rng.integers(len(choices)))]


def place(rng: Rng, content: bytes) -> tuple[int, int]:
    """A place in a content, and one up to twenty bytes on."""
    at = int(rng.integers(len(content) + 1))
    return at, at + int(rng.integers(1, 20))


def with_bytes_added(rng: Rng, content: bytes) -> bytes:
    """Something put in, or in the place of one byte."""
    at, _ = place(rng, content)
    return content[:at] + pick(rng, SPLINTERS) + content[at + int(rng.integers(2)) :]


def with_bytes_dropped(rng: Rng, content: bytes) -> bytes:
    """A few bytes left out, or all that follow."""
    at, until = place(rng, content)
    return content[:at] + (content[until:] if rng.random() < 0.9 else b"")


def with_bit_flipped(rng: Rng, content: bytes) -> bytes:
    """One bit another."""
    at = int(rng.integers(max(len(content), 1)))
    return content[:at] + bytes(byte ^ (1 << int(rng.integers(8))) for byte in content[at : at + 1]) + content[at + 1 :]


def with_bytes_repeated(rng: Rng, content: bytes) -> bytes:
    """A few bytes several times."""
    at, until = place(rng, content)
    return content[:at] + content[at:until] * int(rng.integers(1, 4)) + content[at:]


def with_another(pattern: re.Pattern[bytes], others: list[bytes]) -> Callable[[Rng, bytes], bytes]:
    """What makes, of one match of a pattern, one of the others or another match."""

    def change(rng: Rng, content: bytes) -> bytes:
        found = list(pattern.finditer(content))
        if not found:
            return content
        match = found[int(rng.integers(len(found)))]
        new = pick(rng, others if others and rng.random() < 0.7 else [other.group() for other in found])
        return content[: match.start()] + new + content[match.end() :]

    return change


def with_lines_changed(rng: Rng, content: bytes) -> bytes:
    """One line left out, repeated up to thousands of times, or exchanged with another."""
    lines = content.split(b"\n")
    i, j = (int(rng.integers(len(lines))) for _ in range(2))
    kind = int(rng.integers(4))
    if kind == 0:
        lines[i : i + 1] = []
    elif kind == 1:
        lines[i], lines[j] = lines[j], lines[i]
    elif kind == 2:
        lines[i:i] = lines[min(i, j) : max(i, j) + 1]
    else:
        lines[i:i] = [lines[i]] * int(rng.integers(1, 1 + 5000 // (len(lines[i]) + 1) + 1))
    return b"\n".join(lines)


def with_binary_number(rng: Rng, content: bytes) -> bytes:
    """Four or eight bytes that are, as a number, extreme."""
    at, _ = place(rng, content)
    whole = int(rng.choice([0, 1, 2, 3, 15, 255, 2**16, 2**31 - 1, -1, -(2**31), 10**9]))
    number = [
        np.array(whole, dtype="<i4"), np.array(whole, dtype=">i4"), np.array(whole, dtype="<i8"),
        np.array(2**63 + whole, dtype="<u8"), np.array(whole * 1e300, dtype="<f8"), np.array(np.nan, dtype="<f8"),
    ][int(rng.integers(6))].tobytes()  # fmt: skip
    return content[:at] + number + content[at + len(number) :]


def with_nests(rng: Rng, content: bytes) -> bytes:
    """Thousands of brackets in each other."""
    opening, closing = NESTS[int(rng.integers(len(NESTS)))]
    depth = int(rng.choice([2, 60, 1500, 20_000]))
    at, _ = place(rng, content)
    until = int(rng.integers(at, len(content) + 1))
    return content[:at] + opening * depth + content[at:until] + closing * depth + content[until:]


def with_other_text_encoding(rng: Rng, content: bytes) -> bytes:
    """The same text as other programs store it."""
    text = content.decode("latin-1")
    kind = int(rng.integers(5))
    if kind == 0:
        return text.encode("utf-16")
    if kind == 1:
        return b"\xef\xbb\xbf" + content
    if kind == 2:
        return content.replace(b"\n", b"\r\n")
    if kind == 3:
        return content.replace(b"\n", b"\r")
    return content.replace(b"1", "١".encode())


#: Every way to change a file, and how often, out of a hundred times.
WAYS: list[tuple[Callable[[Rng, bytes], bytes], int]] = [
    (with_bytes_added, 20), (with_bytes_dropped, 12), (with_bit_flipped, 10), (with_bytes_repeated, 6),
    (with_another(NUMBER, NUMBERS), 24), (with_another(WORD, []), 6), (with_lines_changed, 8), (with_binary_number, 8),
    (with_nests, 3), (with_other_text_encoding, 3),
]  # fmt: skip


def mutants(content: bytes, count: int, seed: int) -> Iterator[bytes]:
    """Changed copies of a file's content, each changed one to four times; the same for the same seed."""
    rng = np.random.default_rng(seed)
    ways, shares = zip(*WAYS, strict=True)
    for _ in range(count):
        changed = content
        for way in rng.choice(len(ways), size=int(rng.integers(1, 5)), p=np.array(shares) / sum(shares)):
            changed = ways[way](rng, changed)[:MOST_BYTES]
        yield changed
