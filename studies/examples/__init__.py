"""The examples of the paper: bulge test, necking polycarbonate strip and its planned tests (`idic example`); a bar in a
scanner by CalculiX; the open-hole strips and the slightly wrong models of the studies.

The tables are those of `idic.virtual_tests.examples`.
"""

from idic_studies.examples import bulge, polycarbonate, polycarbonate_plans, scanned_bar

EXAMPLES = {"polycarbonate": polycarbonate.polycarbonate}
WRITERS = {"bulge": bulge.write_bulge, "polycarbonate-plans": polycarbonate_plans.write_polycarbonate_plans,
           "volume-calculix": scanned_bar.write_scanned_bar}
