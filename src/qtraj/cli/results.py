"""What is known over instants, and its figure, as files: the same ones from `qtraj turn` and `qtraj track`."""

import xarray
from matplotlib.figure import Figure

from qtraj.cli.columns import csv_headers, write_csv
from qtraj.cli.output import Writer
from qtraj.io.dataset import write_netcdf
from qtraj.viz.figures import save


def result_writers(dataset: xarray.Dataset, figure: Figure, name: str) -> dict[str, Writer]:
    """A dataset over instants as table.nc and table.csv, and its figure `name` as PNG and SVG."""
    headers = csv_headers(dataset)
    columns = {column: dataset[column].values for column in headers}
    return {
        "table.nc": lambda file: write_netcdf(dataset, file),
        "table.csv": lambda file: write_csv(columns, headers, file),
        f"{name}.png": lambda file: save(figure, file),
        f"{name}.svg": lambda file: save(figure, file),
    }
