"""What `qtraj report` has to say, as plain data."""

from typing import Any

from qtraj._version import __version__
from qtraj.cli.reporting.job import Job
from qtraj.viz.report.model import Report


def report_content(job: Job, report: Report) -> dict[str, Any]:
    """What was drawn, of JSON's types only."""
    return {
        "qtraj": __version__,
        "command": "report",
        "result": str(job.file),
        "title": report.title,
        "kind": report.kind,
        "findings": report.facts,
        "bodies": [
            {"name": body.name, "instants": len(body.time), "duration": float(body.time[-1])} for body in report.bodies
        ],
        "panels": [panel.title for panel in report.panels],
        "tables": [table.title for table in report.tables],
        "notes": report.notes,
        "warnings": report.warnings,
        "files": [],
    }
