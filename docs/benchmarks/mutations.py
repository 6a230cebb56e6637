"""Breaks the code in one place after another, and asks each time that a test notices: writes docs/mutations.md.

    .venv/bin/python docs/benchmarks/mutations.py --out docs
    .venv/bin/python docs/benchmarks/mutations.py --only seam

What is broken, where, and the test that has to fail stand in mutations.yaml. The code that is broken is a copy of the
checkout; the checkout itself is only read. First every test has to pass there as it is. A test notices a mutation when
it fails by an assertion of its own: code that cannot be imported, a fixture that cannot be made or an exception that
nobody expected proves nothing of the test.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import yaml
from script import run_script

from envs.errors import FAILED, UserError
from freemesh_ray.cli import arguments
from freemesh_ray.formatting.markdown import in_cell
from freemesh_ray.storage.atomic import check_writable, replacing

ROOT = Path(__file__).resolve().parents[2]
MUTATIONS = Path(__file__).with_suffix(".yaml")
PAGE = "mutations.md"
#: Seconds after which a test that does not end is ended; it has noticed nothing.
PATIENCE = 1_200.0
#: What the message of a test that fails by an assertion begins with.
ASSERTION = ("assert ", "AssertionError", "Failed: ")

TEXT = """\
# Mutations

`.venv/bin/python docs/benchmarks/mutations.py --out docs` breaks a copy of the checkout in one of these places at a
time and runs the test beside it, which has to fail by an assertion; unbroken, the same tests pass. It writes this page
when all were noticed. The texts before and after are in [mutations.yaml](benchmarks/mutations.yaml).

