"""Reads Parquet from stdin in a process that may take little memory and time; the exit code says whether that did.

A few bytes of Parquet may stand for any number of values, and the library takes memory for what a file merely says that
it holds. It runs alone: nothing of this package is imported.
"""

import os
import resource
import sys
from io import BytesIO

#: Bytes of addresses beside those of the program itself, and seconds of processor time.
MOST_BYTES, MOST_SECONDS = 400_000_000, 60


def main() -> None:
    """Read, within the limits."""
    import pyarrow.parquet as parquet

    content = sys.stdin.buffer.read()
    with open("/proc/self/statm", encoding="ascii") as file:
        taken = int(file.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + MOST_BYTES, taken + MOST_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_SECONDS, MOST_SECONDS))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        with parquet.ParquetFile(BytesIO(content), pre_buffer=False) as file:
            file.read(use_threads=False).validate(full=True)
    except Exception as error:
        sys.stderr.write(f"{error or type(error).__name__}\n")
        os._exit(1)
    os._exit(0)  # at once: threads of the library that got no memory are waited for in vain


if __name__ == "__main__":
    main()
