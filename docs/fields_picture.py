"""Makes fields.png: the field viewer in the report of a RUN of the demo.

    idic demo
    python docs/fields_picture.py idic-demo/run
"""

from __future__ import annotations

import io
import sys
from pathlib import Path

from PIL import Image

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests" / "draw"))

from driver import Browser  # noqa: E402

COLOURS = 256  # of the picture: half of the bytes
SET = """(() => { const part = (name) => document.querySelector(`#field-viewer [data-is="${name}"]`);
  const choose = (name, pick) => { const box = part(name);
    const option = [...box.options].find((o) => pick.test(o.textContent));
    box.value = option.value; box.dispatchEvent(new Event("change", { bubbles: true })); };
  choose("quantity", /^strain xx$/); choose("shape", /× 10$/);
  const frame = part("frame"); frame.value = frame.max; frame.dispatchEvent(new Event("input", { bubbles: true }));
  document.getElementById("fields").scrollIntoView({ behavior: "instant", block: "start" }); })()"""


def main(run: Path) -> None:
    with Browser((run / "report.html").resolve().as_uri(), 1100, 560) as page:
        page.wait('document.querySelectorAll("#field-viewer canvas").length > 0')
        page.value(SET)
        page.screenshot(HERE / "fields.png")
    file = io.BytesIO()
    with Image.open(HERE / "fields.png") as picture:
        picture.convert("RGB").quantize(COLOURS, kmeans=2).save(file, "PNG", optimize=True)
    (HERE / "fields.png").write_bytes(file.getvalue())


if __name__ == "__main__":
    main(Path(sys.argv[1]))