| what was broken | where | the test that noticed |
|---|---|---|
{rows}
"""


class UnnoticedError(UserError):
    """Mutations that no test noticed, or tests that fail without any."""

    exit_code = FAILED


@dataclass(frozen=True)
class Mutation:
    """One place to break the code in.

    Attributes:
        breaks: what is wrong then, in a short sentence.
        file: from the root.
        old: text that the file has once.
        new: what takes its place.
        test: the test that has to fail, as ``tests/mesher/test_mesher.py::test_finishing_can_be_left_out``.
        interpreted: whether kernels run as plain Python, for a kernel that is not worth compiling anew.
    """

    breaks: str
    file: str
    old: str
    new: str
    test: str
    interpreted: bool = False


class Outcome(NamedTuple):
    """How tests ended.

    Attributes:
        passed: whether all did.
        noticed: whether one failed, by an assertion.
        said: the first failure's message, or the end of what pytest printed.
    """

    passed: bool
    noticed: bool
    said: str


def mutations() -> list[Mutation]:
    """Those of the file, in its order."""
    return [Mutation(**one) for one in yaml.safe_load(MUTATIONS.read_text(encoding="utf-8"))["mutations"]]


def page() -> str:
    """The document."""
    rows = [
        f"| {in_cell(one.breaks)} | [{one.file}](../{one.file}) | [{name}](../{place}) |"
        for one in mutations()
        for place, _, name in [one.test.partition("::")]
    ]
    return TEXT.format(rows="\n".join(rows))


@contextmanager
def copied() -> Iterator[Path]:
    """A copy of what a clone would hold if all was committed, with the kernels that are compiled already."""
    with tempfile.TemporaryDirectory(prefix="mutations-") as folder:
        listed = subprocess.run(
            ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            cwd=ROOT, capture_output=True, text=True, check=True,
        ).stdout.split("\0")  # fmt: skip
        copy = Path(folder) / "checkout"
        for name in filter(None, listed):
            if (ROOT / name).is_file():
                (copy / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, copy / name)
        for kernels in ROOT.glob("*/__pycache__/kernels-*"):
            shutil.copytree(kernels, copy / kernels.relative_to(ROOT))
        yield copy


def environment(copy: Path, interpreted: bool) -> dict[str, str]:
    """For tests of the copy: its packages come before those that are installed."""
    own = os.environ | {"PYTHONPATH": str(copy)}
    return own | {"NUMBA_DISABLE_JIT": "1"} if interpreted else own


def tried(copy: Path, tests: Sequence[str], interpreted: bool) -> Outcome:
    """How tests end in a copy of the checkout."""
    report = copy.parent / "report.xml"
    report.unlink(missing_ok=True)
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n0", "-p", "no:cacheprovider", f"--junitxml={report}"]
    try:
        done = subprocess.run(
            [*command, *tests], cwd=copy, env=environment(copy, interpreted), capture_output=True, text=True,
            timeout=PATIENCE,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return Outcome(passed=False, noticed=False, said=f"no end after {PATIENCE:g} s")
    printed = "\n".join((done.stdout + done.stderr).splitlines()[-20:])
    if done.returncode != 1 or not report.is_file():
        return Outcome(passed=done.returncode == 0, noticed=False, said=printed)
    cases = ElementTree.parse(report)
    failures = [failure.get("message", "") for failure in cases.iter("failure")]
    noticed = bool(failures) and not any(True for _ in cases.iter("error")) and failures[0].startswith(ASSERTION)
    return Outcome(passed=False, noticed=noticed, said=failures[0] if failures else printed)


@contextmanager
def broken(copy: Path, mutation: Mutation) -> Iterator[None]:
    """The copy with one place broken, as long as the body runs.

    Raises:
        UserError: the file has not the text exactly once.
    """
    path = copy / mutation.file
    text = path.read_text(encoding="utf-8")
    if text.count(mutation.old) != 1:
        raise UserError(f"{mutation.file}: {mutation.old!r} is there {text.count(mutation.old)} times, not once")
    path.write_text(text.replace(mutation.old, mutation.new), encoding="utf-8")
    try:
        yield
    finally:
        path.write_text(text, encoding="utf-8")


def try_all(chosen: Sequence[Mutation]) -> None:
    """Break the code in every place, and print what noticed.

    Raises:
        UnnoticedError: a mutation went unnoticed, or a test fails without one.
    """
    tell = partial(print, flush=True)
    with copied() as copy:
        for interpreted in (False, True):
            tests = list(dict.fromkeys(one.test for one in chosen if one.interpreted == interpreted))
            began = time.monotonic()
            if not tests:
                continue
            if not (outcome := tried(copy, tests, interpreted)).passed:
                tell(outcome.said)
                raise UnnoticedError("the code as it is: a test fails, which proves nothing; mend it first")
            tell(f"as it is: {len(tests)} tests pass ({time.monotonic() - began:.0f} s)")
        unnoticed = []
        for i, mutation in enumerate(chosen, 1):
            began = time.monotonic()
            with broken(copy, mutation):
                outcome = tried(copy, [mutation.test], mutation.interpreted)
            word = "noticed" if outcome.noticed else "UNNOTICED"
            tell(f"{i}/{len(chosen)} {word} ({time.monotonic() - began:.0f} s): {mutation.breaks}")
            tell(
                "    " + (outcome.said.replace("\n", "\n    ") if not outcome.noticed else outcome.said.split("\n")[0])
            )
            if not outcome.noticed:
                unnoticed.append(mutation.breaks)
    if unnoticed:
        raise UnnoticedError(f"{len(unnoticed)} of {len(chosen)} mutations went unnoticed: {'; '.join(unnoticed)}")


def main() -> None:
    """Parse the command line, break the code, and write the page."""
    parser = arguments.Parser(description="Break the code in many places, and ask each time that a test notices.")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help=f"where {PAGE} is written (nowhere)")
    parser.add_argument("--only", default="", metavar="WORDS", help="what is broken, or where, has these words (all)")
    options = parser.parse_args()
    if options.out is not None:
        if options.only:
            parser.error("--out and --only: the page has all mutations; give one of the two")
        check_writable(options.out / PAGE)
    chosen = [one for one in mutations() if options.only in one.breaks or options.only in one.file]
    if not chosen:
        raise UserError(f"--only {options.only}: no mutation has these words; give others")
    try_all(chosen)
    if options.out is not None:
        with replacing(options.out / PAGE) as draft:
            draft.write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    run_script(main)
