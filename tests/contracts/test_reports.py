"""What the page on reports shows is run."""

import re
import runpy
from pathlib import Path

PAGE = (Path(__file__).parents[2] / "docs" / "reports.md").read_text(encoding="utf-8")


def test_the_python_of_the_page_runs(tmp_path, monkeypatch):
    blocks = re.findall(r"```python\n(.*?)```", PAGE, flags=re.S)
    assert len(blocks) == 3
    monkeypatch.chdir(tmp_path)
    (tmp_path / "page.py").write_text("\n".join(blocks), encoding="utf-8")  # the second goes on from the first
    runpy.run_path(str(tmp_path / "page.py"))
    assert "<h1>" in (tmp_path / "helix.html").read_text(encoding="utf-8")
    assert (tmp_path / "helix.parquet").exists()
