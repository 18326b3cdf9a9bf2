"""The text of formats.md, from what the readers declare: `python docs/formats.py` rewrites it."""

from __future__ import annotations

from pathlib import Path

from idic.readers import FORMATS

HEAD = """# Files that idic reads

`idic init` finds these files in a folder, `idic check` names what it takes from them. Formats with a star need
libraries of their own:

```sh
python -m pip install 'idic[instruments]'
```

A file that its library reads wrongly, or that two libraries read differently, is refused with the reason. Frames of
films are read one by one. Tables are `.csv`, `.txt`, `.dat`, `.xlsx`\\*. Times of films and maps count from the first
frame; `first_frame_s` shifts them, and `frame_interval_s` or `image_times` take their place.
"""
KINDS = {"images": "Images", "heights": "Height maps, `images` with `quantity = \"height\"`",
         "loads": "Logs, `loads` and `image_times`", "fields": "Measured fields: points and displacements",
         "mesh": "Meshes", "calibration": "Calibrations"}
TABLES = (".csv", ".txt", ".dat", ".xlsx")


def _suffixes(suffixes: tuple[str, ...]) -> str:
    return "tables" if suffixes == TABLES else " ".join(f"`{suffix}`" for suffix in suffixes)


def page() -> str:
    """The whole page."""
    parts = [HEAD]
    for kind, title in KINDS.items():
        rows = [entry for entry in FORMATS if entry.kind == kind]
        parts += [f"\n## {title}\n\n| files | suffix | read by | taken from the file | you state | tested with |\n"
                  "|---|---|---|---|---|---|\n",
                  *("| " + " | ".join((entry.name + ("\\*" if entry.is_extra else ""),
                                       _suffixes(entry.suffixes), entry.library or "idic",
                                       entry.contents, entry.user_input, entry.tests)) + " |\n" for entry in rows)]
    return "".join(parts)


if __name__ == "__main__":
    Path(__file__).with_suffix(".md").write_text(page(), encoding="utf-8")
