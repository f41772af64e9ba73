"""Files that are either whole or not there."""

import os
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path):
    """A name to write a new file under, which takes the place of `path` once it is complete.

    A process killed at any moment leaves the old file or the new one, never a part of either.
    """
    path = Path(path)
    new = path.with_name(f".{os.getpid()}-{path.name}")
    try:
        yield new
        with new.open("rb") as written:
            os.fsync(written.fileno())  # else a power cut could leave an empty file under the name
        os.replace(new, path)
    finally:
        new.unlink(missing_ok=True)
