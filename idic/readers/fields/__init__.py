"""Measured fields as other DIC systems export them: positions and displacements of points, stage by stage.

`FieldSeries.open` opens a folder of stages or one table. `aramis`, `column_tables` and `vtu` read one stage each;
`plane` projects measured surfaces with three coordinates onto their mean plane.
"""
