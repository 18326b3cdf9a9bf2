"""The architecture, enforced by reading the code: imports only downwards, no circles, rooms that a reader takes in."""

import ast
import re
import subprocess
import sys
import tomllib
from collections import Counter
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
from quality.sources import modules

import idic

ROOT = Path(__file__).parents[2]

# Lower layers first. A room imports from lower layers and from itself; rooms of one layer do not see each other.
LAYERS = [
    ["idic.errors", "idic.expressions", "idic.input_decks", "idic.inside", "idic.parameters", "idic.path_names",
     "idic.plain_values", "idic.remote_files", "idic.studies", "idic.windows"],
    ["idic.images", "idic.laws"],
    ["idic.fe"],
    ["idic.model", "idic.readers"],
    ["idic.simulation_error"],
    ["idic.calibrate", "idic.correlation"],
    ["idic.experiment_file", "idic.measure"],
    ["idic.identification"],
    ["idic.diagnose"],
    ["idic.report"],
    ["idic.run"],
    ["idic.virtual_tests"],
    ["idic.draw", "idic.notebook"],
    ["idic_flows"],
    ["idic.cli", "idic.__main__"],
    ["idic_studies"],
]
WITHIN_A_LAYER = {("idic.parameters", "idic.errors"), ("idic.path_names", "idic.errors"),
                  ("idic.inside", "idic.errors"), ("idic.studies", "idic.errors"), ("idic.__main__", "idic.cli")}
DISTRIBUTIONS = {"idic": ".", "idic_flows": ".", "idic_studies": "studies"}  # package: folder of its pyproject.toml
STUDIES_DOOR = "idic.studies"  # the one module of the product that knows of the studies
BEFORE_THE_LAST = {"idic.fe": {"idic.images"}}  # rooms of lower layers that a room does not see
LAWS = "idic.laws.core"  # what the finite elements see of the laws: their interface

SCIENCE = {"numpy", "scipy", "numba", "llvmlite", "lazy_loader"}  # intrinsics of numba; doors
THIRD_PARTIES = {
    "idic.fe": {"pyamg"},
    "idic.readers": {"gmsh", "h5py", "meshio", "tifffile", "imagecodecs", "cv2", "PIL", "msgpack", "nrrd", "zarr",
                     "surfalize", "SurfaceTopography", "pyMRAW", "cinereader", "nptdms", "zs2decode", "openpyxl"},
    "idic.experiment_file": {"pydantic", "pydantic_core", "tomli_w"},
    "idic.report": {"matplotlib", "PIL", "plotly", "jinja2"},
    "idic.measure": {"cv2"},  # features of a frame that has turned; nothing that is measured comes from it
    "idic.run": {"dask", "distributed", "fsspec", "meshio", "numcodecs", "psutil", "pydantic", "threadpoolctl",
                 "zarr"},
    "idic.virtual_tests": {"tifffile", "PIL", "meshio", "cv2"},
    "idic.draw": {"cv2", "pydantic", "starlette", "uvicorn"},
    "idic.notebook": {"arviz", "matplotlib", "pandas", "threadpoolctl", "xarray"},
    "idic_flows": {"fastapi", "httpx", "prefect"},
    "idic.cli": {"typer", "rich"},
    "idic_studies": {"matplotlib", "prefect", "threadpoolctl", "tifffile", "zarr"},
}
MAX_MODULES, MAX_LINE_SHARE = 16, 0.12  # of a folder, its own files only
CATALOGUES = {"idic.diagnose.candidates"}  # like things side by side


MODULES = modules()
ROOMS = {name: file for name, file in MODULES.items()  # those that are folders of the product
         if file.name == "__init__.py" and name.count(".") == 1 and name.startswith("idic.") and name != "idic.cli"}


@cache
def import_statements(file):
    """The statements of a file that import, deferred ones included; a dozen tests ask for those of every file."""
    blocks, imported = [ast.parse(file.read_text(encoding="utf-8"))], []
    while blocks:  # statements alone: expressions, nine tenths of the syntax, import nothing
        block = blocks.pop()
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            blocks += getattr(block, part, ())
        imported += [block] if isinstance(block, ast.Import | ast.ImportFrom) else []
    return tuple(sorted(imported, key=lambda statement: statement.lineno))


