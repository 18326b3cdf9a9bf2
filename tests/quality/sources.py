"""The source files of the packages."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = {"idic": "idic", "flows": "idic_flows", "studies": "idic_studies"}  # by their folders


def modules() -> dict[str, Path]:
    """Files by module name; a folder without `__init__.py` holds scripts, tests or what an installation left there."""
    return {name: file for folder, package in PACKAGES.items()
            for name, file in sorted(_modules(ROOT / folder, package), key=lambda pair: pair[1])}


def _modules(folder: Path, package: str):
    for file in folder.glob("*.py"):
        yield package if file.stem == "__init__" else f"{package}.{file.stem}", file
    for init in folder.glob("*/__init__.py"):
        yield from _modules(init.parent, f"{package}.{init.parent.name}")
