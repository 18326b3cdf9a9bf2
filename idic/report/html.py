"""Pages from templates: every value is escaped, a missing value is an error."""

from __future__ import annotations

from functools import cache

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined


def filled_in(template: str, package: str = "idic.report", /, **values: object) -> str:
    """The HTML text of a template, of the reports or of another package, with `values`."""
    return _environment(package).get_template(template).render(**values)


@cache
def _environment(package: str) -> Environment:
    loader = ChoiceLoader([PackageLoader("idic.report", "templates"),
                           *([PackageLoader(package, ".")] if package != "idic.report" else [])])
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
