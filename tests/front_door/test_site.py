"""The documentation site: a page for everything that is registered, links that lead somewhere, examples that run."""

import doctest
import importlib
import re
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "docs"), str(ROOT / "tests" / "identify")]

site = importlib.import_module("site_pages")


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """The pages as Sphinx gets them, with a gallery of one report; pictures of laws are drawn in another test."""
    folder = tmp_path_factory.mktemp("site")
    report = folder / "gallery" / "plate" / "run" / "report.html"
    report.parent.mkdir(parents=True)
    report.write_text("<p>a report</p>", encoding="utf-8")
    (folder / "gallery" / "index.html").write_text("<p>all</p>", encoding="utf-8")
    site.write_source(folder / "source", folder / "gallery", pictures=False)
    return folder / "source"


def test_every_law_and_every_candidate_has_its_page(source):
    from idic.diagnose import candidate_library
    from idic.laws import all_laws, get_law

    for name in all_laws():
        text = (source / "laws" / f"{name}.md").read_text(encoding="utf-8")
        assert get_law(name).reference in text and all(f"`{p.name}`" in text for p in get_law(name).parameters)
    for one in candidate_library():
        text = (source / "candidates" / f"{one.name}.md").read_text(encoding="utf-8")
        assert f"# {one.title}" in text and one.null.replace("|", "\\|") in text
        assert all(f"[{r}]" in text or f"`{r}`" in text for r in one.rivals)


def test_every_command_has_its_page_with_all_its_options(source):
    from typer.main import get_command

    from idic.cli.app import app

    for name, command in get_command(app).commands.items():
        text = (source / "commands" / f"{name}.md").read_text(encoding="utf-8")
        assert text.startswith(f"# idic {name}\n") and command.help.strip().split("\n")[0] in text
        assert all(option in text for parameter in command.params for option in parameter.opts
                   if option.startswith("--") and not parameter.hidden)


def test_every_example_has_a_page_with_its_code(source):
    scripts = sorted(site.EXAMPLES.glob("*.py"))
    assert scripts
    for script in scripts:
        text = (source / "examples" / f"{script.stem}.md").read_text(encoding="utf-8")
        assert text.startswith("# ") and script.read_text(encoding="utf-8").strip().splitlines()[-1] in text


@pytest.mark.slow  # an identification: 20 s of processor time
def test_every_example_runs_and_shows_what_it_prints_and_draws(tmp_path):
    for name in site._example_pages(tmp_path, execute=True):
        text = (tmp_path / f"{name}.md").read_text(encoding="utf-8")
        pictures = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text)
        assert "```text\n\n" not in text and pictures and all((tmp_path / picture).stat().st_size > 5000
                                                              for picture in pictures)


def test_every_page_of_the_docs_is_in_a_table_of_contents(source):
    listed = re.findall(r"^[\w/-]+$", (source / "index.md").read_text(encoding="utf-8"), re.MULTILINE)
    pages = {str(page.relative_to(source).with_suffix("")) for page in source.rglob("*.md")} - {"index"}
    assert pages == set(listed) and len(listed) == len(set(listed))


def test_links_of_the_site_lead_to_its_pages(source):
    for page in source.rglob("*.md"):
        text = re.sub(r"^(`{3,})[^\n]*\n.*?^\1", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
        for target in re.findall(r"\]\(([^)\s]+)\)", text):
            if not target.startswith(("http", "#")) and not target.endswith(".png"):
                assert (page.parent / target.partition("#")[0]).exists(), f"{page.name}: {target}"


def test_the_python_reference_states_shapes_and_units(source):
    text = (source / "python" / "fields.md").read_text(encoding="utf-8")
    assert "### strain" in text and "(..., d, d)" in text and "Raises" in text
    text = (source / "python" / "from-python-objects.md").read_text(encoding="utf-8")
    assert "#### Result.to_xarray" in text


def test_the_gallery_is_part_of_the_site(source):
    assert (source / "extra" / "gallery" / "plate" / "run" / "report.html").exists()
    text = (source / "gallery-of-reports.md").read_text(encoding="utf-8")
    assert "gallery/plate/run/report.html" in text
    assert 'href="gallery/index.html"' in text and (source / "extra" / "gallery" / "index.html").exists()


def modules_with_examples():
    for file in sorted((ROOT / "idic").rglob("*.py")):
        if ">>>" in file.read_text(encoding="utf-8"):
            yield ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory):
    """A folder with an experiment my-test, and the names that the examples take for granted."""
    from twin_runs import ELASTIC, FORCE, GRIPS, Twin, write_folder

    from idic.correlation import PixelMap, ReferenceImage
    from idic.measure import Regularisation, build_smoother
    from idic.experiment_file import load_experiment
    from idic.images import prefilter

    folder = tmp_path_factory.mktemp("laboratory")
    experiment = load_experiment(write_folder(folder / "my-test", Twin(seed=1), ELASTIC + GRIPS + FORCE))
    f, g = (experiment.recording.stack.frame(k) for k in (0, 1))
    return folder, {"mesh": experiment.model.mesh, "camera": experiment.model.camera, "f": f, "g": g,
                    "prefilter": prefilter,
                    "PixelMap": PixelMap, "ReferenceImage": ReferenceImage, "build_smoother": build_smoother,
                    "Regularisation": Regularisation}


@pytest.mark.parametrize("name", sorted(set(modules_with_examples()) - {"idic.notebook.experiment"}))
def test_the_examples_in_docstrings_run(name, laboratory, monkeypatch):
    """Those of idic.notebook.experiment run with its images (tests/notebook/test_notebook_experiment.py)."""
    folder, names = laboratory
    monkeypatch.chdir(folder)
    assert doctest.testmod(importlib.import_module(name), extraglobs=names).failed == 0


@pytest.mark.slow
def test_sphinx_builds_the_site_without_a_warning(tmp_path):
    if find_spec("sphinx") is None or find_spec("myst_parser") is None or find_spec("furo") is None:
        pytest.skip("Sphinx is not installed: pip install '.[docs]'")
    assert site.build(tmp_path / "site") == 0
    index = (tmp_path / "site" / "html" / "index.html").read_text(encoding="utf-8")
    assert "Search" in index and (tmp_path / "site" / "html" / "searchindex.js").exists()
    assert not re.search(r'<(?:script|link)[^>]+(?:src|href)="https?://', index), "the site asks no other server"