@cache
def doors():
    """{room: {public name: module of the room that defines it}}, read from the stubs of the rooms."""
    return {name: dict(_door(name, file.with_suffix(".pyi"))) for name, file in ROOMS.items()}


def _door(name, stub):
    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                inner = f"{name}.{node.module}.{alias.name}"
                yield alias.name, inner if inner in MODULES else f"{name}.{node.module}"


@cache
def imports(name, file):
    """Every module that a file imports, deferred imports included, as absolute names."""
    return tuple(_imports(name, file))


def _imports(name, file):
    package = name if file.name == "__init__.py" else name.rpartition(".")[0]
    for node in import_statements(file):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        else:
            base = node.module or ""
            if node.level:
                parents = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*parents, *([base] if base else [])])
            for alias in node.names:
                behind = doors().get(base, {}).get(alias.name) if name != base else None
                yield behind or (f"{base}.{alias.name}" if f"{base}.{alias.name}" in MODULES else base)


def own_imports(name, file):
    """The modules of this project that a file imports."""
    return {other for other in imports(name, file) if other.split(".")[0] in DISTRIBUTIONS and other != "idic"}


def room(name):
    """The entry of LAYERS that a module belongs to."""
    entries = {entry for layer in LAYERS for entry in layer}
    while name and name not in entries:
        name = name.rpartition(".")[0]
    return name


def allowed(importer, imported):
    here, there = room(importer), room(imported)
    if here == there or (here, there) in WITHIN_A_LAYER:
        return True
    if there in BEFORE_THE_LAST.get(here, ()):
        return False
    if (here, there) == ("idic.fe", "idic.laws"):
        return imported.startswith(LAWS)
    floors = {entry: number for number, layer in enumerate(LAYERS) for entry in layer}
    return floors[there] < floors[here]


def circles(graph):
    """One circle of a graph {node: nodes}, or nothing."""
    try:
        tuple(TopologicalSorter(graph).static_order())
    except CycleError as found:
        return found.args[1]
    return ()


def test_every_module_has_a_place_in_the_architecture():
    placeless = [name for name in MODULES if not room(name) and name != "idic"]
    assert not placeless, f"give them one here and in the README: {placeless}"


def test_a_module_imports_only_from_lower_layers():
    wrong = [f"{name} must not import {other}" for name, file in MODULES.items() for other in own_imports(name, file)
             if not allowed(name, other)]
    assert not wrong, "\n".join(wrong)


def test_third_parties_stay_where_they_belong():
    wrong = []
    for name, file in MODULES.items():
        permitted = SCIENCE | THIRD_PARTIES.get(room(name), set()) | set(DISTRIBUTIONS) | sys.stdlib_module_names
        foreign = {other.split(".")[0] for other in imports(name, file)} - permitted
        wrong += [f"{name} must not import {other}" for other in sorted(foreign)]
    assert not wrong, "\n".join(wrong)


# Bounds that only go down: as the rooms are simplified, lower them to what is measured.
MAX_NAMES = {"idic.calibrate": 4, "idic.correlation": 65, "idic.diagnose": 69, "idic.draw": 7,
             "idic.experiment_file": 38, "idic.fe": 98, "idic.identification": 97, "idic.images": 90, "idic.laws": 88,
             "idic.measure": 34, "idic.model": 66, "idic.notebook": 3, "idic.readers": 72, "idic.report": 79,
             "idic.run": 71, "idic.simulation_error": 14, "idic.virtual_tests": 40}
MAX_TESTS_PAST_A_DOOR = 198  # files


@cache
def statements(file):
    """The absolute imports by name of a file; sixteen doors ask for those of every file."""
    return [node for node in import_statements(file)
            if isinstance(node, ast.ImportFrom) and not node.level and node.module]


def past_a_door(here, file):
    """The imports of a file that enter a room, other than its own, beside the door."""
    return [f"{node.module}: {', '.join(alias.name for alias in node.names)}" for node in statements(file)
            for there in [".".join(node.module.split(".")[:2])] if there in ROOMS and there != here
            and (node.module != there or any(alias.name not in doors()[there] for alias in node.names))]


