"""What a result hands to xarray and ArviZ, and its pictures: the numbers of the result, with their units."""

import sys

import arrays
import numpy as np
import pytest
from virtual_tests.point_strip import N_POINTS, N_STAGES, write_point_strip

import idic
from idic.errors import InputError
from idic.fe import make_mesh
from idic.notebook.dataset import strains
from idic.run import checked_frame
from idic.notebook.posterior import Posterior, posterior_of


@pytest.fixture(scope="module")
def result():
    return idic.identify(idic.Experiment(**arrays.recorded().tables()))


@pytest.mark.parametrize("cell, corners", [
    ("quad4", [[0, 0], [2, 0], [2, 1], [0, 1]]),
    ("hex8", [[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0], [0, 0, 1], [2, 0, 1], [2, 1, 1], [0, 1, 1]])])
def test_the_strain_of_a_uniform_deformation_is_green_lagrange_with_rotation_left_out(cell, corners):
    nodes = np.array(corners, float)
    d = nodes.shape[1]
    turn, stretch = np.eye(d), np.eye(d) + 0.01 * np.arange(d * d).reshape(d, d)
    stretch = (stretch + stretch.T) / 2
    turn[:2, :2] = [[0.8, -0.6], [0.6, 0.8]]
    found = strains(make_mesh(nodes, [(cell, np.arange(len(nodes))[None])]),
                    (nodes @ (turn @ stretch - np.eye(d)).T)[None])
    E = (stretch @ stretch - np.eye(d)) / 2
    expected = [E[0, 0], E[1, 1], E[0, 1]] if d == 2 else [E[0, 0], E[1, 1], E[2, 2], E[1, 2], E[0, 2], E[0, 1]]
    np.testing.assert_allclose(found[0], np.tile(expected, (len(nodes), 1)), atol=1e-13)


def test_the_dataset_has_the_fields_with_coordinates_and_units(result, tmp_path):
    xarray = pytest.importorskip("xarray")
    data = result.to_xarray()
    assert dict(data.sizes) == {"frame": 4, "node": 796, "component": 2, "strain_component": 3, "channel": 1, "row": 95,
                                "column": 135}
    assert data.u.units == "mm" and data.strain.units == "1" and data.residual.units == "grey values"
    assert data.x.units == "mm"
    assert data.channel.values.tolist() == ["force_N"] and data.channel_units.values.tolist() == ["N"]
    right = data.u.where(data.x > 0.5 * arrays.LENGTH - 1e-6, drop=True).sel(component="x")
    np.testing.assert_allclose(right, np.tile(arrays.GRIP[:, None], (1, right.sizes["node"])), atol=1e-12)  # prescribed
    mean = float(data.strain.sel(strain_component="xx", frame=3).mean())
    assert mean == pytest.approx(arrays.GRIP[3] / arrays.LENGTH, rel=0.3)  # the hole makes it uneven
    assert np.isnan(data.residual.sel(frame=0)).all()
    assert float(np.sqrt((data.residual**2).mean())) == pytest.approx(result["residual"]["image_rms_gv"], rel=1e-4)
    np.testing.assert_array_equal(data.measured.sel(channel="force_N"), arrays.recorded().loads["force_N"])
    assert abs(data.measured - data.simulated).max() < 4.0 * arrays.FORCE_NOISE
    part = result.to_xarray(frames=[-1], residual=False)
    assert part.frame.values.tolist() == [3] and "residual" not in part and part.label.values.tolist() == ["frame_003"]
    for frames in ([], 3, [2.7]):
        with pytest.raises(InputError, match="frame"):
            result.to_xarray(frames=frames, residual=False)
    assert result.strain(data.frame[-1]).shape == (796, 2, 2)  # a number of the dataset
    pytest.importorskip("h5netcdf")
    data.to_netcdf(tmp_path / "fields.nc", engine="h5netcdf")
    xarray.testing.assert_identical(xarray.load_dataset(tmp_path / "fields.nc", engine="h5netcdf"), data)


def test_measured_fields_are_told_by_their_stages_and_points_and_have_a_dataset(tmp_path):
    pytest.importorskip("xarray")
    experiment = idic.Experiment.read(write_point_strip(tmp_path / "strip"))
    assert f"{N_STAGES} stages of {N_POINTS} points, " in repr(experiment)
    assert f"{N_STAGES} stages of {N_POINTS} points, " in experiment._repr_html_()
    found = idic.identify(experiment)
    data = found.to_xarray()
    rows, columns = found.fields.experiment.recording.image_shape
    assert data.residual.shape == (N_STAGES, rows, columns) and data.residual.units == "µm"
    assert np.isfinite(data.residual.values[1:]).sum() == N_POINTS * (N_STAGES - 1)
    assert "displacement" in data.residual.long_name
    # two stages of 0.5 µm each, less what the ends are fitted to
    assert float(np.sqrt(np.nanmean(data.residual.values**2))) == pytest.approx(0.5 * 2**0.5, rel=0.1)
    assert data.row.units == data.column.units == "1"


