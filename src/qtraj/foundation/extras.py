"""Check for optional packages, and name the extra that installs a missing one."""

import importlib.util


def require_package(package: str, purpose: str, extra: str | None = "io") -> None:
    """Raise ModuleNotFoundError if `package` is missing, naming the `extra`, or the package if no extra has it."""
    if importlib.util.find_spec(package) is None:
        requirement = package if extra is None else f"'qtraj[{extra}]'"
        raise ModuleNotFoundError(f"{purpose} needs {package}: pip install {requirement}", name=package)
