"""Report progress to a user's function, or display it."""

from collections.abc import Iterator
from contextlib import contextmanager

from qtraj.foundation.extras import require_package
from qtraj.foundation.progress import Report, throttled


@contextmanager
def reporting(progress: Report | bool | None) -> Iterator[Report | None]:
    """Return a function for progress reports: a user's function, or a display on the terminal if `progress` is true.

    **Raises:** ModuleNotFoundError with the extra to install, if `progress` is true and a package is missing.
    """
    if progress is True:
        require_package("rich", "displaying progress", "cli")
        from qtraj.foundation.progress_bar import watching

        with watching() as watch:
            yield throttled(watch.tuning)
    else:
        yield throttled(progress) if progress else None
