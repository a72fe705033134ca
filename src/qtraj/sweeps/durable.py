"""Write files that are complete under their name, or absent, even if the process is killed."""

import os
import uuid
from pathlib import Path


def write_whole(file: Path, content: bytes | memoryview, staging: Path, flush: bool = True) -> None:
    """Write a file into the folder `staging` of the same file system, and move it to its place.

    With `flush`, the content is first flushed to the disk, which takes some milliseconds.

    **Raises:** OSError, for example if the disk is full; the file then does not exist.
    """
    staged = staging / uuid.uuid4().hex
    try:
        with staged.open("wb") as stream:
            stream.write(content)
            if flush:
                stream.flush()
                os.fsync(stream.fileno())
        os.replace(staged, file)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(file)) from error
    finally:
        staged.unlink(missing_ok=True)
