"""`idic fields`: what another program reads is what the run holds."""

import csv

import meshio
import numpy as np
import pytest
import zarr

from idic.errors import InputError
from idic.measure import field_columns
from idic.run import export_fields


@pytest.fixture(scope="module")
def run(gallery):
    return gallery("plate").shown


@pytest.fixture(scope="module")
def exact(gallery):
    return field_columns(gallery("plate").record.series, 4, "hencky", 30.0)


def test_a_table_has_a_row_per_node(run, exact, tmp_path):
    folder = export_fields(run, tmp_path / "csv", "csv", "hencky", 30.0)
    assert len(list(folder.glob("frame_*.csv"))) == 6
    with open(folder / "frame_0004.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[:3] == ["node", "x_mm", "y_mm"]
    for name, values in exact.items():
        assert np.allclose([float(row[name]) for row in rows], values, rtol=1e-7, atol=1e-12), name  # 9 digits


@pytest.mark.parametrize("name, tolerance", [("vtu", 1e-6), ("xdmf", 1e-12)])  # float32; text of doubles
def test_meshio_reads_the_series(run, exact, tmp_path, name, tolerance):
    path = export_fields(run, tmp_path / name, name, "hencky", 30.0)
    if name == "xdmf":
        with meshio.xdmf.TimeSeriesReader(path) as reader:
            reader.read_points_cells()
            time, data, _ = reader.read_data(4)
            assert reader.num_steps == 6 and time == 4.0
    else:
        data = meshio.read(path.parent / "frame_0004.vtu").point_data
    for key, values in exact.items():
        assert np.allclose(np.ravel(data[key]), values, rtol=tolerance, atol=tolerance * np.abs(values).max()), key
    pair = np.column_stack([exact["u_x_mm"], exact["u_y_mm"]])
    assert np.allclose(data["displacement_mm"][:, :2], pair)


def test_zarr_holds_named_arrays_over_the_frames(run, exact, tmp_path):
    path = export_fields(run, tmp_path, "zarr", "hencky", 30.0)
    group = zarr.open_group(path, mode="r")
    assert group["frame"][:].tolist() == [0, 1, 2, 3, 4, 5] and group["time"][4] == 4.0
    for name, values in exact.items():
        assert np.array_equal(group[name][4], values, equal_nan=True), name
    with pytest.raises(InputError, match="there is such a file"):
        export_fields(run, tmp_path, "zarr")


def test_an_unknown_format_is_refused_before_anything_is_written(run, tmp_path):
    with pytest.raises(InputError, match="no such format"):
        export_fields(run, tmp_path / "new", "xlsx")
    assert not (tmp_path / "new").exists()
