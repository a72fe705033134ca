"""Check whether optional packages are installed, and name the extra that installs a missing package."""

import importlib.util


def require_package(package: str, purpose: str, extra: str | None = "io") -> None:
    """Raise a ModuleNotFoundError with installation advice if `package` is missing.

    `extra` is the extra of qtraj that contains the package, or None if no extra does.
    """
    if importlib.util.find_spec(package) is None:
        requirement = package if extra is None else f"'qtraj[{extra}]'"
        raise ModuleNotFoundError(f"{purpose} needs {package}: pip install {requirement}", name=package)