def test_a_room_is_entered_by_its_door():
    wrong = [f"{name}: {entry}" for name, file in MODULES.items()
             if not name.startswith(("idic_studies.bench", "idic_studies.evidence"))
             for entry in past_a_door(room(name), file)]
    assert not wrong, "the public names of a room are in its __init__.pyi: " + "\n".join(wrong)


def test_fewer_tests_enter_beside_a_door():
    files = [file for folder in ("tests", "studies/bench") for file in (ROOT / folder).rglob("*.py")
             if past_a_door("", file)]
    assert len(files) <= MAX_TESTS_PAST_A_DOOR


@pytest.mark.parametrize("name", sorted(ROOMS))
def test_a_door_names_what_others_use_and_nothing_else(name):
    stub = ast.parse(ROOMS[name].with_suffix(".pyi").read_text(encoding="utf-8"))
    listed = next(ast.literal_eval(node.value) for node in stub.body if isinstance(node, ast.Assign))
    assert sorted(listed) == sorted(doors()[name])
    assert len(listed) <= MAX_NAMES[name]
    hidden = {entry for entry in doors()[name] if f"{name}.{entry}" in MODULES}
    assert not hidden, "importing a module of this name would hide what the door names"
    assert not set(listed) - used_from_outside(name)


def test_a_module_that_a_door_names_can_be_the_first_thing_imported():
    named = [(name, alias.name) for name, file in ROOMS.items()
             for node in ast.parse(file.with_suffix(".pyi").read_text(encoding="utf-8")).body
             if isinstance(node, ast.ImportFrom) for alias in node.names
             if f"{name}.{node.module}.{alias.name}" in MODULES]
    assert ("idic.laws", "point") in named
    for room_name, module in named:
        subprocess.run([sys.executable, "-c", f"from {room_name} import {module}"], check=True)


def used_from_outside(name):
    """The names of a room that others import, and those that `idic` itself hands on."""
    files = [file for folder in ("idic", "flows", "studies", "tests", "docs") for file in (ROOT / folder).rglob("*.py")
             if ROOMS[name].parent not in file.parents]
    return {alias.name for file in files for node in statements(file) if node.module == name
            for alias in node.names} | {public for public, room in idic._ROOMS.items() if f"idic.{room}" == name}


def test_the_rules_find_an_entry_beside_a_door(tmp_path):
    file = tmp_path / "module.py"
    file.write_text("from idic.fe import march, no_such_name\nfrom idic.fe.time_march import march\n"
                    "from idic.laws import get_law\n")
    assert past_a_door("idic.model", file) == ["idic.fe: march, no_such_name", "idic.fe.time_march: march"]
    assert past_a_door("idic.fe", file) == []


def test_nothing_is_imported_upwards_by_its_name():
    """`import_module` and the like, where the name is written in the code."""
    wrong = []
    for name, file in MODULES.items():
        text = file.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "import_module" in text or "__import__" in text else ():
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("import_module", "__import__")):
                target = next((inner.value for inner in ast.walk(node) if isinstance(inner, ast.Constant)), "")
                if str(target).startswith("idic") and name != "idic" and not allowed(name, target):
                    wrong.append(f"{name} must not import {target}")
    assert not wrong


def test_folders_do_not_import_each_other():
    """A folder and the one around it are two folders; doors do not count, and `idic.__main__` is on its own."""
    edges = set()
    for name, file in MODULES.items():
        if file.name != "__init__.py":
            for other in own_imports(name, file):
                there = other if MODULES.get(other, file).name == "__init__.py" else other.rpartition(".")[0]
                edges.add((name if name == "idic.__main__" else name.rpartition(".")[0], there))
    mutual = {pair for pair in edges if pair[0] < pair[1] and pair[::-1] in edges}
    assert not mutual, "move the module that both need"


def test_no_two_files_import_each_other_even_on_a_detour():
    # a package's own __init__ gathers what is below it; that is no detour
    graph = {name: {other for other in own_imports(name, file) if not name.startswith(f"{other}.")} - {name}
             for name, file in MODULES.items()}
    assert not circles(graph)


