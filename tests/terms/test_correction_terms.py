"""What every correction of a motion has to keep: zero at its null, exact derivatives, a table that the file takes, a
candidate.

A term is read from its shortest table: ``required.example``, whose column is that of the log here.
"""

from __future__ import annotations

import numpy as np
import pytest
from experiment_file.small_experiment import LOADS, TOML, change, load, load_experiment, write_experiment

from idic.diagnose import candidate_library
from idic.errors import InputError
from idic.model import CORRECTION_TERMS, DriveTable, corrections_of, term_of_motion, without_knot

TERMS = list(CORRECTION_TERMS.values())
MOTION = 'uy = { column = "grip_um", noise_std = 0.2 }'
DIFFERENCE = 1e-3


def small(folder):
    """The small experiment, whose force is called as in the examples of the terms."""
    write_experiment(folder, TOML.replace("force_kN", "force_N"))
    change(folder, "loads.csv", LOADS.partition("\n")[0], "frame,time_s,force_N,grip_um")
    return folder


def table(term, **keys):
    """The shortest table of a term, with further keys."""
    text = term.required.example if term.required else f'{{ kind = "{term.kind}" }}'
    return text[:-2] + "".join(f", {key} = {value}" for key, value in keys.items()) + " }"


def corrected(folder, text):
    return load(small(folder), MOTION, f'uy = {{ column = "grip_um", corrections = [{text}] }}')


def of_motion(experiment):
    """The corrections of the upper end."""
    return next(corrections_of(entry.drive) for entry in experiment.model.prescribed
                if (entry.nodes, entry.component) == ("TOP", "y"))


def tables(term):
    """The table of a term, and those with an identified course."""
    courses = ({"course": '"free"', "knots": 2}, {"course": '"jumps"', "jump_frames": "[2]"}) if term.is_timed else ()
    return [table(term, **keys) for keys in ({}, *courses)]


@pytest.mark.parametrize("term", TERMS, ids=lambda term: term.kind)
def test_a_correction_is_zero_at_its_null_and_in_the_reference_and_its_derivatives_are_exact(term, tmp_path):
    for number, text in enumerate(tables(term)):
        experiment = corrected(tmp_path / str(number), text)
        (first, *_) = corrections = of_motion(experiment)
        names = [f"boundary.TOP.y.{correction.name}" for correction in corrections]
        assert set(names) <= set(experiment.model.parameters.free)
        drives, parameters = DriveTable.of(experiment), experiment.model.parameters
        moved = drives.basis @ drives.histories(parameters).T  # (n_p, n_frames)
        without = drives.basis @ drives.columns.T
        np.testing.assert_array_equal(moved, without)
        for name in names:
            assert parameters[name].scale > 0.0 and parameters[name].unit == first.unit
            ahead, behind = (drives.histories(parameters.with_values({name: sign * DIFFERENCE})) for sign in (1, -1))
            np.testing.assert_allclose((ahead - behind) / (2 * DIFFERENCE), drives.derivatives[name], atol=1e-12)
            assert drives.derivatives[name].any() and not drives.derivatives[name][experiment.model.reference].any()


@pytest.mark.parametrize("term", TERMS, ids=lambda term: term.kind)
def test_the_reach_of_a_pattern_is_its_largest_value(term, tmp_path):
    experiment = corrected(tmp_path / "test", table(term))
    nodes = np.asarray(experiment.model.mesh.node_sets["TOP"])
    component, pattern = term.pattern(of_motion(experiment)[0], experiment.model.mesh, nodes, "y")
    assert component in "xy" and np.abs(pattern).max() == pytest.approx(term.reach(experiment.model.mesh, nodes, "y"))


@pytest.mark.parametrize("term", TERMS, ids=lambda term: term.kind)
def test_a_correction_has_its_own_keys_and_its_own_name(term, tmp_path):
    for other in TERMS:
        for key in other.keys if other is not term else ():
            value = f'"{key.words[0]}"' if key.words else 2
            with pytest.raises(InputError, match=f"{key.name} does not belong here"):
                corrected(tmp_path / other.kind / key.name, table(term, **{key.name: value}))
    for text in tables(term):
        names = [f"boundary.TOP.y.{one.name}" for one in of_motion(corrected(tmp_path / str(len(text)), text))]
        assert all(term_of_motion(name) is term for name in names) and len({without_knot(name) for name in names}) == 1


@pytest.mark.parametrize("name", ["temperature", "temperature#3", "BODY.E", "channel.force_N.drift", "camera.shift",
                                  "geometry.thickness"])
def test_what_is_no_motion_of_a_boundary_has_no_such_term(name):
    assert term_of_motion(name) is None


@pytest.mark.parametrize("term", [term for term in TERMS if term.cause], ids=lambda term: term.kind)
def test_a_correction_is_a_candidate_whose_probes_the_file_takes(term, tmp_path):
    library = {candidate.name: candidate for candidate in candidate_library()}
    candidate = library[term.cause.name]
    assert candidate.side == "boundary" and candidate.title == term.cause.title and candidate.separating_tests
    assert set(term.cause.rivals) <= set(library) and candidate.null and candidate.paraphrase
    folder, probes = small(tmp_path / "test"), 0
    experiment = load_experiment(folder)
    text = (folder / "experiment.toml").read_text()
    for motion in experiment.model.prescribed:
        if (motion.nodes, motion.component) != ("TOP", "y"):
            continue
        for probe in term.probes(experiment, motion):
            keys = "".join(f", {key} = {value!r}" for key, value in probe.keys.items())
            edited = text.replace(MOTION, f'{MOTION[:-1]}, corrections = [{{ kind = "{term.kind}"{keys} }}] }}')
            (folder / "experiment.toml").write_text(edited)
            assert f"boundary.TOP.y.{term.kind}" in load_experiment(folder).model.parameters.free
            assert probe.value > 0.0 and probe.label.startswith("TOP ")
            probes += 1
            if term.scale:
                assert probe.label == term.scale.label("TOP", probe.keys[term.scale.key], probe.label.split()[-1])
    assert probes
