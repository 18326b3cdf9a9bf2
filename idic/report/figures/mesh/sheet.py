"""A plane picture with axes, of an image, polygons and points: all that `idic check` draws.

Pillow draws it in a fifth of the time that Matplotlib takes to be imported; size, letters and colours are those of the
other figures.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from PIL import Image, ImageColor, ImageDraw, ImageFont

from idic.report.figures.picture import DPI, PNG_COMPRESSION, Colour

POINT = DPI / 72  # px of a typographic point
LETTERS, SMALL_LETTERS = 9.0 * POINT, 8.0 * POINT  # px: of an axis, of ticks and legend
PAD, TICK = 9, 6  # px: between texts and what they belong to; length of a tick
LINE_WIDTH = 1
FINER = 3  # times the pixels, of what is drawn smoothly
TICK_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
TICK_DISTANCE = 130  # px: ticks are farther apart
SHADE, MARKED_SHADE = 0.35, 0.5  # of a colour over an image, and of its sign in the legend
SIGN_WIDTH = 2.0  # of a sign in the legend, in heights of its letters


class Sheet:
    """A white sheet with one pair of equal axes.

    Parameters
    ----------
    size_px : columns and rows of the sheet
    low, high : (2,) lower and upper end of the axes
    labels : of the columns and the rows
    is_downwards : the second axis points down, as rows of an image do
    entries : (text, colour, sign) of the legend; sign: "line", "point" or "shade"
    """

    def __init__(self, size_px: tuple[int, int], low: np.ndarray, high: np.ndarray, labels: tuple[str, str],
                 is_downwards: bool, entries: Sequence[tuple[str, str, str]]):
        self._sheet = Image.new("RGB", size_px, "white")
        self._draw = ImageDraw.Draw(self._sheet)
        self._letters, self._small = _font(LETTERS), _font(SMALL_LETTERS)
        legend = self._legend_rows(entries, size_px[0])
        left_px = round(LETTERS + self._width_of_ticks(low[1], high[1], size_px[1]) + 4 * PAD + TICK)
        bottom = round(LETTERS + SMALL_LETTERS * (1 + 1.6 * len(legend)) + 5 * PAD + TICK)
        room = np.array([size_px[0] - left_px - 4 * PAD, size_px[1] - bottom - 2 * PAD])
        self._low, self._high, self._downwards = np.asarray(low, float), np.asarray(high, float), is_downwards
        self._scale = float((room / (self._high - self._low)).min())  # px per unit
        size = np.maximum(np.round(self._scale * (self._high - self._low)), 1).astype(int)
        self._corner = (left_px + int(room[0] - size[0]) // 2, 2 * PAD + int(room[1] - size[1]) // 2)
        self._panel = np.full((size[1], size[0], 3), 255, np.uint8)  # (rows, columns, RGB)
        self._draw_axes(labels)
        self._draw_legend(legend)

    def image(self, grey: np.ndarray) -> None:
        """An image (ny, nx) whose pixels are one unit wide and centred at whole numbers; white where it is NaN."""
        low, high = np.nanpercentile(grey, (0.5, 99.5))
        values, is_inside = self._pixels_of(grey)
        level = np.clip((values - low) / max(high - low, 1e-12), 0.0, 1.0)
        is_seen = is_inside & np.isfinite(level)
        self._panel[is_seen] = np.round(255 * level[is_seen]).astype(np.uint8)[:, None]

    def shade(self, chosen: np.ndarray, colour: str) -> None:
        """A colour over the True pixels of an image (ny, nx)."""
        values, is_inside = self._pixels_of(chosen)
        is_shaded = values.astype(bool) & is_inside
        mixed = (1 - SHADE) * self._panel[is_shaded] + SHADE * np.array(_rgb(colour))
        self._panel[is_shaded] = np.round(mixed).astype(np.uint8)

    def outlines(self, polygons: Sequence[np.ndarray], colour: str) -> None:
        """Closed polygons, each (n, 2)."""
        finer, draw = self._finer()
        for polygon in polygons:
            if np.isfinite(polygon).all():
                place = self._places(np.concatenate([polygon, polygon[:1]]))
                draw.line(place.ravel().tolist(), fill=255, width=FINER * LINE_WIDTH)
        self._mix(finer, colour)

    def points(self, points: np.ndarray, colour: str, diameter: float) -> None:
        """Discs at points (n, 2); diameter : typographic points."""
        finer, draw = self._finer()
        radius = FINER * diameter / 2 * POINT
        for x, y in self._places(points[np.isfinite(points).all(axis=1)]).tolist():
            draw.ellipse([x - radius, y - radius, x + radius, y + radius], fill=255)
        self._mix(finer, colour)

    def _finer(self) -> tuple[Image.Image, ImageDraw.ImageDraw]:
        """A sheet for one colour, `FINER` times the panel."""
        finer = Image.new("L", (FINER * self._panel.shape[1], FINER * self._panel.shape[0]))
        return finer, ImageDraw.Draw(finer)

    def _mix(self, finer: Image.Image, colour: str) -> None:
        """Lay a colour over the panel where `_finer` was drawn on."""
        panel = Image.fromarray(self._panel)
        panel.paste(_rgb(colour), mask=finer.reduce(FINER))
        self._panel = np.array(panel)

    def pixels(self) -> np.ndarray:
        """The sheet with all that was drawn  # -> (rows, columns, RGB)"""
        self._sheet.paste(Image.fromarray(self._panel), self._corner)
        return np.asarray(self._sheet)

    # places ---------------------------------------------------------------------------------------
    def _places(self, points: np.ndarray) -> np.ndarray:
        """Points of the axes in the pixels of `_finer`  # (n, 2)"""
        across = points[:, 0] - self._low[0]
        down = points[:, 1] - self._low[1] if self._downwards else self._high[1] - points[:, 1]
        return FINER * self._scale * np.stack([across, down], axis=1) - 0.5

    def _pixels_of(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The value of the nearest pixel of an image at every pixel of the panel, and whether there is one."""
        rows, columns = (np.floor(low + (np.arange(n) + 0.5) / self._scale + 0.5).astype(int)
                         for low, n in zip(self._low[::-1], self._panel.shape, strict=False))
        is_inside = (((rows >= 0) & (rows < image.shape[0]))[:, None]
                     & ((columns >= 0) & (columns < image.shape[1]))[None, :])
        picked = image[np.clip(rows, 0, image.shape[0] - 1)[:, None], np.clip(columns, 0, image.shape[1] - 1)[None, :]]
        return picked, is_inside

    # axes and legend ------------------------------------------------------------------------------
    def _draw_axes(self, labels: tuple[str, str]) -> None:
        left_px, top = self._corner
        height, width = self._panel.shape[:2]
        right, bottom = left_px + width, top + height
        self._draw.line([(left_px - 1, top), (left_px - 1, bottom), (right, bottom)], fill=Colour.GREY,
                        width=LINE_WIDTH)
        for value, text in _ticks(self._low[0], self._high[0], width):
            at = left_px + self._scale * (value - self._low[0])
            self._draw.line([(at, bottom), (at, bottom + TICK)], fill=Colour.GREY, width=LINE_WIDTH)
            self._draw.text((at, bottom + TICK + PAD / 2), text, Colour.BLACK, self._small, anchor="mt")
        widest = 0.0
        for value, text in _ticks(self._low[1], self._high[1], height):
            down = value - self._low[1] if self._downwards else self._high[1] - value
            at = top + self._scale * down
            self._draw.line([(left_px - TICK, at), (left_px, at)], fill=Colour.GREY, width=LINE_WIDTH)
            self._draw.text((left_px - TICK - PAD / 2, at), text, Colour.BLACK, self._small, anchor="rm")
            widest = max(widest, self._small.getlength(text))
        self._draw.text((left_px + width / 2, bottom + TICK + PAD + SMALL_LETTERS), labels[0], Colour.BLACK,
                        self._letters, anchor="mt")
        upright = Image.new("RGB", (round(self._letters.getlength(labels[1])) + 2, round(1.4 * LETTERS)), "white")
        ImageDraw.Draw(upright).text((0, 0), labels[1], Colour.BLACK, self._letters)
        self._sheet.paste(upright.rotate(90, expand=True), (
            round(left_px - TICK - 2 * PAD - widest - 1.4 * LETTERS), top + height // 2 - upright.width // 2))

    def _width_of_ticks(self, low: float, high: float, length: int) -> float:
        return max((self._small.getlength(text) for _, text in _ticks(low, high, length)), default=0.0)

    def _legend_rows(self, entries: Sequence[tuple[str, str, str]], width: int) -> list[list[tuple[str, str, str]]]:
        """The entries of the legend in rows that fit."""
        rows: list[list[tuple[str, str, str]]] = [[]]
        for entry in entries:
            if rows[-1] and self._length([*rows[-1], entry]) > width - 2 * PAD:
                rows.append([])
            rows[-1].append(entry)
        return rows

    def _length(self, row: Sequence[tuple[str, str, str]]) -> float:
        return sum(self._small.getlength(text) + (SIGN_WIDTH + 2) * SMALL_LETTERS for text, _, _ in row)

    def _draw_legend(self, rows: Sequence[Sequence[tuple[str, str, str]]]) -> None:
        for number, row in enumerate(reversed(rows)):
            x = (self._sheet.width - self._length(row)) / 2 + SMALL_LETTERS
            y = self._sheet.height - PAD - SMALL_LETTERS * (0.5 + 1.6 * number)
            for text, colour, sign in row:
                middle, half = x + SIGN_WIDTH * SMALL_LETTERS / 2, SIGN_WIDTH * SMALL_LETTERS / 2
                if sign == "line":
                    self._draw.line([(x, y), (x + 2 * half, y)], fill=colour, width=2 * LINE_WIDTH)
                elif sign == "point":
                    self._draw.ellipse([middle - 3, y - 3, middle + 3, y + 3], fill=colour)
                else:
                    mixed = tuple(round(255 * (1 - MARKED_SHADE) + MARKED_SHADE * part) for part in _rgb(colour))
                    self._draw.rectangle([middle - 8, y - 8, middle + 8, y + 8], fill=mixed)
                self._draw.text((x + 2 * half + SMALL_LETTERS / 2, y), text, Colour.BLACK, self._small, anchor="lm")
                x += self._small.getlength(text) + (SIGN_WIDTH + 2) * SMALL_LETTERS


def png(pixels: np.ndarray) -> bytes:
    """The file of a sheet."""
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "png", dpi=(DPI, DPI), compress_level=PNG_COMPRESSION)
    return file.getvalue()


def _ticks(low: float, high: float, length_px: int) -> list[tuple[float, str]]:
    """Round values from low to high, farther apart than `TICK_DISTANCE`, and their texts."""
    coarsest = (high - low) * TICK_DISTANCE / max(length_px, 1)
    power = 10.0 ** np.floor(np.log10(coarsest))
    step = next(power * factor for factor in TICK_STEPS if power * factor >= coarsest * (1 - 1e-9))
    values = step * np.arange(np.ceil(low / step), np.floor(high / step) + 1)
    decimals = max(0, -int(np.floor(np.log10(step) + 1e-9)) + (step / 10 ** np.floor(np.log10(step) + 1e-9) == 2.5))
    return [(float(value), f"{value + 0.0:.{decimals}f}".replace("-", "\N{MINUS SIGN}")) for value in values]


def _font(size_px: float) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """The letters of all figures, out of Matplotlib's folder."""
    fonts = Path(find_spec("matplotlib").origin).parent / "mpl-data" / "fonts" / "ttf"
    return ImageFont.truetype(str(fonts / "DejaVuSans.ttf"), size_px)


def _rgb(colour: str) -> tuple[int, ...]:
    return ImageColor.getrgb(colour)
