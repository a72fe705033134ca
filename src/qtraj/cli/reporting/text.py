"""The outcome of `qtraj report` on the terminal."""

from typing import Any

from rich.console import Console
from rich.text import Text

from qtraj.cli.layout import print_files


def print_report(console: Console, content: dict[str, Any]) -> None:
    """What was drawn, and the file to open."""
    console.print(Text(content["title"], style="bold"))
    for fact in (*content["findings"], *content["notes"]):
        console.print(Text(fact))
    for warning in content["warnings"]:
        console.print(Text(f"Warning: {warning}", style="bold red"))
    for body in content["bodies"]:
        console.print(Text(f"{body['name']}: {body['instants']} instants, {body['duration']:.4f} s"))
    print_files(console, content["files"])
    console.print(Text("Open it in a browser; it needs no network."))
