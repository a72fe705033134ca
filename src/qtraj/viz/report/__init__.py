"""Create interactive reports, each a single HTML file that works offline (plotly)."""

from qtraj.viz.report.page import report_page

__all__ = ["report_page"]
