"""Hill's (1948) quadratic yield condition of rolled sheet, in material axes (1 the rolling direction, 3 = z).

    q^2 = f (s22 - s33)^2 + g (s33 - s11)^2 + h (s11 - s22)^2 + 3 (s23^2 + s13^2) + 2 n s12^2 = s : A s
    g = 1 / (1 + r0),  h = r0 g,  f = h / r90,  n = (r0 + r90) (1 + 2 r45) g / (2 r90)

r0, r45, r90 are the ratios of width to thickness strain (Lankford) of tension strips cut at 0, 45 and 90 degrees; the
flow stress is that of the strip along the rolling direction, and p is conjugate to it. Shear through the thickness is
as in the isotropic law; with r0 = r45 = r90 = 1 it is Mises's condition. The surface is convex as long as the ratios
are positive. Hill, Proc. R. Soc. Lond. A 193 (1948) 281, doi:10.1098/rspa.1948.0045.
"""

from __future__ import annotations

from idic.laws.core.inner import inner


@inner
def coefficients(first, params):
    """(f, g, h, n), r0, r45, r90 from place `first` on; real or complex."""
    r0, r45, r90 = params[first], params[first + 1], params[first + 2]
    g = 1.0 / (1.0 + r0)
    h = r0 * g
    return h / r90, g, h, 0.5 * (r0 + r90) * (1.0 + 2.0 * r45) * g / r90


@inner
def returned(s, z, a):
    """s+ of s+ + z A s+ = s, a deviator in material axes; a = (f, g, h, n)."""
    f, g, h, n = a
    a11, a12 = 1.0 + z * (2.0 * g + h), z * (g - h)  # s33 = -s11 - s22 is eliminated
    a21, a22 = z * (f - h), 1.0 + z * (2.0 * f + h)
    below = 1.0 / (a11 * a22 - a12 * a21)
    s11, s22 = (a22 * s[0] - a12 * s[1]) * below, (a11 * s[1] - a21 * s[0]) * below
    across = 1.0 / (1.0 + 1.5 * z)
    return s11, s22, -s11 - s22, s[3] / (1.0 + z * n), s[4] * across, s[5] * across


@inner
def flow_direction(s, a):
    """A s of a deviator in material axes."""
    f, g, h, n = a
    return ((g + h) * s[0] - h * s[1] - g * s[2], (f + h) * s[1] - h * s[0] - f * s[2],
            (f + g) * s[2] - g * s[0] - f * s[1], n * s[3], 1.5 * s[4], 1.5 * s[5])
