"""The package as a library: what a notebook does."""

import idic


def test_an_example_is_identified_and_reported_without_prefect(tmp_path):
    idic.write_example("demo", tmp_path / "exp", reduced=True)
    result = idic.identify_experiment(tmp_path / "exp", tmp_path / "run")
    assert result["status"] == "converged"
    report = idic.write_report(tmp_path / "run")
    assert report.read_text(encoding="utf-8").lstrip().lower().startswith("<!doctype html")
    again = idic.identify_experiment(tmp_path / "exp", tmp_path / "run", resume=True)
    assert again["parameters"] == result["parameters"]


def test_every_advertised_function_can_be_imported():
    for name in idic.__all__:
        assert getattr(idic, name) is not None
