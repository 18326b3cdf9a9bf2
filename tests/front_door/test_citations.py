"""What docstrings and pages cite must be there: pages of docs/, sections and equations of docs/method.md, modules."""

import ast
import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
METHOD = (ROOT / "docs" / "method.md").read_text()
SECTIONS = set(re.findall(r"^## (\d+)\. ", METHOD, re.MULTILINE))
EQUATIONS = re.findall(r" \((\d+\.\d+)\)$", METHOD, re.MULTILINE)
PAGE = re.compile(r"docs/[\w./-]*\w\.(?:md|py|png)")
# "docs/method.md, section 7", "docs/method.md, equations 3.1 to 3.3": the numbers that follow the page
NUMBERS = re.compile(r"docs/method\.md,? \(?(?:sections?|equations?)((?:(?:,| and| to)? \(?\d+(?:\.\d+)?\)?)+)")
CITES = re.compile(r"docs/|\.md|image-kernel|file-format|\bEq")  # files in which one of these may be
FOREIGN = re.compile(r"contract\.md|image-kernel|fe\.md|file-format|(?<!docs/)\bmethod\.md|Eq\.? ?\(\d")


@cache
def docstrings():
    """(path, name, text) of every docstring."""
    return list(_docstrings())


def _docstrings():
    for path in sorted((ROOT / "idic").rglob("*.py")) + sorted((ROOT / "flows").rglob("*.py")):
        code = path.read_text()
        for node in ast.walk(ast.parse(code)) if CITES.search(code) else ():
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
                text = ast.get_docstring(node)
                if text:
                    yield path.relative_to(ROOT), getattr(node, "name", ""), re.sub(r"\s+", " ", text)


def test_equations_are_numbered_in_the_order_of_their_sections():
    numbers = [tuple(map(int, number.split("."))) for number in EQUATIONS]
    assert numbers == sorted(set(numbers))
    for section in SECTIONS:
        own = [equation for part, equation in numbers if part == int(section)]
        assert own == list(range(1, len(own) + 1)), section


def test_every_cited_page_is_in_the_project():
    missing = [f"{path} {name}: {page}" for path, name, text in docstrings() for page in PAGE.findall(text)
               if not (ROOT / page).exists()]
    assert not missing


def test_every_cited_section_and_equation_is_in_the_method_page():
    missing = []
    for path, name, text in docstrings():
        for cited in NUMBERS.findall(text):
            for number in re.findall(r"\d+(?:\.\d+)?", cited):
                if number not in (EQUATIONS if "." in number else SECTIONS):
                    missing.append(f"{path} {name}: {number}")
    assert not missing


def test_no_docstring_cites_a_document_outside_the_project():
    foreign = [f"{path} {name}: {found}" for path, name, text in docstrings() for found in FOREIGN.findall(text)]
    assert not foreign


def test_every_module_that_the_method_page_names_is_there():
    missing = [module for module in re.findall(r"`(idic/[\w/]+\.py)`", METHOD) if not (ROOT / module).exists()]
    assert not missing
