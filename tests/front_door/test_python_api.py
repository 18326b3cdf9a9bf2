"""The package as a library: what a notebook does."""

import inspect
import pydoc
from pathlib import Path

import pytest
from virtual_tests.small_strip import write_small_strip

import idic
from idic.correlation import nodal_equations

ROOT = Path(__file__).parents[2]


@pytest.mark.slow  # what faults/ and report/ see of the same calls; that they are there is seen below
def test_an_example_is_identified_and_reported_without_prefect(tmp_path):
    write_small_strip(tmp_path / "exp")
    result = idic.identify(tmp_path / "exp", tmp_path / "run")
    assert result["status"] == "converged"
    report = idic.write_report(tmp_path / "run")
    assert report.read_text(encoding="utf-8").lstrip().lower().startswith("<!doctype html")
    again = idic.identify(tmp_path / "exp", tmp_path / "run", resume=True)
    assert again["parameters"] == result["parameters"]


def test_every_advertised_function_can_be_imported():
    for name in idic.__all__:
        assert getattr(idic, name) is not None


def test_the_help_of_the_package_leads_to_the_equation():
    """`import idic; help(idic)` names the function that runs; it is short enough to read and says its equations."""
    page = pydoc.plain(pydoc.render_doc(idic))
    module = "idic/correlation/image_equations/frame.py"
    assert module in page and "docs/method.md" in (ROOT / module).read_text(encoding="utf-8")
    source = inspect.getsource(nodal_equations)
    assert len(source.splitlines()) <= 40
    assert "r = f - g(x + u)" in source and "q = sum L r, H = sum L L^T" in source
