"""The way from `identify` to the equation stays short, and a frame computes nothing twice."""

from __future__ import annotations

import pytest

from idic_studies.equality.frame_way import ONCE, followed, strip

# bounds that only go down
MAX_FUNCTIONS, MAX_FILES_OF_THE_WAY = 14, 7  # from `identify` to the image kernel
MAX_FILES_OF_A_FRAME = 13  # of idic/correlation, of which it runs a function


@pytest.fixture(scope="module")
def frame_way():
    return followed(strip())


def test_the_way_to_the_equation_is_short(frame_way):
    files = {file for file, _ in frame_way.way}
    assert [name for _, name in frame_way.way][::len(frame_way.way) - 1] == ["identify", "image_pass"]
    assert "nodal_equations" in {name for _, name in frame_way.way}
    assert len(frame_way.way) <= MAX_FUNCTIONS and len(files) <= MAX_FILES_OF_THE_WAY


def test_a_frame_passes_through_few_files(frame_way):
    files = sorted(file for file in frame_way.files if file.startswith("idic/correlation/"))
    assert 0 < len(files) <= MAX_FILES_OF_A_FRAME, files


@pytest.mark.parametrize("function", ONCE.values(), ids=ONCE)
def test_a_frame_computes_it_once(frame_way, function):
    rare = {"Model.nodal_gradient"}  # where the mesh moves with the parameters, or the camera is free
    assert frame_way.times(function) == (0 if function in rare else 1)
