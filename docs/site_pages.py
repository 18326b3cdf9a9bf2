"""The documentation as a site with search: the pages of docs/, one per command, law and candidate, executed examples,
the Python reference, the gallery.

    pip install ".[docs]"
    python docs/site_pages.py site --gallery gallery     # site/html/index.html; gallery: written by idic gallery

Every page that Sphinx cannot resolve a link of fails the build. `--links` checks the links that leave the site, too.
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
EXAMPLES = DOCS / "examples"  # scripts; the build runs them
REPOSITORY_PAGES = {"README.md": "readme", "CONTRIBUTING.md": "contributing", "CHANGELOG.md": "changelog",
                    "deploy/README.md": "deploy", "deploy/slurm.md": "deploy-slurm",
                    "deploy/compose.md": "deploy-compose", "deploy/kubernetes.md": "deploy-kubernetes",
                    "deploy/prefect.md": "deploy-prefect"}
LAW_PAGES = {"elastoplastic": "composed-law", "free_rubber": "free-rubber", "free_relaxation": "free-relaxation"}
WRAPPED = ".highlight-text pre { white-space: pre-wrap; }"
PYTHON = {  # title -> modules of the reference
    "From Python objects": ("idic.notebook.experiment", "idic.notebook.identification", "idic.notebook.result",
                            "idic.notebook.estimates"),
    "From folders": ("idic.experiment_file.load", "idic.run.identify", "idic.run.reporting.write",
                     "idic.run.reporting.export", "idic.run.design"),
    "Experiment and simulation": ("idic.model.records.experiment", "idic.model.records.recording",
                                  "idic.model.records.model", "idic.model.records.parts",
                                  "idic.model.records.options", "idic.model.records.gauges", "idic.model.forward",
                                  "idic.parameters", "idic.images.camera"),
    "Fields": ("idic.measure.fields.strain", "idic.measure.fields.series", "idic.measure.fields.readings",
               "idic.measure.fields.free"),
    "Free FE-DIC": ("idic.measure.dic.stack", "idic.measure.dic.frame"),
    "The equation": ("idic.correlation.image_equations.frame",),
    "To extend idic": ("idic.laws.core.law", "idic.diagnose.physics.candidate"),
}


def write_source(folder: Path, gallery: Path | None = None, pictures: bool = True) -> None:
    """The pages as Sphinx reads them; gallery : a folder that ``idic gallery`` wrote; pictures : of the laws and
    examples, which are executed for them."""
    if folder.exists():
        shutil.rmtree(folder)
    shutil.copytree(DOCS, folder, ignore=shutil.ignore_patterns("*.py", "README.md", "__pycache__", "examples"))
    shutil.copy(DOCS / "conf.py", folder)
    (folder / "extra").mkdir()
    _write(folder / "static" / "site.css", WRAPPED)
    for page in folder.rglob("*.md"):
        place = DOCS / page.parent.relative_to(folder)
        text = _with_links(page.read_text(encoding="utf-8"), place, page.parent.relative_to(folder))
        page.write_text(text, encoding="utf-8")
    for name, target in REPOSITORY_PAGES.items():
        text = (ROOT / name).read_text(encoding="utf-8")
        text = text.replace("# idic\n", "# What idic does\n", 1) if target == "readme" else text
        (folder / f"{target}.md").write_text(_with_links(text, (ROOT / name).parent), encoding="utf-8")
    commands = list(_command_pages(folder / "commands"))
    laws, candidate_library = list(_law_pages(folder / "laws", pictures)), list(_candidate_pages(folder / "candidates"))
    examples = list(_example_pages(folder / "examples", pictures))
    _write_gallery(folder, gallery)
    for title, modules in PYTHON.items():
        _write(folder / "python" / f"{_slug(title)}.md", f"# {title}\n\n" + "\n\n".join(map(_reference, modules)))
    _write(folder / "index.md", _index(commands, laws, candidate_library, examples))


def _with_links(text: str, place: Path, at: Path = Path()) -> str:
    """Links from a page of the repository to pages of the site; those to sources become their names.

    place : the page's folder in the repository; at : its folder in the site
    """
    def target(match: re.Match) -> str:
        label, link = match.group(1), match.group(2)
        file, _, anchor = link.partition("#")
        if not file or link.startswith(("http", "mailto:")):
            return match.group(0)
        path = os.path.relpath(place / file, ROOT)
        if path in REPOSITORY_PAGES:
            return f"[{label}]({os.path.relpath(REPOSITORY_PAGES[path], at)}.md{'#' + anchor if anchor else ''})"
        if path in ("docs/README.md", "docs/examples/README.md"):  # the index lists the pages of the examples
            return f"[{label}]({os.path.relpath('index.md', at)})"
        if path.startswith("docs/") and Path(path).suffix in (".md", ".png"):
            return f"[{label}]({os.path.relpath(path.removeprefix('docs/'), at)}{'#' + anchor if anchor else ''})"
        return label if "`" in label else f"`{label}`"

    return re.sub(r"\[([^\]]*)\]\(([^)\s]+)\)", target, text)


def _law_pages(folder: Path, pictures: bool) -> Iterator[str]:
    """One page per registered law; yields their names."""
    from idic.laws import all_laws, get_law
    from idic.report import plot_law

    folder.mkdir(parents=True)
    for name in all_laws():
        law = get_law(name)
        if pictures:
            plot_law(name, folder / f"{name}.png")
        rows = [(f"`{p.name}`", p.unit, _number(p.default), _number(p.null), p.description) for p in law.parameters]
        other = ["- " + ", ".join(f"`{one}`" for one in names) for names in law.alternatives]
        parts = [f"# {name}", law.reference, f"Kinematics: {', '.join(law.kinematics)}. " + (
                     "Isotropic." if law.isotropic else "Anisotropic."),
                 _table(("parameter", "unit", "typical", "no effect at", "meaning"), rows)]
        if name in LAW_PAGES:
            parts.append(f"How to use it: [{LAW_PAGES[name]}](../{LAW_PAGES[name]}.md).")
        if name == "elastoplastic":
            parts.append(_terms())
        if other:
            parts.append("Other parameters that are accepted in the place of the elastic ones:\n\n" + "\n".join(other))
        if states := [state for state in law.state_names if not re.search(r"\d\d(-1)?$", state)]:
            parts.append("State: " + ", ".join(f"`{state}`" for state in states) + ".")
        parts += [_toml(name, law.parameters), f"![Uniaxial stress and its sensitivities]({name}.png)",
                  "Above: uniaxial stress, loading and reversed. Below: its change for a relative change of one "
                  "parameter."]
        if doc := _text(inspect.getmodule(next(iter(law.updates.values())))):
            parts.append(f"## In the source\n\n{doc}")
        _write(folder / f"{name}.md", "\n\n".join(parts))
        yield name


def _terms() -> str:
    """The terms of the composed law, from their registration."""
    from idic.laws import TEMPERATURE_TERMS, TERMS

    rows = [(term.group.replace("_", " "), f"`{term.kind}`", ", ".join(
                f"`{p.name}`" + (f" ({p.unit})" if p.unit not in ("", "-") else "") for p in term.parameters),
             term.equation) for term in (*TERMS.values(), *TEMPERATURE_TERMS.values())]
    return "## Terms\n\n" + _table(("group", "kind", "parameters", "equation"), rows)


def _example_pages(folder: Path, execute: bool) -> Iterator[str]:
    """One page per script of docs/examples: its text, what it prints, the pictures it saves; yields their names.

    Raises
    ------
    subprocess.CalledProcessError
        A script ends with an error.
    """
    for script in sorted(EXAMPLES.glob("*.py")):
        text = script.read_text(encoding="utf-8")
        title, _, rest = inspect.cleandoc(re.match(r'"""(.*?)"""', text, re.DOTALL).group(1)).partition("\n")
        parts = [f"# {title.rstrip('.')}", rest.strip(), "```python\n" + text.partition('"""\n\n')[2].strip() + "\n```"]
        if execute:
            place = folder / script.stem
            place.mkdir(parents=True)
            with_idic = os.environ | {"PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])}
            done = subprocess.run([sys.executable, str(script)], cwd=place, check=True, stdout=subprocess.PIPE,
                                  text=True, encoding="utf-8", env=with_idic)
            parts.append(f"```text\n{done.stdout.rstrip()}\n```")
            parts += [f"![{picture.stem}]({script.stem}/{picture.name})" for picture in sorted(place.glob("*.png"))]
        _write(folder / f"{script.stem}.md", "\n\n".join(parts))
        yield script.stem


def _command_pages(folder: Path) -> Iterator[str]:
    """One page per command of ``idic``: what it does, its arguments and options; yields their names."""
    import click
    from typer.main import get_command

    from idic.cli.app import app

    program = get_command(app)
    context = click.Context(program, info_name="idic")
    for name in program.list_commands(context):
        command = program.commands[name]
        own = click.Context(command, info_name=f"idic {name}")
        rows = []
        for parameter in command.params:
            if getattr(parameter, "hidden", False) or not (record := parameter.get_help_record(own)):
                continue
            rows.append((f"`{re.sub(r' <(?:list.*|path)>$', '', record[0].strip())}`", _options_as_code(record[1])))
        usage = " ".join(command.collect_usage_pieces(own))
        _write(folder / f"{name}.md", "\n\n".join([f"# idic {name}", inspect.cleandoc(command.help or ""),
                                                    f"```text\nidic {name} {usage}\n```",
                                                    _table(("argument or option", "what"), rows)]))
        yield name


def _options_as_code(text: str) -> str:
    """A help text in one line; its options as code, whose two hyphens stay two."""
    return re.sub(r"(?<![\w-])(--[a-z-]+)", r"`\1`", " ".join(text.split()))


def _toml(name: str, parameters: Sequence) -> str:
    lines = [f"{p.name} = {{ value = {p.default:g}, unit = \"{p.unit}\", identify = true }}" if p.unit not in ("", "-")
             else f"{p.name} = {{ value = {p.default:g}, identify = true }}"
             for p in parameters if p.default is not None]
    return "```toml\n[material.SPECIMEN]\nlaw = \"" + name + "\"\n" + "\n".join(lines) + "\n```"


def _candidate_pages(folder: Path) -> Iterator[str]:
    """One page per registered candidate physics; yields their names."""
    from idic.diagnose import candidate_library

    known = {candidate.name: candidate for candidate in candidate_library()}
    for name, one in known.items():
        rivals = [(f"[{rival}]({rival}.md)" if rival in known else f"`{rival}`", why)
                  for rival, why in one.rivals.items()]
        parts = [f"# {one.title}", (f"{one.paraphrase[0].upper()}{one.paraphrase[1:]}." if one.paraphrase else ""),
                 _table(("name", "family", "side", "absent at"),
                        [(f"`{name}`", one.family.replace("_", " "), one.side, one.null)])]
        if rivals:
            parts.append("## Rivals\n\n" + _table(("physics", "what tells them apart"), rivals))
        if one.separating_tests:
            parts.append("## Tests that separate it\n\n" + "\n".join(f"- {test}" for test in one.separating_tests))
        if doc := _text(sys.modules[one.variants.__module__]):
            parts.append(f"## In the source\n\n{doc}")
        _write(folder / f"{name}.md", "\n\n".join(part for part in parts if part))
        yield name


def _reference(name: str) -> str:
    """A module: its docstring, then every public function and class with signature, shapes and units."""
    module = importlib.import_module(name)
    parts = [f"## {name}", _text(module)]
    for key, one in vars(module).items():
        own = not key.startswith("_") and getattr(one, "__module__", None) == name
        if not own or not (inspect.isfunction(one) or inspect.isclass(one)):
            continue
        parts.append(f"### {key}\n\n```python\n{key}{_signature(one)}\n```\n\n{_text(one)}")
        for label, method in vars(one).items() if inspect.isclass(one) else ():
            if label.startswith("_"):
                continue
            held = method.fget if isinstance(method, property) else getattr(method, "__func__", method)
            if inspect.isfunction(held) and inspect.getdoc(held):
                call = "" if isinstance(method, property) else _signature(held)
                parts.append(f"#### {key}.{label}\n\n```python\n{key}.{label}{call}\n```\n\n{_text(held)}")
    return "\n\n".join(part for part in parts if part)


def _signature(one: object) -> str:
    """Parameters by name and default; shapes and units stand in the docstring."""
    try:
        signature = inspect.signature(one)
    except (TypeError, ValueError):
        return "(…)"
    plain = [p.replace(annotation=p.empty) for p in signature.parameters.values() if p.name != "self"]
    return re.sub(r"<[^>]*>", "…", str(inspect.Signature(plain)))


def _text(one: object) -> str:
    """The docstring as it stands: its equations are plain text."""
    doc = inspect.getdoc(one)
    return f"````text\n{doc}\n````" if doc else ""


def _write_gallery(folder: Path, gallery: Path | None) -> None:
    """The finished reports, or how to make them."""
    text = ("# Gallery\n\nSmall virtual tests with known truth and their finished reports, as `idic gallery` makes "
            "them: a plate with a hole, a composite, a bulge test, a polymer that necks, two speeds together, and a "
            "model that lacks a physics.")
    if gallery is None:
        text += ("\n\nThis site was built without them:\n\n```sh\nidic gallery --out gallery\n"
                 "python docs/site_pages.py site --gallery gallery\n```")
    else:
        pages = sorted(page.relative_to(gallery) for page in gallery.rglob("*.html"))
        for page in pages:
            (folder / "extra" / "gallery" / page.parent).mkdir(parents=True, exist_ok=True)
            shutil.copy(gallery / page, folder / "extra" / "gallery" / page)
        rows = [(page.parts[0] + (f", {page.parts[-2]} alone" if "experiments" in page.parts else ""),
                 f'<a href="gallery/{page.as_posix()}">{page.stem}</a>') for page in pages if len(page.parts) > 1]
        if (gallery / "index.html").is_file():
            text += '\n\n<a href="gallery/index.html">All on one page, with pictures and numbers</a>'
        text += "\n\n" + _table(("test", "page"), rows)
    _write(folder / "gallery-of-reports.md", text)


def _index(commands: Sequence[str], laws: Sequence[str], candidates: Sequence[str], examples: Sequence[str]) -> str:
    """The first page: the map of docs/README.md as tables of contents."""
    parts = ["# idic", "From images and forces to material parameters with error bars: time-resolved integrated "
             "digital image correlation. The search finds every key of `experiment.toml`, every quantity of a report "
             "and every message."]
    for block in (DOCS / "README.md").read_text(encoding="utf-8").split("\n\n"):
        heading = re.match(r"\| (to [^|]*) \|", block)
        names = [name for row in re.findall(r"^\| (\[[^|]*) \|", block, re.MULTILINE)
                 for name in re.findall(r"\]\(([\w/-]+)\.md\)", row)]
        if heading and names:
            first = ["readme"] if "begin" in heading.group(1) else []
            parts.append(_toctree(heading.group(1).strip().capitalize(), [*first, *names]))
    parts += [_toctree("Commands", [f"commands/{name}" for name in commands]),
              _toctree("Examples", [f"examples/{name}" for name in examples]),
              _toctree("Laws", [f"laws/{name}" for name in laws]),
              _toctree("Candidate physics", [f"candidates/{name}" for name in candidates]),
              _toctree("Python", [f"python/{_slug(title)}" for title in PYTHON]),
              _toctree("More", ["gallery-of-reports",
                                *(name for page, name in REPOSITORY_PAGES.items() if page != "README.md")])]
    return "\n\n".join(parts)


def _toctree(caption: str, pages: Sequence[str]) -> str:
    return f"```{{toctree}}\n:maxdepth: 1\n:caption: {caption}\n\n" + "\n".join(pages) + "\n```"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines)


def _number(value: float | None) -> str:
    return "–" if value is None else "∞" if value == float("inf") else f"{value:.6g}"


def _slug(title: str) -> str:
    return title.lower().replace(" ", "-")


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text.rstrip() + "\n", encoding="utf-8")


def build(out: Path, gallery: Path | None = None, links: bool = False) -> int:
    """Write the source and build ``out/html``; returns Sphinx's exit status."""
    from sphinx.cmd.build import main as sphinx

    write_source(out / "source", gallery)
    status = sphinx(["-W", "--keep-going", "-q", "-b", "html", str(out / "source"), str(out / "html")])
    if links and not status:
        status = sphinx(["-q", "-b", "linkcheck", str(out / "source"), str(out / "links")])
    return status


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--gallery", type=Path, help="folder that idic gallery wrote")
    parser.add_argument("--links", action="store_true", help="also check links to other sites")
    chosen = parser.parse_args()
    raise SystemExit(build(chosen.out, chosen.gallery, chosen.links))
