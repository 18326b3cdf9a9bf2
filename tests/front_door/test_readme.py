"""The README's promises that can be checked without a network: its commands are those that the CI runs."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def shell_lines():
    """The lines of all shell blocks."""
    return [line.strip() for block in re.findall(r"```(?:sh|bash)\n(.*?)```", README, re.S)
            for line in block.splitlines()]


def test_the_first_two_commands_install_and_run_the_demo_and_the_tests():
    demo, tests = [line for line in shell_lines() if "pip install" in line][:2]
    assert demo.startswith("python3 -m venv") and demo.endswith("idic demo")
    assert tests.startswith("python3 -m venv") and "-m pytest" in tests


def test_the_ci_runs_the_readme_command():
    tests = next(line for line in shell_lines() if line.startswith("python3 -m venv") and "-m pytest" in line)
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert "README.md" in script and "-m pytest" in script
    install, pytest_command = (part.strip() for part in tests.split("&&")[1:])
    assert 'pip install -e ".[test]"' in install
    assert pytest_command.split() == [".venv/bin/python", "-m", "pytest", "-n", "2", "--dist", "loadfile"]  # two cores
    (pattern,) = re.findall(r"grep -E '([^']+)' README.md", script)
    assert re.search(pattern, tests)


def test_every_command_of_the_program_is_in_the_readme():
    from idic.cli.app import app

    for command in app.registered_commands:
        assert f"`idic {command.callback.__name__}" in README


def test_every_package_of_the_wheel_exists_and_every_package_is_in_the_wheel():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    listed = set(project["tool"]["setuptools"]["packages"])
    found = {".".join(file.parent.relative_to(ROOT).parts) for file in (ROOT / "idic").rglob("__init__.py")}
    assert listed == found | {"idic_flows"}


def test_one_version_everywhere():
    import idic

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["version"] == idic.__version__
    assert f"version: {idic.__version__}" in (ROOT / "CITATION.cff").read_text()
    assert f"## {idic.__version__}" in (ROOT / "CHANGELOG.md").read_text()


@pytest.mark.parametrize("target", sorted(set(re.findall(r"\]\(([^)#]+)\)", README))))
def test_links_to_files_lead_somewhere(target):
    assert target.startswith("http") or (ROOT / target).exists()
