"""What every command says about its scenario, as plain data, and data that JSON can hold."""

import math
from pathlib import Path
from typing import Any

from qtraj.io.scenario import ScenarioFile


def scenario_content(given: ScenarioFile[Any]) -> dict[str, Any]:
    """Which scenario it was; `source` is that of its recording, where it has one."""
    scenario = given.scenario
    source = getattr(getattr(scenario, "track", None), "source", None)
    about = {"name": scenario.name, "description": scenario.description, "source": source}
    return {"file": str(given.file), "sha256": given.hash} | {k: v and v.strip() for k, v in about.items()}


def provenance(file: Path, about: dict[str, Any]) -> dict[str, str]:
    """Attributes of a dataset that say where it comes from."""
    known = {"title": about["name"], "recording": about["source"], "scenario_sha256": about["sha256"]}
    return {name: text for name, text in known.items() if text} | {"scenario_file": file.name}


def finite(value: Any) -> Any:
    """The same data with None in place of NaN and infinities, which JSON cannot hold."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: finite(v) for key, v in value.items()}
    return [finite(v) for v in value] if isinstance(value, list) else value
