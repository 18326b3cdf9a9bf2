"""Pages for people: links and anchors lead somewhere, paths in the text exist, every page is on the map."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md")),
         *sorted((ROOT / "deploy").glob("*.md"))]
EXAMPLES = ("my_", "thickness_error")  # names of files that a recipe lets the reader write
ELSEWHERE = ("deploy/secrets", "tests/dic_composite")  # made by the user; of another project


def without_code(text):
    return re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)


def anchors(page):
    """The anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", without_code(page.read_text(encoding="utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_links_and_anchors_lead_somewhere():
    wrong = []
    for page in PAGES:
        for target in re.findall(r"\]\(([^)\s]+)\)", without_code(page.read_text(encoding="utf-8"))):
            if target.startswith("http"):
                continue
            file, _, anchor = target.partition("#")
            aim = page.parent / file if file else page
            if not aim.exists():
                wrong.append(f"{page.relative_to(ROOT)}: {target} does not exist")
            elif anchor and anchor not in anchors(aim):
                wrong.append(f"{page.relative_to(ROOT)}: {target}: no such heading")
    assert not wrong, "\n".join(wrong)


def test_paths_of_the_project_exist():
    missing = []
    for page in PAGES:
        words = re.findall(r"(?<![\w/.~-])((?:idic|flows|tests|docs|deploy)/[\w./-]*\w)",
                           page.read_text(encoding="utf-8"))
        named = [word for word in words if not any(name in word for name in (*EXAMPLES, *ELSEWHERE))]
        missing += [f"{page.relative_to(ROOT)}: {word}" for word in named
                    if not (ROOT / word).exists() and not (ROOT / word.split("::")[0]).exists()]
    assert not missing, "\n".join(missing)


def test_every_page_of_the_docs_is_on_the_map():
    text = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    for page in (ROOT / "docs").rglob("*.md"):
        name = page.relative_to(ROOT / "docs").as_posix()
        assert name == "README.md" or f"]({name})" in text or f"`{name}`" in text, name


BOUNDS = {  # words of pages with a bound of their own; formats.md is generated
    "compare.md": 500, "formats.md": 1000, "how-to/use-volumes.md": 200, "volume-files.md": 200, "volumes.md": 900,
    "evidence/safety.md": 120,
}


def test_the_pages_stay_within_their_words():
    """As wc counts them; the tutorial and the page of what was measured have bounds of their own, too."""
    docs = ROOT / "docs"
    pages = [*docs.rglob("*.md"), ROOT / "CHANGELOG.md"]
    words = {page: len(page.read_text(encoding="utf-8").split()) for page in pages}
    for name, bound in BOUNDS.items():
        assert words.pop(docs / name) <= bound, name
    assert sum(words.values()) <= 45_000
    assert words[docs / "tutorial.md"] <= 1500 and words[docs / "evidence" / "measurements.md"] <= 3000


def test_every_page_of_the_evidence_names_the_page_that_it_supports_or_is_named_by_one():
    for page in (ROOT / "docs" / "evidence").glob("*.md"):
        own = ROOT / "docs" / page.name
        assert not own.exists() or f"](evidence/{page.name}" in own.read_text(encoding="utf-8"), page.name


def test_the_first_page_stays_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 220


def test_the_recipes_end_in_a_command():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    recipes = re.findall(r"^## Add (.*?)\n(.*?)(?=^## )", text, re.DOTALL | re.MULTILINE)
    assert [name for name, _ in recipes] == ["a law", "a candidate physics", "a physics of the measuring chain",
                                             "a correction of a grip", "a lens model", "a reader", "a figure",
                                             "a study"]
    assert all("```sh\n" in recipe for _, recipe in recipes)
