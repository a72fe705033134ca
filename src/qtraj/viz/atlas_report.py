"""Atlases as one page for the browser: a figure for each value of a third parameter, which a slider selects."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Mapping
from html import escape
from importlib import resources

import matplotlib as mpl
import numpy as np

from qtraj._version import __version__
from qtraj.foundation.units import with_unit
from qtraj.sweeps.atlas.classified import CLASSES, SAMPLED
from qtraj.sweeps.atlas.outcome import Atlas
from qtraj.viz.atlas_figure import atlas_figure, limits_in
from qtraj.viz.style import RC

SCRIPT = """
const slider = document.getElementById("slice");
const slices = document.querySelectorAll("[data-slice]");
const show = () => slices.forEach((x) => { x.hidden = x.dataset.slice !== slider.value; });
slider.addEventListener("input", show);
show();
"""

STYLE = "#slice { width: min(40rem, 90vw); } figure { margin: 0; } figure img { max-width: 100%; background: #fff; }"


def atlas_page(
    atlases: Mapping[float, Atlas], name: str = "", unit: str = "1", title: str = "", value: str | None = None
) -> str:
    """Return atlases as an HTML page that needs no other file and no connection, with a slider over a third parameter.

    All figures have the same colours of limits and the same range of the value, so that they can be compared.

    Args:
        atlases: The atlas for each value of the third parameter, over the same two axes; a single one has no slider.
        name: The name of the third parameter.
        unit: Its unit in netCDF notation, such as "m s-1"; "1" without a unit.
        title: The title of the page.
        value: The name of the value that is drawn inside the feasible regions, as for `atlas_figure`; by default the
            duration.

    Raises:
        ValueError: If there is no atlas, or an atlas does not contain the value.

    Example:
        >>> import qtraj as qt
        >>> x, y = (qt.AtlasAxis(name, 0.0, 2.0, tolerance=0.5, steps=4) for name in "xy")
        >>> discs = {r: qt.atlas(lambda x, y, r=r: x**2 + y**2 < r**2, x, y) for r in (1.0, 1.5)}
        >>> atlas_page(discs, "radius", "m").count("<img")
        2
    """
    if not atlases:
        raise ValueError("there is no atlas: pass at least one, by the value of the third parameter")
    css = "\n".join(
        (resources.files("qtraj.viz.report") / name).read_text(encoding="utf-8") for name in ("report.css", "dark.css")
    )
    heading = escape(title or "Atlas")
    several = len(atlases) > 1
    labels = [f"{name.replace('_', ' ')} = {with_unit(x, unit)}" if several else "" for x in atlases]
    slider = (
        f'<p><input id="slice" type="range" min="0" max="{len(atlases) - 1}" value="0" aria-label="{escape(name)}"></p>'
    )
    return (
        f'<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n<title>{heading}</title>\n'
        f"<style>\n{css}\n{STYLE}\n</style>\n<body>\n<header><h1>{heading}</h1></header>\n"
        f"<section>{slider if several else ''}{''.join(_slices(list(atlases.values()), labels, value))}</section>\n"
        f'{_table(list(atlases.values()), labels)}<p class="small">qtraj {__version__}</p>\n'
        f"{f'<script>{SCRIPT}</script>' if several else ''}</body>\n</html>\n"
    )


def _slices(atlases: list[Atlas], labels: list[str], value: str | None) -> Iterator[str]:
    """Yield the figure and the result of each atlas."""
    limits = sorted({name for atlas in atlases for name in limits_in(atlas)})
    drawn = "duration" if value is None and all("duration" in atlas.values for atlas in atlases) else value
    bounds = _bounds(atlases, drawn)
    for k, (atlas, label) in enumerate(zip(atlases, labels, strict=True)):
        figure, file = atlas_figure(atlas, drawn, label, limits=limits, bounds=bounds), io.BytesIO()
        with mpl.rc_context(RC):
            figure.savefig(file, format="svg", dpi=150, metadata={"Date": None})
        picture = base64.b64encode(file.getvalue()).decode()
        text = escape(atlas.result)
        yield (
            f'<figure data-slice="{k}"><img alt="{escape(label or "atlas")}" src="data:image/svg+xml;base64,{picture}">'
            f"<figcaption>{text}</figcaption></figure>\n"
        )


def _bounds(atlases: list[Atlas], value: str | None) -> tuple[float, float] | None:
    """Return the smallest and the largest value at feasible points of all atlases; None if there is none."""
    if value is None or any(value not in atlas.values for atlas in atlases):
        return None
    inside = [np.asarray(atlas.values[value])[atlas.codes <= SAMPLED] for atlas in atlases]
    finite = np.concatenate([x[np.isfinite(x)] for x in inside])
    return (float(finite.min()), float(finite.max())) if finite.size else None


def _table(atlases: list[Atlas], labels: list[str]) -> str:
    """Return a table with the shares of the classes in each atlas."""
    shown = [name for name in CLASSES if any(name in atlas.shares for atlas in atlases)]
    head = "".join(f"<th>{escape(name)}</th>" for name in ("", *shown, "points"))
    rows = [
        (label, *(f"{100 * atlas.shares.get(name, 0.0):.3g} %" for name in shown), str(atlas.evaluations))
        for atlas, label in zip(atlases, labels, strict=True)
    ]
    body = "".join(f"<tr>{''.join(f'<td>{escape(x)}</td>' for x in row)}</tr>\n" for row in rows)
    table = f"<table><thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table>"
    return f"<section><h2>Shares of the area</h2>{table}</section>\n"
