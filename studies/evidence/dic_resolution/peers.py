"""One public DIC code on the images of `curve.py`, in the interpreter in which it is installed.

    PYTHON peers.py CODE SIZE STEP MARGIN RESULT.npz REFERENCE IMAGE...

CODE is pyvale-AFFINE, pyvale-QUAD, al-dic (augmented Lagrangian) or al-dic-local (subsets alone). RESULT holds
x, y (n,) px of the points and u, v (n_images, n) px.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np


def pyvale(shape: str, size: int, step: int, margin: int, files: list[Path]) -> dict:
    from PIL import Image
    from pyvale import dic

    ny, nx = np.asarray(Image.open(files[0])).shape
    mask, edge = np.zeros((ny, nx), bool), margin - size // 2
    mask[edge:ny - edge, edge:nx - edge] = True
    with tempfile.TemporaryDirectory() as folder:
        dic.calculate_2d(reference=files[0], deformed=files[1:], roi_mask=mask, subset_size=size, subset_step=step,
                         shape_function=shape, seed=[3 * nx // 4, ny // 2], max_displacement=10, num_threads=1,
                         output_basepath=folder, print_level=0)
        data = dic.import_2d(data=sorted(Path(folder).glob("*.csv")), layout="column", delimiter=",")
    return {"x": data.ss_x, "y": data.ss_y, "u": data.u_px, "v": data.v_px}


def al_dic(coupled: bool, size: int, step: int, margin: int, files: list[Path]) -> dict:
    from al_dic import dicpara_default, run_aldic
    from al_dic.core.data_structures import GridxyROIRange
    from PIL import Image

    images = [np.asarray(Image.open(file), float) / 255 for file in files]
    ny, nx = images[0].shape
    area = GridxyROIRange((margin, nx - 1 - margin), (margin, ny - 1 - margin))
    settings = dicpara_default(winsize=size, winstepsize=step, winsize_min=step, gridxy_roi_range=area,
                               img_size=(ny, nx), reference_mode="accumulative", tol=1e-4, use_global_step=coupled)
    result = run_aldic(settings, images, [np.ones((ny, nx))] * len(images), compute_strain=False)
    motion = np.array([frame.U for frame in result.result_disp])
    x, y = result.dic_mesh.coordinates_fem.T
    return {"x": x, "y": y, "u": motion[:, ::2], "v": motion[:, 1::2]}


def main() -> None:
    code, size, step, margin, result, *files = sys.argv[1:]
    paths, numbers = [Path(file) for file in files], (int(size), int(step), int(margin))
    fields = (pyvale(code.split("-")[1], *numbers, paths) if code.startswith("pyvale")
              else al_dic(code == "al-dic", *numbers, paths))
    np.savez(result, **fields)


if __name__ == "__main__":
    main()
