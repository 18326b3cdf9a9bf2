"""The reference image's noise is shared by all frames: the sums over time that the sandwich and the GLS system need.

    Cov = sigma^2 M^-1 [ S^T S / N + sum_t kappa_t L_t^T L_t ] M^-1,     S = sum_t L_t pixel by pixel

`S` never exists: ``L_t = grad f . F_t^-1 phi_t``, so per element ``sum_t F_t^-1 dU_t`` is enough, and the reference
image's element blocks do the rest. Frames with lost pixels count as if they had lost none. (`N` reference images.)
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from idic.correlation.cells import N_NODES, inverse_gradients
from idic.correlation.pixel_map import element_coefficients
from idic.correlation.reference import ReferenceImage


def pulled_back(reference: ReferenceImage, u_px: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """F^-1 times nodal fields, per element: add these up over the frames.

    Parameters
    ----------
    u_px : array (n_nodes, 2)
    columns : array (2 n_nodes, m)
        Sensitivities of the frame (what was eliminated with the frame already taken out), px per unit.

    Returns
    -------
    array (n_elements, 2 n_max, m)
    """
    pm = reference.pixel_map
    inverse, det = np.empty((pm.n_elements, 2, 2)), np.empty(pm.n_elements)
    inverse_gradients(element_coefficients(pm, u_px), pm.centre, pm.inverse_jacobian, inverse, det)
    n_max = int(N_NODES[pm.kind].max())
    fields = np.asarray(columns).reshape(pm.n_nodes, 2, -1)[pm.conn[:, :n_max]]  # (nel, n_max, 2, m)
    back = np.matmul(inverse[:, None], fields)
    back[np.arange(n_max) >= N_NODES[pm.kind][:, None]] = 0.0
    return back.reshape(pm.n_elements, 2 * n_max, -1)


def reference_gram(reference: ReferenceImage, fields: np.ndarray, brightness: str = "none") -> np.ndarray:
    """Gram matrix of pulled-back fields (and brightness columns) on the reference image, pixel by pixel.

    Parameters
    ----------
    fields : array (n_elements, 2 n_max, m)
        `pulled_back`, summed over frames.

    Returns
    -------
    array (m + nb, m + nb)
        S^T S, bordered by the brightness columns as in `FrameGram.matrix`.
    """
    m = fields.shape[2]
    h_fields = np.matmul(full_hessians(reference), fields)
    layout = reference.layout(brightness)
    nb = layout.n_columns
    matrix = np.zeros((m + nb, m + nb))
    matrix[:m, :m] = fields.reshape(-1, m).T @ h_fields.reshape(-1, m)
    if nb == 0:
        return matrix
    blocks = reference.blocks
    centre = layout.mean.astype(float)[layout.patch] - reference.level
    gain = blocks.coupling[..., 0] - centre[:, None, None] * blocks.coupling[..., 1]  # (nel, n_max, 2)
    columns = -np.stack([gain, blocks.coupling[..., 1]], axis=-1).reshape(len(centre), -1, 2)  # (nel, 2 n_max, 2)
    per_element = np.matmul(np.swapaxes(fields, 1, 2), columns)  # (nel, m, 2)
    number, first, second = blocks.grey.T
    own = np.stack([second - 2 * centre * first + centre**2 * number, first - centre * number, number], axis=1)
    member = sparse.csr_array((np.ones(len(centre)), (layout.patch, np.arange(len(centre)))))
    border = (member @ per_element.reshape(len(centre), -1)).reshape(-1, m, 2)  # (n_patches, m, 2)
    matrix[:m, m:] = border.transpose(1, 0, 2).reshape(m, nb)
    matrix[m:, :m] = matrix[:m, m:].T
    gg, go, oo = (member @ own).T
    i = m + 2 * np.arange(layout.n_patches)
    matrix[i, i], matrix[i + 1, i + 1] = gg, oo
    matrix[i, i + 1] = matrix[i + 1, i] = go
    return matrix


def full_hessians(reference: ReferenceImage) -> np.ndarray:
    """The element blocks H_e of the undeformed reference as square matrices  # (n_elements, 2 n_max, 2 n_max)"""
    packed = reference.blocks.hessian
    n_max = int(N_NODES[reference.pixel_map.kind].max())
    i, j = np.tril_indices(n_max)
    full = np.zeros((len(packed), n_max, 2, n_max, 2))
    for row, column in ((i, j), (j, i)):
        full[:, row, 0, column, 0] = packed[:, :, 0]
        full[:, row, 0, column, 1] = full[:, row, 1, column, 0] = packed[:, :, 1]
        full[:, row, 1, column, 1] = packed[:, :, 2]
    return full.reshape(len(packed), 2 * n_max, 2 * n_max)
