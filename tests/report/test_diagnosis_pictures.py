"""Figures of where, when and on which side: a place on the page as large as what it shows."""

import io
import struct
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread

from idic.diagnose import in_words
from idic.report.diagnosis.where import active_map, side_chart, source_map
from idic.report import Colour
from idic.report.diagnosis.where import WhereRecord


def record(columns, rows, side="bulk"):
    """Square elements of 40 px, the last two of them the source."""
    corners = 40.0 * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    outlines = [[corners + 40.0 * np.array([k % columns, k // columns])] for k in range(columns * rows)]
    n = len(outlines)
    last, none = np.arange(n) >= n - 2, np.zeros(n, dtype=bool)
    shares = {"camera": 0.9, "boundary": 0.1, "camera+boundary": 0.9, "bulk": 1.0}
    return WhereRecord(
        reference=np.full((40 * rows, 40 * columns), 100.0), outlines=outlines, statistic=np.where(last, 900.0, 1.0),
        p=np.where(last, 1e-6, 1.0), source_elements=np.flatnonzero(last), since=np.where(last, 3.0, np.nan),
        blind=none,
        times=np.arange(5.0), time_label="frame", amplitude=np.arange(5.0), std=np.ones(5), load=None, load_label="",
        onset=3.0, interval=(2.0, 4.0), shares=shares, excess=shares, side=side, words={},
        since_active=np.where(last, 3, -1))


def size(picture):
    """Width and height of a PNG, px."""
    return struct.unpack(">II", picture.png[16:24])


@pytest.mark.parametrize("draw", [source_map, active_map])
def test_a_map_is_as_wide_as_its_body_asks_for(draw):
    tall, broad = size(draw(record(4, 24))), size(draw(record(24, 4)))
    assert tall[0] < tall[1] and broad[0] > 2 * broad[1]


def red(picture):
    """Number of pixels in the colour of an outline."""
    colour = np.array([int(Colour.RED[k:k + 2], 16) for k in (1, 3, 5)])
    image = np.round(255.0 * imread(io.BytesIO(picture.png))[..., :3])
    return int((np.abs(image - colour).max(axis=-1) < 8).sum())


def test_only_the_side_that_is_held_responsible_is_outlined():
    """The camera's bar and that of camera and edges together are of one length."""
    found = [red(side_chart(replace(record(4, 4), side=side))) for side in ("camera", "camera+boundary", "bulk")]
    assert found[0] == pytest.approx(found[1], rel=0.1) and found[0] < found[2]


def test_a_place_far_from_the_origin_is_said_in_whole_units():
    assert in_words((417.24, 1268.74), (0.12, 0.55)) == "(417 ± 0.1, 1269 ± 0.6)"
    assert in_words((0.04891, -12.0)) == "(0.0489, -12)"


def test_a_crack_is_drawn_from_its_beginning_to_its_tip():
    """On a white page, three elements long: black pixels where it is, and none without it."""
    sheet = record(6, 4)
    sheet = replace(sheet, reference=None)
    images = [imread(io.BytesIO(source_map(replace(sheet, cracks=cracks)).png))[..., :3]
              for cracks in ((), (np.array([[0.0, 60.0], [120.0, 60.0]]),))]
    black = [int((image.max(axis=-1) < 0.02).sum()) for image in images]
    assert black[1] > black[0] + 100
