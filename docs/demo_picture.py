"""The picture of the README from the figures of a demo: python docs/demo_picture.py idic-demo/run"""

import sys
from pathlib import Path

from PIL import Image

WIDTH, COLOURS = 1160, 255
FIGURES = {"local_chi2": 1160, "channel_force_N": 860}  # and their widths, px


def main(run: Path) -> None:
    """Put the figures one below the other, on white, in few colours: the file stays below 300 kB."""
    pictures = []
    for name, width in FIGURES.items():
        picture = Image.open(run / "figures" / f"{name}.png").convert("RGB")
        pictures.append(picture.resize((width, picture.height * width // picture.width), Image.Resampling.LANCZOS))
    sheet = Image.new("RGB", (WIDTH, sum(p.height for p in pictures)), "white")
    top = 0
    for picture in pictures:
        sheet.paste(picture, ((WIDTH - picture.width) // 2, top))
        top += picture.height
    few = sheet.quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE, kmeans=3, dither=Image.Dither.NONE)
    few.save(Path(__file__).parent / "demo.png", optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
