"""What figures are made of: their files, and margins that are measured once."""

import io

import numpy as np
import pytest
from matplotlib.layout_engine import ConstrainedLayoutEngine
from PIL import Image

from idic.report.figures.layout import MeasuredOnce
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
