"""The gallery: written, resumed, shown, refused, with its smallest example."""

from __future__ import annotations

import re

import pytest
from typer.testing import CliRunner

from idic.cli.app import app
from idic.errors import InputError
from idic_studies.pages.gallery_page import render_gallery
from idic_studies.cases.gallery import make_gallery
from idic_studies.cases.gallery_examples import gallery_examples


@pytest.fixture(scope="module")
def gallery(tmp_path_factory):
    """The smallest example, and what was said."""
    out, lines = tmp_path_factory.mktemp("gallery") / "out", []
    page = make_gallery(out, ["composite"], say=lines.append)
    return out, page, lines


@pytest.mark.slow  # an identification and its report
def test_the_page_shows_the_numbers_and_leads_to_a_report_that_is_there(gallery):
    out, page, lines = gallery
    assert lines[0] == "composite: making the virtual test" and "converged" in lines[-1]
    text = page.read_text(encoding="utf-8")
    links = set(re.findall(r'href="([^"#]+)"', text))
    assert links == {"composite/run/report.html"} and all((out / link).is_file() for link in links)
    assert "E1/E2" in text and "Good fit" in text and "only ratios of moduli" in text
    assert text.count("data:image/jpeg;base64,") == 1
    assert not re.search(r"https?://|@import|url\(", text)


@pytest.mark.slow  # shares that report
def test_the_ratios_of_the_ply_are_the_true_ones(gallery):
    out, _, _ = gallery
    import json

    rows = json.loads((out / "composite" / "entry.json").read_text())["parameters"]
    assert {row["name"] for row in rows} == {"nu12", "E1/E2", "E1/G12", "E2/G12"}
    assert all(abs(row["off"]) < 4.0 for row in rows)  # one draw of four correlated values


@pytest.mark.slow  # shares that report
def test_finished_examples_are_not_made_again(gallery):
    out, page, _ = gallery
    before, lines = (out / "composite" / "run" / "result.json").stat().st_mtime_ns, []
    assert make_gallery(out, ["composite"], resume=True, say=lines.append) == page
    assert lines == ["composite: finished before"]
    assert (out / "composite" / "run" / "result.json").stat().st_mtime_ns == before


@pytest.mark.slow  # shares that report
def test_the_composite_report_has_the_free_measurement_and_no_stress_strain_curve(gallery):
    out, _, _ = gallery
    text = (out / "composite" / "run" / "report.html").read_text(encoding="utf-8")
    assert "no stress-strain curve, as this test does not determine sheet.E1, sheet.E2, sheet.G12" in text
    assert "Identified model and free FE-DIC" in text and "no force is compared" in text
    assert "processor time" in text and "190 × 125 px" in text


@pytest.mark.slow  # shares that report
def test_a_folder_with_something_in_it_and_an_unknown_name_are_refused(gallery, tmp_path):
    out, _, _ = gallery
    with pytest.raises(InputError, match="not empty"):
        make_gallery(out, ["composite"])
    with pytest.raises(InputError, match="no such experiment"):
        make_gallery(tmp_path / "new", ["nonsense"])
    assert not (tmp_path / "new").exists()


def test_the_command_says_so_with_exit_code_2(tmp_path):
    done = CliRunner().invoke(app, ["gallery", "--out", str(tmp_path / "g"), "--only", "nonsense"])
    assert done.exit_code == 2 and "plate, bulge, polycarbonate, composite, two-speeds, wrong-model" in done.stderr


def test_six_examples_of_six_names():
    found = gallery_examples()
    assert len(found) == len({example.name for example in found}) == 6
    assert sum(example.diagnose for example in found) == 1


def test_an_entry_without_a_picture_is_shown():
    entry = {"name": "a", "title": "A & B", "sentence": "s", "level": "good", "verdict": "v", "parameters": [],
             "open": "", "diagnosis": None, "pages": {"report": "a/run/report.html"}, "frames": 3, "cpu_s": 1.0}
    assert "A &amp; B" in render_gallery([entry], {})
