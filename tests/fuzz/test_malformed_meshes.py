"""Mesh files whole, faulty, cut and scrambled: read as the mesh that was meant, or refused with one message."""

from __future__ import annotations

import numpy as np
import pytest
from base_experiments import base_folder
from commands import campaign, check, copy_of
from hypothesis import strategies as st
from spoil_mesh import FORMATS, NX, NY, Fault, content, faults, suffix, table, whole
from spoil_toml import splices

from idic.cli.outcomes import BAD_INPUT, DONE
from idic.experiment_file import load_experiment

AS_GIVEN = {"options.element_order": "as_given"}


def with_mesh(folder, kind, data):
    file = f"part{suffix(kind)}"
    (folder / file).write_bytes(data)
    toml = folder / "experiment.toml"
    toml.write_text(toml.read_text().replace('mesh = "mesh.inp"', f'mesh = "{file}"'))


def assert_the_mesh(folder) -> None:
    """Nodes and elements as they were meant, in whatever order."""
    mesh = load_experiment(folder, AS_GIVEN).model.mesh
    assert (mesh.n_nodes, mesh.n_elements) == ((NX + 1) * (NY + 1), NX * NY)
    wanted = sorted(tuple(xyz[:2]) for xyz in table().nodes.values())
    np.testing.assert_allclose(sorted(map(tuple, mesh.nodes)), wanted, atol=1e-6)
    for name, level in (("BOTTOM", 0.0), ("TOP", float(NY))):
        np.testing.assert_allclose(mesh.nodes[mesh.node_sets[name], 1], level, atol=1e-6)


@pytest.mark.parametrize("kind", FORMATS)
def test_whole_meshes_are_read(kind):
    with copy_of(base_folder("warm")) as folder:
        toml = folder / "experiment.toml"
        toml.write_text(toml.read_text().replace('"RIGHT"', '"EDGE"') + '[sets]\nEDGE = { where = "x > 3.9" }\n')
        with_mesh(folder, kind, whole(kind))
        answer = check(folder)
        assert answer.code == DONE, answer.said
        assert_the_mesh(folder)


def a_faulty_mesh(kind, found):
    mesh = table()
    for fault in found:
        fault.apply(mesh)
    data = content(mesh, kind)
    if data is None:
        return
    with copy_of(base_folder("cameras")) as folder:
        with_mesh(folder, kind, data)
        answer = check(folder)
        if len(found) == 1 and found[0].sure:
            assert answer.code == BAD_INPUT, answer.shown
        elif not any(fault.sure for fault in found):
            assert answer.code == DONE, answer.said
            assert_the_mesh(folder)


def test_coordinates_beyond_all_measure_are_refused_with_one_message():
    a_faulty_mesh(".inp", [Fault("coordinate", 0, 1e300), Fault("coordinate", 1, 1e300)])


def a_cut_mesh(kind, part):
    data = whole(kind)
    with copy_of(base_folder("cameras")) as folder:
        with_mesh(folder, kind, data[: int(part * len(data))])
        answer = check(folder)
        if answer.code == DONE and kind != ".inp":  # an input file has no end mark: sets at its end may be shorter
            assert_the_mesh(folder)


def a_scrambled_mesh(kind, spoilt):
    data = whole(kind)
    for splice in spoilt:
        data = splice(data)
    with copy_of(base_folder("cameras")) as folder:
        with_mesh(folder, kind, data)
        check(folder)


kinds = st.sampled_from(sorted(FORMATS))
test_a_faulty_mesh, test_many_faulty_meshes = campaign(
    25, a_faulty_mesh, kind=kinds, found=st.lists(faults, min_size=1, max_size=2)
)
test_a_cut_mesh, test_many_cut_meshes = campaign(
    12, a_cut_mesh, share=0.5, kind=kinds, part=st.floats(0, 1, exclude_max=True)
)
test_a_scrambled_mesh, test_many_scrambled_meshes = campaign(
    20, a_scrambled_mesh, kind=kinds, spoilt=st.lists(splices, min_size=1, max_size=3)
)
