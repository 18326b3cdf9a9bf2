"""A fit over frames at rest is never a good one: what the images leave to identify from is said."""

from __future__ import annotations

import numpy as np
import pytest
import tifffile
from twin_runs import judged
from virtual_tests.small_strip import write_small_strip

from idic.report import remarks, result_headline, result_verdict

EDGE = 'u = "measured"'


@pytest.fixture
def strip(tmp_path):
    """An elastic strip between measured edges: the reference, two frames at rest; frames are added by the test."""
    folder = write_small_strip(tmp_path / "strip")
    file = folder / "experiment.toml"
    text = file.read_text().replace('law = "j2_linear"', 'law = "elastic"')
    text = "\n".join(line for line in text.splitlines() if not line.startswith(("yield_stress", "hardening_modulus")))
    text = text.replace("ux = 0.0\nuy = 0.0", EDGE).replace(
        "ux = { column = \"grip_displacement_mm\", noise_std = 0.0002 }\nuy = 0.0", EDGE)
    assert text.count(EDGE) == 2
    file.write_text(text)
    return folder


def with_frames(folder, images, forces):
    for file in (folder / "images").iterdir():
        file.unlink()
    for k, image in enumerate(images):
        tifffile.imwrite(folder / "images" / f"frame_{k:03d}.tif", image)
    rows = [f"{k},{k},{force},0.0" for k, force in enumerate(forces)]
    (folder / "loads.csv").write_text("\n".join(["frame,time_s,force_N,grip_displacement_mm", *rows]) + "\n")
    return folder


def images_of(folder):
    """The reference, two frames at rest, frames 1 and 2 under load, and an image of something else."""
    rng = np.random.default_rng(4)
    first, second, third = (tifffile.imread(folder / "images" / f"frame_00{k}.tif") for k in range(3))
    still = [np.clip(np.rint(first + 2.0 * rng.standard_normal(first.shape)), 0, 255).astype(np.uint8)
             for _ in range(2)]
    return first, *still, second, third, rng.integers(0, 255, first.shape).astype(np.uint8)


def test_the_only_loaded_image_is_dropped(strip):
    reference, still, again, *_, other = images_of(strip)
    result = judged(with_frames(strip, [reference, still, again, other], [1.2, -3.0, 2.0, 2611.6]))
    assert result["frames"][3]["status"] == "unexplained" and not result["frames"][3]["used"]
    assert result["basis"] == {"loaded": 1, "compared": 0, "dropped": 1, "load_compared": 0.0, "load_dropped": 1.0,
                               "sufficient": False}
    assert result_verdict(result)[0] == "bad"
    text = "The only loaded image is left out: the values rest on the readings and images at rest alone."
    assert any(text in sentence for sentence in result_headline(result))
    assert any(text in sentence for sentence in remarks(result))
    determined = result | {"parameters": {"sheet.nu": {"free": True, "value": 0.2, "std": 0.15, "unit": ""}},
                           "not_identifiable": [], "residual": {"image_chi2_dof": 1.0}}
    assert result_verdict(determined) == ("bad", "No loaded image is compared: do not use the values")
    assert result_verdict(determined | {"basis": result["basis"] | {"sufficient": True}})[0] == "good"


def test_most_of_the_load_is_dropped_or_next_to_none_of_it(strip):
    reference, still, again, second, third, other = images_of(strip)
    forces = [1.2, -3.0, 2.0, 1310.6, 2611.6]
    most = judged(with_frames(strip, [reference, still, again, second, other], [*forces[:4], 5200.0]))
    assert [frame["status"] for frame in most["frames"]] == ["ok", "ok", "ok", "ok", "unexplained"]
    assert most["basis"]["load_compared"] == pytest.approx(0.252, abs=0.001) and not most["basis"]["sufficient"]
    assert any("up to 25 % of the largest load" in sentence for sentence in remarks(most))
    assert result_verdict(most | {"residual": {"image_chi2_dof": 1.0}})[0] != "good"
    whole = judged(with_frames(strip, [reference, still, other, second, third], forces))
    assert whole["basis"]["dropped"] == 0 and whole["basis"]["sufficient"]  # an odd frame at rest holds no load
