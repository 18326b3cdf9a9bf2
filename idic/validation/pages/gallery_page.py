"""The page of the gallery: of each experiment a picture, a sentence, the key numbers, and the way to its report."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence

from jinja2 import Environment, PackageLoader, StrictUndefined

SHOWN = 10  # values of one experiment; its report has all


def render_gallery(entries: Sequence[Mapping], pictures: Mapping[str, bytes]) -> str:
    """The HTML text; the pictures are in it, the reports are linked.

    Parameters
    ----------
    entries : as `idic.validation.studies.gallery` writes them
    pictures : PNG or JPEG by the name of the entry
    """
    environment = Environment(loader=PackageLoader("idic.report", "."), autoescape=True, undefined=StrictUndefined,
                              trim_blocks=True, lstrip_blocks=True)
    return environment.get_template("gallery.html.j2").render(
        entries=entries, shown=SHOWN, pictures={name: _data_uri(picture) for name, picture in pictures.items()},
        seconds=sum(entry["cpu_s"] for entry in entries))


def _data_uri(picture: bytes) -> str:
    kind = "png" if picture.startswith(b"\x89PNG") else "jpeg"
    return f"data:image/{kind};base64," + base64.b64encode(picture).decode("ascii")
