"""What figures are made of: their files, and margins that are measured once."""

import io

import numpy as np
import pytest
from matplotlib.layout_engine import ConstrainedLayoutEngine
from PIL import Image

from idic.report.figures.axes.time_axis import label_frames, pauses
from idic.report.figures.layout import MeasuredOnce
from idic.report.figures.style import show_pixels
from idic.report import DIVERGING, DPI, look, new_figure, to_picture


def test_a_file_holds_every_pixel_and_the_resolution():
    with look():
        figure = new_figure(2.0, 1.0)
        figure.subplots().imshow(np.random.default_rng(0).random((7, 5)))
        picture = to_picture(figure, "name", "title", "caption")
    image = Image.open(io.BytesIO(picture.png))
    assert np.array_equal(np.asarray(image), np.asarray(figure.canvas.buffer_rgba())[..., :3])
    assert image.info["dpi"] == pytest.approx((DPI, DPI), rel=1e-3)


def test_the_colours_of_a_bar_do_not_depend_on_how_much_of_the_map_has_them():
    with look():
        figure = new_figure(4.0, 3.0)
        axes = figure.subplots()
        values = -1.0 + 0.1 * np.random.default_rng(0).random((200, 200))
        figure.colorbar(axes.imshow(values, cmap=DIVERGING, vmin=-1.0, vmax=1.0))
        picture = to_picture(figure, "name", "title", "caption", as_photo=True)
    few = np.asarray(Image.open(io.BytesIO(picture.png)).convert("RGB")).astype(int)
    true = np.asarray(figure.canvas.buffer_rgba())[..., :3].astype(int)
    assert np.abs(few - true).max() < 20  # of 255: 15; 32 where the map chooses the colours


@pytest.mark.parametrize("scale", [1e-4, 0.3, 1.0, 7e5])
def test_axes_stand_where_measuring_twice_puts_them(scale):
    x = np.linspace(0.0, 1.0, 50)
    places = []
    for layout in (MeasuredOnce(w_pad=0.06, h_pad=0.06), ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06)):
        with look():
            figure = new_figure(4.0, 3.0)
            figure.set_layout_engine(layout)
            left, right = figure.subplots(1, 2)
            left.plot(x, scale * x, label="line")
            left.set(xlabel="x", ylabel="y")
            figure.colorbar(right.imshow(scale * np.outer(x, x)), ax=right, label="z")
            figure.legend(loc="outside upper left")
            figure.canvas.draw()
        places.append([axes.get_position().bounds for axes in figure.axes])
    assert np.allclose(*places, atol=0.01)  # of the figure: three or four pixels


RAMP = np.linspace(0.0, 60.0, 30)


@pytest.mark.parametrize("times, expected", [
    (np.r_[-675.0, RAMP], [(-675.0, 0.0)]),  # the reference long before the load
    (np.r_[0.0, 675.0 + RAMP, 1500.0 + RAMP], [(0.0, 675.0), (735.0, 1500.0)]),
    (RAMP, []), (2.0 ** np.arange(12.0), []), (np.r_[0.0, 100.0], []),
    (np.r_[RAMP, 62.0, 70.0], [])])
def test_only_a_pause_that_leaves_no_room_for_the_rest_is_a_break(times, expected):
    assert pauses(times) == expected


def test_a_pause_takes_little_room_and_the_rest_is_to_scale():
    times = np.r_[-675.0, RAMP]
    with look():
        figure = new_figure(7.2, 3.0)
        top, axis = figure.subplots(2, 1, sharex=True)
        axis.plot(times, times, "-o")
        label_frames(axis, "time [s]", times)
        figure.canvas.draw()
        at = axis.transData.transform(np.column_stack([times, times]))[:, 0]
    low, high = axis.bbox.x0, axis.bbox.x1
    assert low < at.min() and at.max() < high
    assert np.ptp(at[1:]) > 0.85 * (high - low)  # all but margins and break
    assert np.allclose(np.diff(at[1:]), np.diff(at[1:])[0])
    assert 0.03 < (at[1] - at[0]) / (high - low) < 0.08
    assert all(len([patch for patch in each.patches if patch.get_hatch()]) == 1 for each in (top, axis))
    ticks = [tick for tick in axis.get_xticks()]
    assert -675.0 in ticks and not [tick for tick in ticks if -675.0 < tick < 0.0]


def test_frames_by_number_have_whole_ticks():
    with look():
        figure = new_figure(4.0, 3.0)
        axis = figure.subplots()
        axis.plot(range(4), range(4))
        label_frames(axis, "frame", np.arange(4))
        figure.canvas.draw()
    assert all(float(tick).is_integer() for tick in axis.get_xticks())


def test_a_map_is_drawn_from_every_nth_pixel_at_its_place():
    """A ramp of 3000 columns in a panel of 300 px: each sample lies in the middle of the pixels that it stands for."""
    ramp = np.tile(np.arange(3000.0), (1200, 1))
    figure = new_figure(2.0, 1.0)
    artist = show_pixels(figure.subplots(), ramp, (99.5, 2899.5, -0.5, 1199.5))
    samples, (left, right, bottom, top) = artist.get_array(), artist.get_extent()
    width = (right - left) / samples.shape[1]
    assert samples.shape[1] == 700 and width == 4
    middles = left + width * (np.arange(samples.shape[1]) + 0.5)
    assert np.abs(samples[0] - middles).max() <= 0.5
    assert (left, top) == (99.5, -0.5) and right >= 2899.5 and bottom >= 1199.5


def test_a_small_map_keeps_every_pixel():
    values = np.arange(12.0).reshape(3, 4)
    artist = show_pixels(new_figure(2.0, 1.0).subplots(), values)
    np.testing.assert_array_equal(artist.get_array(), values)
    assert tuple(artist.get_extent()) == (-0.5, 3.5, 2.5, -0.5)
