#!/usr/bin/env bash
# The documentation site with the gallery's reports: build_site.sh [FOLDER], default ./site; open FOLDER/html/index.html.
# IDIC_GALLERY names an existing gallery; without it the reports are made, which takes some minutes.
set -euo pipefail
here="$(cd "$(dirname "$0")/.." && pwd)"
mkdir -p "${1:-site}"
out="$(cd "${1:-site}" && pwd)"

[ -x "$out/venv/bin/python" ] || python3 -m venv "$out/venv"
"$out/venv/bin/pip" install --quiet "$here[docs]" "$here/studies"   # the gallery is one of the studies
gallery="${IDIC_GALLERY:-$out/gallery}"
[ -f "$gallery/index.html" ] || "$out/venv/bin/idic" gallery --out "$gallery"
"$out/venv/bin/python" "$here/docs/site_pages.py" "$out" --gallery "$gallery"
echo "ok: $out/html/index.html"
