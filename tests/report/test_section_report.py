"""The report of a cross-section: profiles and the free measurement of a real run against what they must be."""

import re

import numpy as np
import pytest

from idic.run import write_report


@pytest.fixture(scope="module")
def record(gallery):
    """Of the bulge test."""
    return gallery("section").record


def test_the_simulated_profile_is_the_roughness_lifted_by_the_model(record):
    """measured + misfit = mean over the rows of f + h, and h the model's own rise: computed here from the fields."""
    k = record.fields.frames[-1]
    profile = next(view.profile for view in record.views if view.frame == k)
    rise = next(iter(record.fields.extra.values()))[-1]
    nodes = np.unique(np.concatenate([np.ravel(conn) for _, conn in record.cells]))
    x, motion = record.nodes_px[nodes, 0], record.fields.u_px[-1][nodes, 0]
    order = np.argsort(x)
    column = np.arange(record.reference.shape[1], dtype=float)
    mirrored = 2.0 * x.min() - column  # the mesh is the right half; its first node is the axis
    seen = np.maximum(column, mirrored)
    wanted = record.reference.mean(axis=0) + np.interp(seen, x[order], rise[nodes][order])
    at = column + np.where(column < x.min(), -1.0, 1.0) * np.interp(seen, x[order], motion[order])
    here = np.isfinite(profile.misfit)
    found = profile.measured[here] + profile.misfit[here]
    # straight lines between nodes and between pixels: a tenth of the roughness' mean over the rows
    assert np.sqrt(np.mean((found - np.interp(profile.column[here], at, wanted)) ** 2)) < 0.05
    assert here.mean() > 0.9 and np.ptp(rise) > 5.0


def test_the_residual_of_the_profile_is_noise(record):
    for view in record.views:
        profile, here = view.profile, view.profile.rows > 0
        z = profile.misfit[here] * np.sqrt(profile.rows[here]) / record.noise_level[view.frame]
        # about 175 columns, correlated over two or so by the spline: known to 10 %
        assert np.sqrt(np.mean(z**2)) == pytest.approx(1.0, abs=0.3)


def test_the_free_measurement_leaves_as_much_as_a_right_model_and_is_as_near_as_noise_lets_it_be(record):
    free, floor = record.free_fields, record.practice.floor
    identified = {entry["frame"]: entry["chi2_dof"] for entry in record.result["frames"]}
    for k, chi2 in zip(free.frames, free.chi2_dof, strict=True):
        assert chi2 == pytest.approx(identified[k], abs=0.02)
    apart = np.sqrt(np.nanmean(free.difference_px[..., 0] ** 2)), np.sqrt(np.nanmean(free.rise**2))
    # nodes stand close where the strip ends, and count as often: within a factor of three of the mean over the columns
    assert apart[0] < 3.0 * floor.free_px and apart[1] < 3.0 * floor.free_rise
    assert apart[0] > floor.free_px / 3.0 and apart[1] > floor.free_rise / 3.0
    assert free.length_px >= 24.0


@pytest.mark.slow  # a report
def test_the_page_has_a_slider_and_the_comparison(gallery, tmp_path):
    run = gallery("section").copied(tmp_path).run
    page = write_report(run).read_text(encoding="utf-8")
    assert page.count('class="slide"') == 8 and "Measured and simulated height" in page
    assert "Identified model and free measurement" in page and re.search(r"height, free FE-DIC", page)
    assert (run / "figures" / "free_dic.png").exists() and (run / "figures" / "frame_0008.jpeg").exists()