def test_a_folder_is_small_enough_to_be_taken_in():
    files, lines = Counter(), Counter()
    for file in MODULES.values():
        if file.name != "__init__.py":
            folder = ".".join(file.parent.relative_to(ROOT).parts)
            files[folder] += 1
            lines[folder] += len(file.read_text(encoding="utf-8").splitlines())
    crowded = {folder: number for folder, number in files.items() if number > MAX_MODULES and folder not in CATALOGUES}
    assert not crowded, f"more than {MAX_MODULES} modules: {crowded}"
    heavy = {folder: round(n / lines.total(), 3) for folder, n in lines.items() if n > MAX_LINE_SHARE * lines.total()}
    assert not heavy, f"more than {MAX_LINE_SHARE:.0%} of all lines: {heavy}"


def test_the_product_opens_the_studies_at_one_door():
    """Read as text: an import by name and the modules that workers load first are strings."""
    assert [name for name, file in MODULES.items() if not name.startswith("idic_studies")
            and "idic_studies" in file.read_text(encoding="utf-8")] == [STUDIES_DOOR]


def test_the_rules_find_an_offender():
    assert not allowed("idic.fe.time_march", "idic.experiment_file.load")
    assert not allowed("idic.fe.time_march", "idic.images.camera")
    assert not allowed("idic.fe.time_march", "idic.laws.elastic")
    assert not allowed("idic.run.prepared.tasks", "idic_flows.orchestrator")
    assert not allowed("idic.report.page", "idic.run.workers.runner")
    assert not allowed("idic.cli.studies_commands", "idic_studies.cases.gallery")
    assert not allowed("idic_flows.public", "idic_studies.flows.study")
    assert allowed("idic.fe.time_march", "idic.laws.core.points") and allowed("idic.cli.app", "idic_flows.orchestrator")
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}}) and not circles({"a": {"b"}, "b": {"c"}})


def project(folder):
    """The content of a pyproject.toml."""
    return tomllib.loads((ROOT / folder / "pyproject.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("folder", sorted(set(DISTRIBUTIONS.values())))
def test_a_wheel_holds_every_package_of_its_distribution(folder):
    listed = project(folder)["tool"]["setuptools"]["packages"]
    assert sorted(listed) == sorted(name for name, file in MODULES.items() if file.name == "__init__.py"
                                    and DISTRIBUTIONS[name.split(".")[0]] == folder)


def test_the_distribution_of_the_studies_names_its_third_parties():
    stated = {re.match(r"[\w-]+", text).group() for text in project("studies")["project"]["dependencies"]}
    needed = {other.split(".")[0] for name, file in MODULES.items() if name.startswith("idic_studies")
              for other in imports(name, file)} - sys.stdlib_module_names - set(DISTRIBUTIONS)
    assert needed | {"idic"} == stated


@pytest.mark.parametrize("module", ["idic", "idic.cli"])
def test_importing_the_front_door_loads_nothing_heavy(module):
    code = f"import {module}, sys; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    heavy = {"numpy", "numba", "scipy", "prefect", "dask", "distributed", "zarr", "matplotlib", "pydantic", "uvicorn"}
    assert not heavy & set(loaded)


def test_the_flows_load_no_prefect_until_they_run_and_no_statistics():
    """The latter take a third of the time in which a command or a worker starts."""
    code = "import idic_flows.orchestrator, sys; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "idic.identification.driver" in loaded
    assert not {"prefect", "uvicorn", "scipy.stats", "scipy.signal"} & set(loaded)


def test_the_table_of_the_readme_has_every_room():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for entry in (entry for layer in LAYERS for entry in layer if entry != "idic.__main__"):
        name = {"idic_flows": "flows", "idic_studies": "studies"}.get(entry, entry.replace(".", "/"))
        assert f"`{name}/`" in text or f"`{name}.py`" in text, f"{entry} is not in the README's table"


def test_no_two_test_files_have_the_same_name():
    """pytest imports a test file by its name alone: of two with one name, the second is not run."""
    names = Counter(file.name for folder in ("tests", "studies/bench") for file in (ROOT / folder).rglob("*.py"))
    assert not [name for name, times in names.items() if times > 1 and name != "conftest.py"]
