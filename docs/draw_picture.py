"""Makes draw.png: the page of `idic draw` on images and log of the demo.

    python docs/draw_picture.py
"""

from __future__ import annotations

import io
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests" / "draw"))

from driver import Browser  # noqa: E402

from idic.virtual_tests import write_example  # noqa: E402

COLOURS = 256  # of the pictures: half of the bytes


def main() -> None:
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "open-hole"
        write_example("demo", folder)
        for name in ("mesh.inp", "experiment.toml", "truth.json"):
            (folder / name).unlink()
        program = subprocess.Popen([sys.executable, "-m", "idic", "draw", str(folder), "--no-browser"],
                                   stdout=subprocess.PIPE, text=True)
        try:
            with Browser(program.stdout.readline().split()[1], 1200, 800) as page:
                page.wait('document.body?.dataset.ready === "yes"')
                page.wait('document.getElementById("mesh-text").textContent.includes("elements")')
                page.click("#scale")
                page.click_image(8, 179)
                page.click_image(288, 179)
                page.type("28")
                page.click("#thickness")
                page.type("2")
                page.value('document.getElementById("show-floor").click()')
                page.value('document.getElementById("panel").scrollTo(0, 0)')
                save(page, "draw.png")
        finally:
            program.terminate()


def save(page: Browser, name: str) -> None:
    file = io.BytesIO()
    place = HERE / name
    page.screenshot(place)
    with Image.open(place) as picture:
        picture.convert("RGB").quantize(COLOURS, kmeans=2).save(file, "PNG", optimize=True)
    place.write_bytes(file.getvalue())


if __name__ == "__main__":
    main()
