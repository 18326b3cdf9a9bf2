"""What is remembered of a mesh is its own, and goes with it."""

import gc

import pytest

from idic.fe import PerMesh
from idic.virtual_tests import strip_with_hole


def strip():
    return strip_with_hole(10.0, 6.0, 1.0, "quad8", 2, 2, 2, name="BODY")


def test_a_mesh_is_asked_once_and_its_equal_again():
    known, asked, one, other = PerMesh(), [], strip(), strip()
    for mesh in (one, one, other, one):
        assert known.once(mesh, "size", lambda mesh=mesh: asked.append(mesh) or mesh.n_nodes) == one.n_nodes
    assert len(asked) == 2


def test_a_call_that_raises_is_not_cached():
    known, mesh = PerMesh(), strip()
    with pytest.raises(ValueError, match="no"):
        known.once(mesh, "sound", lambda: int("no"))
    assert known.once(mesh, "sound", lambda: 1) == 1


def test_cached_data_of_a_deleted_mesh_is_released():
    known, mesh = PerMesh(), strip()
    known.once(mesh, "size", lambda: 1)
    del mesh
    gc.collect()
    assert not known._known
