"""A start from which no descent leads: softening that begins at once, or never, in a strip that necks."""

import json

import pytest

import idic
from idic_studies.cases.polycarbonate import SKETCH, scaled
from idic_studies.examples import EXAMPLES
from idic_studies.examples.polycarbonate import necking_strip
from idic_studies.examples.polycarbonate_model import TRUTH

BASICS = {f"material.{name}.identify": False for name in ("strip.mu", "strip.eta0", "strip.kappa", "strip.r1")}
FAR = {"strip.r0": 1.25, "strip.Sa": 1.25, "strip.tau0": 0.8, "strip.G1": 1.3, "strip.Gr": 0.8}  # over the truth


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(EXAMPLES, "polycarbonate", lambda reduced, foreign: necking_strip(SKETCH))
        out = tmp_path_factory.mktemp("strip") / "strip"
        idic.write_example("polycarbonate", out)
    return out


def identified(folder, run, **options):
    start = scaled([FAR.get(name, 1.0) for name in TRUTH])
    more = {f"options.{name}": value for name, value in options.items()}
    return idic.identify(folder, run, workers=0, overrides=start | BASICS | more)


def largest_error(result):
    return max(abs(entry["value"] / TRUTH[name] - 1.0) for name, entry in result["parameters"].items()
               if entry["free"])


@pytest.mark.slow  # half a minute
def test_a_search_finds_a_start_from_which_steps_converge(folder, tmp_path):
    found = identified(folder, tmp_path / "found")
    tried = json.loads((tmp_path / "found" / "search.json").read_text())["tried"]
    assert found["status"] == "converged" and largest_error(found) < 0.02
    assert tried[0]["label"] == "start" and tried[0]["misfit"] > 2.0
    assert not any(entry["label"] == "start, carried on" for entry in tried)  # r0 = 1.2 tells nothing
    lost = identified(folder, tmp_path / "lost", search="never", max_iterations=20)
    assert largest_error(lost) > 0.1
