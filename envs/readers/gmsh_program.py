"""Has Gmsh read a script, in a process that may open no file besides, and writes to stdout what the script defines.

It runs alone, nothing of this package is imported. Arguments: the file of Gmsh's Python module, and the script.
"""

import importlib.util
import json
import os
import resource
import sys
from types import ModuleType
from typing import Any

#: Bytes of addresses, seconds of processor time.
MOST_BYTES, MOST_SECONDS = 4_000_000_000, 60

#: Samples of a curve at first, and at most.
SAMPLES, MOST_SAMPLES = 17, 4097

#: What a cubic between two samples may be off by in the middle, as a share of the curve's length.
ACCURATE = 1e-9

#: Samples of all curves at most.
MOST_TOTAL = 2_000_000


def loaded(file: str) -> ModuleType:
    """Gmsh's module from its file."""
    spec = importlib.util.spec_from_file_location("gmsh", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def confine(answer: int) -> None:
    """Take away what Gmsh does not need: memory, time, programs, and all files but one at a time, the script's.

    Args:
        answer: the descriptor of what is written at the end, 3.
    """
    os.closerange(answer + 1, max(map(int, os.listdir("/proc/self/fd"))) + 1)
    for limit, most in (
        (resource.RLIMIT_AS, MOST_BYTES),
        (resource.RLIMIT_CPU, MOST_SECONDS),
        (resource.RLIMIT_CORE, 0),
        (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_NPROC, 0),
        (resource.RLIMIT_NOFILE, answer + 2),
    ):
        resource.setrlimit(limit, (most, most))


def samples(gmsh: Any, tag: int) -> dict[str, list[float]]:
    """Parameters, places and derivatives along a curve, so many that cubics between them are close."""
    (low,), (high,) = gmsh.model.getParametrizationBounds(1, tag)
    n = SAMPLES
    while True:
        at = [low + (high - low) * i / (n - 1) for i in range(n)]
        places = list(gmsh.model.getValue(1, tag, at))
        slopes = list(gmsh.model.getDerivative(1, tag, at))
        middles = [0.5 * (a + b) for a, b in zip(at, at[1:], strict=False)]
        there = list(gmsh.model.getValue(1, tag, middles))
        step = (high - low) / (n - 1)
        length = off = 0.0
        for i in range(n - 1):
            here, after = places[3 * i : 3 * i + 3], places[3 * i + 3 : 3 * i + 6]
            length += sum((a - b) ** 2 for a, b in zip(here, after, strict=True)) ** 0.5
            for k in range(3):
                cubic = 0.5 * (here[k] + after[k]) + step * (slopes[3 * i + k] - slopes[3 * i + 3 + k]) / 8.0
                off = max(off, abs(cubic - there[3 * i + k]))
        if off <= ACCURATE * length or n >= MOST_SAMPLES:
            return {"at": at, "places": places, "slopes": slopes}
        n = 2 * n - 1


def described(gmsh: Any) -> dict[str, Any]:
    """What a model holds, in numbers and texts."""
    model = gmsh.model
    points = [tag for _, tag in model.getEntities(0)]
    found: dict[str, Any] = {
        "points": {tag: list(model.getValue(0, tag, [])) for tag in points},
        "sizes": dict(zip(points, model.mesh.getSizes([(0, tag) for tag in points]), strict=True)),
        "volumes": len(model.getEntities(3)),
        "curves": {},
        "surfaces": {},
        "kinds": {},
        "names": {},
        "embedded": [],
        "groups": [],
    }
    total = 0
    for _, tag in model.getEntities(1):
        ends = [abs(point) for _, point in model.getBoundary([(1, tag)], combined=False, oriented=True)]
        kind = model.getType(1, tag)
        curve: dict[str, Any] = {"kind": kind, "ends": ends}
        if kind != "Line" or len(ends) != 2:
            curve |= samples(gmsh, tag)
            total += len(curve["at"])
            if total > MOST_TOTAL:
                raise ValueError("too many curves")
        found["curves"][tag] = curve
    for _, tag in model.getEntities(2):
        found["surfaces"][tag] = [
            curve for _, curve in model.getBoundary([(2, tag)], combined=False, oriented=True, recursive=False)
        ]
        found["kinds"][tag] = model.getType(2, tag)
        found["names"][tag] = model.getEntityName(2, tag)
        found["embedded"] += [[int(dim), int(inside)] for dim, inside in model.mesh.getEmbedded(2, tag)]
    for dim, tag in model.getPhysicalGroups():
        entities = [int(entity) for entity in model.getEntitiesForPhysicalGroup(dim, tag)]
        found["groups"].append([dim, tag, model.getPhysicalName(dim, tag), entities])
    return found


def read(gmsh: Any, script: str) -> dict[str, Any]:
    """What a script defines, or the first error."""
    try:
        gmsh.open(script)
        found = described(gmsh)
    except Exception as error:
        found = {"error": str(error)}
    errors = [line.removeprefix("Error: ") for line in gmsh.logger.get() if line.startswith("Error")]
    return {"error": errors[0]} if errors else found


def main() -> None:
    """Read, within the limits."""
    module, script = sys.argv[1:]
    answer = os.dup2(1, 3)
    os.dup2(2, 1)  # what Gmsh prints is none of the answer
    found: dict[str, Any]
    try:
        gmsh = loaded(module)
        gmsh.initialize(readConfigFiles=False, interruptible=False)
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        gmsh.logger.start()
    except Exception as error:
        found = {"unavailable": str(error)}
    else:
        confine(answer)
        found = read(gmsh, script)
    with os.fdopen(answer, "w", encoding="utf-8") as out:
        json.dump(found, out)
    os._exit(0)  # at once: what Gmsh does at its end, too, is none of the answer


if __name__ == "__main__":
    main()
