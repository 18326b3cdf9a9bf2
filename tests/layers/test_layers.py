"""The layering rule of the architecture, enforced by reading every import, deferred ones included."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

# Lower layers first. Within a layer a module may import those named before it, except where "|" keeps them apart.
LAYERS = [
    ["idic.errors", "idic.parameters"],
    ["idic.images", "|", "idic.materials", "|", "idic.fe"],
    ["idic.experiment", "idic.leading_frames", "idic.temperature", "idic.mode_names", "idic.boundary_modes", "idic.corrections", "idic.heterogeneity", "idic.loads", "idic.drives",
     "idic.readings", "idic.black_box", "idic.forward"],
    ["idic.correlation"],
    ["idic.dic", "idic.identify", "idic.virtual", "idic.design"],
    ["idic.diagnose"],
    ["idic.report"],
    ["idic.edge", "idic.studies", "idic.trial"],
    ["idic_flows"],
    ["idic.cli", "idic.__main__"],
]
# `fe` sees the interface of the laws, not the laws.
EXCEPTIONS = {("idic.fe", "idic.materials"), ("idic.fe", "idic.materials.law"), ("idic.fe", "idic.materials.points"),
              ("idic.fe", "idic.materials.compilation")}  # fmt: skip

SCIENCE = {"numpy", "scipy", "numba", "llvmlite"}  # llvmlite: the intrinsics of numba
REPORT = SCIENCE | {"matplotlib", "plotly", "jinja2"}
EDGE = SCIENCE | {"zarr", "numcodecs", "dask", "distributed", "pydantic", "pydantic_core", "meshio", "tifffile", "imagecodecs",
                  "cv2", "PIL", "psutil"}  # fmt: skip
THIRD_PARTIES = {"idic.report": REPORT, "idic.edge": EDGE, "idic_flows": {"prefect", "httpx"}, "idic.cli": {"typer", "rich"},
                 "idic.__main__": set()}  # fmt: skip


def modules():
    """(module name, file) of everything in the package and the flows."""
    for folder, package in (("idic", "idic"), ("flows", "idic_flows")):
        for file in sorted((ROOT / folder).rglob("*.py")):
            parts = file.relative_to(ROOT / folder).with_suffix("").parts
            parts = parts[:-1] if parts[-1] == "__init__" else parts
            yield ".".join((package, *parts)), file


def imports(name, file):
    """Every module that a file imports, anywhere in it, as absolute names."""
    package = name if file.name == "__init__.py" else name.rpartition(".")[0]
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parents = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*parents, *([base] if base else [])])
            known = {candidate for candidate, _ in MODULES}
            for alias in node.names:
                yield f"{base}.{alias.name}" if f"{base}.{alias.name}" in known else base


MODULES = list(modules())
every_module = pytest.mark.parametrize("name, file", [pytest.param(*module, id=module[0]) for module in MODULES])


def unit(name):
    """The entry of LAYERS that a module belongs to."""
    entries = {entry for layer in LAYERS for entry in layer}
    while name and name not in entries:
        name = name.rpartition(".")[0]
    return name


def place(entry):
    """(layer, group in it, position): what is compared."""
    for number, layer in enumerate(LAYERS):
        if entry in layer:
            position = layer.index(entry)
            return number, layer[:position].count("|"), position
    raise AssertionError(entry)


def allowed(importer, imported):
    here, there = place(unit(importer)), place(unit(imported))
    if unit(importer) == unit(imported) or there[0] < here[0]:
        return True
    if (unit(importer), imported) in EXCEPTIONS:
        return True
    return there[0] == here[0] and there[1] == here[1] and there[2] < here[2]


@every_module
def test_a_module_imports_only_from_lower_layers(name, file):
    assert unit(name) or name == "idic", f"{name} has no place in the architecture: give it one here and in the README"
    own = [other for other in imports(name, file) if other.split(".")[0] in ("idic", "idic_flows") and other != "idic"]
    wrong = [other for other in own if not allowed(name, other)]
    assert not wrong, f"{name} must not import {', '.join(wrong)}"


@every_module
def test_third_parties_stay_where_they_belong(name, file):
    permitted = THIRD_PARTIES.get(unit(name), SCIENCE)
    foreign = {other.split(".")[0] for other in imports(name, file)} - {"idic", "idic_flows"}
    foreign -= set(sys.stdlib_module_names)
    assert foreign <= permitted, f"{name} must not import {', '.join(sorted(foreign - permitted))}"


def test_the_rule_finds_an_offender():
    assert not allowed("idic.fe.march", "idic.edge.config")
    assert not allowed("idic.fe.march", "idic.images.camera")
    assert not allowed("idic.fe.march", "idic.materials.elastic")
    assert not allowed("idic.edge.tasks", "idic_flows.identify")
    assert allowed("idic.fe.march", "idic.materials.points") and allowed("idic.cli.commands", "idic_flows.identify")


@pytest.mark.parametrize("module", ["idic", "idic.cli"])
def test_importing_the_front_door_loads_nothing_heavy(module):
    code = f"import {module}, sys; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    heavy = {"numpy", "numba", "scipy", "prefect", "dask", "distributed", "zarr", "matplotlib", "pydantic", "uvicorn"}
    assert not heavy & set(loaded)


def test_the_flows_load_no_prefect_until_they_run():
    code = "import idic_flows.identify, sys; assert 'prefect' not in sys.modules and 'uvicorn' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_table_of_the_readme_has_every_entry_in_its_layer():
    rows = [line for line in (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
            if line.startswith("| ") and line[2].isdigit() and line[3:5] == " |"]
    for number, layer in enumerate(LAYERS):
        text = " ".join(row for row in rows if row[2] == str(number))
        for entry in layer:
            name = {"idic_flows": "flows", "idic.__main__": "cli"}.get(entry, entry.rpartition(".")[2])
            assert entry == "|" or f"{name}.py" in text or f"{name}/" in text, f"{entry} is not in layer {number} there"
