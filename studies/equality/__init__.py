"""Equality of two versions of idic: the same cases give the same bits, words and number of computations.

    python -m idic_studies.equality record --out DIR [--case NAME ... | --fast] [--arrays]
    python -m idic_studies.equality compare BASE HEAD [--all]

`record` runs the cases (`cases`) by the commands of idic and writes DIR/CASE.json; `compare` lists what differs and
ends with 0 only where all is equal. A record holds, for every command, exit code, output and counts (`counting`);
result.json and its like; sum, shape and type of every decoded array; the visible text of pages and tables; the names
of all files. It holds no durations, memory, dates or folders (`normal_text`, `contents`). With ``--arrays`` a
comparison says by how much arrays differ.

`python -m idic_studies.equality.frame_way` counts functions and files from `identify` to the equation, and what a frame
computes more than once (`frame_way`).

Records of the fast cases are committed in ``recorded``, for the default tests. Where a result changes on purpose:
``record --fast --out studies/equality/recorded``, with the reason in the commit.
"""
