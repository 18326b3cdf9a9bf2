"""The text of formats.md, from what the readers declare: `python docs/formats.py` rewrites it."""

from __future__ import annotations

from pathlib import Path

from idic.readers import FORMATS

HEAD = """# Files that idic reads

`idic init` finds these files; `idic check` says what it takes from them. A star: with the libraries of

```sh
python -m pip install 'idic[instruments]'
```

A file that two libraries read differently is refused, with both readings. Frames of films are read one by one. Times of
films and maps count from the first frame: `first_frame_s` shifts them, `frame_interval_s` or `image_times` replace
them. Tables are `.csv`, `.txt`, `.dat`, `.xlsx`\\*. Tested with: files *made* for it or written *of* a program, *real*
ones of instruments.
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
        parts += [f"\n## {title}\n\n| files | suffix | library | taken from it | you state | tested |\n"
                  "|---|---|---|---|---|---|\n",
                  *("| " + " | ".join((entry.name + ("\\*" if entry.is_extra else ""),
                                       _suffixes(entry.suffixes), entry.library,
                                       entry.contents, entry.user_input, entry.tests)) + " |\n" for entry in rows)]
    return "".join(parts)


if __name__ == "__main__":
    Path(__file__).with_suffix(".md").write_text(page(), encoding="utf-8")
