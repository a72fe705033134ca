"""Packages that come with an extra: say which one where they are missing."""

import importlib.util


def require_package(package: str, purpose: str, extra: str | None = "io") -> None:
    """Raise ModuleNotFoundError where `package` is not installed, naming the extra (or the package, of no extra)."""
    if importlib.util.find_spec(package) is None:
        wanted = package if extra is None else f"'qtraj[{extra}]'"
        raise ModuleNotFoundError(f"{purpose} needs {package}: pip install {wanted}", name=package)
