"""Sphinx configuration of the site; docs/site_pages.py writes its pages and calls Sphinx."""

project = "idic"
author = "the authors of idic"
root_doc = "index"
extensions = ["myst_parser"]
smartquotes = False  # two hyphens of an option stay two
myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]
suppress_warnings = ["myst.header", "misc.highlighting_failure"]
exclude_patterns: list[str] = []
html_theme = "furo"
html_title = "idic"
html_show_copyright = False
html_show_sphinx = False
html_extra_path = ["extra"]
html_static_path = ["static"]
html_css_files = ["site.css"]
html_theme_options = {"navigation_with_keys": True}