def test_strain_of_any_measure_simulated_and_measured(result):
    simulated = {m: result.strain(3, m) for m in ("green_lagrange", "hencky", "small")}
    assert simulated["hencky"].shape == (796, 2, 2)
    # strains of a percent: the measures differ by half its square, and by the square of the rotation
    assert np.allclose(simulated["green_lagrange"], simulated["hencky"],
                       atol=2.0 * np.abs(simulated["hencky"]).max() ** 2)
    assert np.allclose(result.strain(3, angle_deg=90.0)[:, 0, 0], simulated["green_lagrange"][:, 1, 1])
    measured = result.strain(-1, "hencky", source="measured")
    length = result.fields.experiment.model.mesh.nodes[:, 0]
    inner = np.abs(length) < 4.0
    assert np.nanmean(measured[inner, 0, 0]) == pytest.approx(np.nanmean(simulated["hencky"][inner, 0, 0]), rel=0.15)
    with pytest.raises(InputError, match="no such strain"):
        result.strain(3, "true")
    with pytest.raises(InputError, match="no such field"):
        result.strain(3, source="guessed")


def test_the_dataset_holds_the_measured_fields_where_they_are_asked_for(result):
    pytest.importorskip("xarray")
    data = result.to_xarray(frames=[-1], residual=False, measured=True)
    apart = float(np.sqrt(((data.u_measured - data.u) ** 2).mean()))
    assert 0.0 < apart < 0.05 * arrays.PIXEL / 0.1, "a twentieth of a pixel: noise of nodes 0.3 mm apart"
    assert data.strain_measured.shape == data.strain.shape


def test_draws_of_the_posterior_have_its_mean_and_covariance():
    """Also of a parameter in MPa next to one of order one."""
    posterior = Posterior(("E", "nu"), np.array([7e4, 0.3]), np.array([[1e4, -0.9], [-0.9, 1e-4]]), ("MPa", ""))
    draws = posterior.draws(40_000, seed=1)
    assert np.abs((draws.mean(axis=0) - posterior.mean) / posterior.std).max() < 4.0 / 200.0
    np.testing.assert_allclose((draws.std(axis=0) / posterior.std), 1.0, atol=4.0 / np.sqrt(80_000))
    assert np.corrcoef(draws.T)[0, 1] == pytest.approx(-0.9, abs=4.0 * (1.0 - 0.81) / 200.0)
    assert (posterior.draws(3, seed=1) == posterior.draws(3, seed=1)).all()


@pytest.mark.filterwarnings("ignore::FutureWarning")  # ArviZ announces its next version
def test_arviz_reads_the_posterior_with_units(result):
    arviz = pytest.importorskip("arviz")
    data = result.to_arviz(draws=2000, chains=2)
    assert type(data).__name__ == ("InferenceData" if arviz.__version__.startswith("0.") else "DataTree")
    assert dict(data["posterior"].sizes) == {"chain": 2, "draw": 2000}
    for name in arrays.TRUTH:
        estimate, drawn = result.parameters[name], data["posterior"][name]
        assert float(drawn.mean()) == pytest.approx(estimate.value, abs=4.0 * estimate.std / np.sqrt(4000))
        assert float(drawn.std()) == pytest.approx(estimate.std, rel=4.0 / np.sqrt(8000))
    assert data["posterior"]["sheet.E"].attrs["units"] == "MPa"


@pytest.mark.parametrize("package, call", [("pandas", "to_frame"), ("xarray", "to_xarray"), ("arviz", "to_arviz")])
def test_without_a_package_the_message_says_what_to_install(result, monkeypatch, package, call):
    monkeypatch.setitem(sys.modules, package, None)  # Python's own sign of a module that cannot be imported
    with pytest.raises(InputError, match=f"{package} is not installed") as told:
        getattr(result, call)()
    assert f"pip install {package}" in told.value.remedy


def test_the_residual_is_drawn_in_units_of_the_noise(result):
    figure = result.plot.residual(frame=-1)
    (shown,) = figure.axes[0].images
    residual = result.fields.residual(3)
    drawn, seen = np.asarray(shown.get_array().filled(np.nan)), np.isfinite(residual)
    ratio = residual[seen] / drawn[seen]
    assert ratio.std() < 1e-5 * ratio.mean()  # one factor, the noise: single precision
    assert np.sqrt(np.mean(drawn[seen]**2)) == pytest.approx(np.sqrt(result["frames"][3]["chi2_dof"]), rel=1e-4)
    assert "frame 3" in figure.axes[0].get_title(loc="left") and figure._repr_png_().startswith(b"\x89PNG")
    for frame in (0, 4):
        with pytest.raises(InputError, match="no such frame"):
            result.plot.residual(frame=frame)
    assert checked_frame(result.fields.experiment.model, -3, later=True) == 1


def test_channels_are_drawn_as_measured_and_simulated(result):
    top, bottom = result.plot.channels().axes
    lines = {line.get_label(): line.get_ydata() for line in top.lines}
    np.testing.assert_array_equal(lines["measured"], arrays.recorded().loads["force_N"])
    np.testing.assert_allclose(bottom.lines[-1].get_ydata(), lines["measured"] - lines["simulated"])
    assert top.get_ylabel() == "force [N]"


def test_the_ellipses_of_the_corner_plot_hold_68_and_95_percent(result):
    figure = result.plot.corner()
    pair = next(axis for axis in figure.axes if axis.get_visible() and "correlation" in axis.get_title(loc="center"))
    draws = posterior_of(result.content).draws(10_000)
    held = [line.get_path().contains_points(draws).mean() for line in pair.lines[:2]]
    assert held == pytest.approx([0.68, 0.95], abs=0.02)  # four standard deviations of a share of 10 000
    assert pair.get_xlabel() == "E [MPa]" and pair.get_ylabel() == "nu"
    assert len(result.plot.corner(parameters=["sheet.nu"]).axes) == 1
    with pytest.raises(InputError, match="does not determine"):
        result.plot.corner(parameters=["sheet.G"])
