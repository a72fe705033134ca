"""The report of atlases: a slider over a third parameter, equal colours in all figures, and the shares."""

import numpy as np
import pytest

import qtraj as qt
from qtraj.viz.atlas_figure import atlas_figure, limits_in
from qtraj.viz.atlas_report import atlas_page

from .browsing import errors, opened


def disc(radius):
    def classes(x, y):
        inside = x**2 + y**2 < radius**2
        limit = np.where(x > radius / 2, "speed", "curvature") if radius > 1 else np.full(x.shape, "speed")
        return {"status": inside, "first_limit": limit, "duration": radius * (1 + x)}

    axes = (qt.AtlasAxis(name, 0.0, 2.0, tolerance=0.5, steps=4) for name in "xy")
    return qt.atlas(classes, *axes)


def test_the_page_has_a_figure_and_a_row_for_each_value():
    discs = {r: disc(r) for r in (1.0, 1.5)}
    page = atlas_page(discs, "radius", "m", title="Two <discs>")
    assert page.count('<img alt="radius = ') == 2
    assert "Two &lt;discs&gt;" in page
    for r, atlas in discs.items():
        feasible = 100 * atlas.shares["feasible"]
        assert f"<td>radius = {r:g} m</td><td>{feasible:.3g} %</td>" in page
    assert "range" not in atlas_page({0.0: disc(1.0)}).partition("</style>")[2]
    with pytest.raises(ValueError, match="there is no atlas"):
        atlas_page({})
    with pytest.raises(ValueError, match="did you mean 'duration'"):
        atlas_page(discs, value="duratio")


def test_a_limit_and_a_value_have_the_same_colour_in_all_figures():
    small, large = disc(1.0), disc(1.5)
    assert (limits_in(small), limits_in(large)) == (["speed"], ["curvature", "speed"])

    def colour_of_speed(atlas, **options):
        [legend] = atlas_figure(atlas, **options).legends
        rows = zip(legend.get_texts(), legend.get_patches(), strict=True)
        return next(patch.get_facecolor() for text, patch in rows if text.get_text() == "infeasible: speed")

    assert colour_of_speed(small) != colour_of_speed(large)
    both = {"limits": limits_in(large)}
    assert colour_of_speed(small, **both) == colour_of_speed(large, **both)
    drawn = atlas_figure(small, "duration", bounds=(1.0, 3.0)).axes[0].collections[1]
    assert drawn.get_clim() == (1.0, 3.0)


def test_the_slider_selects_the_figure(browser, tmp_path):
    (tmp_path / "page.html").write_text(atlas_page({r: disc(r) for r in (1.0, 1.5)}, "radius", "m"), encoding="utf-8")
    opened(browser, tmp_path / "page.html")

    def visible():
        script = "return [...document.querySelectorAll('figure')].map((x) => x.offsetHeight > 0)"
        return browser.execute_script(script)

    assert visible() == [True, False]
    move = "const s = document.getElementById('slice'); s.value = '1'; s.dispatchEvent(new Event('input'));"
    browser.execute_script(move)
    assert visible() == [False, True]
    assert errors(browser) == []
