"""Studies: many identifications of virtual tests with known truth, their stored records, and a page drawn from them.

Add a study in one file and one line:

1. ``studies/cases/my_study.py`` with ``my_study(size) -> Study``: its renderings (virtual tests), its cases
   (one identification each, key ``GROUP/NAME``), and ``draw(records) -> StudyPage``, in the same file or in
   ``studies/pages/my_page.py``. Copy `idic_studies.cases.two_step`.
2. Its line in ``STUDIES`` of `idic_studies.cases.registry`.

Nothing else changes: the command ``idic study my-study``, workers, ``--resume`` and the record of every case follow.
Check it by ``python -m pytest tests/studies`` and ``idic study my-study --reduced --out DIR``.
"""
