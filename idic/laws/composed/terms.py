"""The terms of a composed law: their parameters and equations.

A parameter is named GROUP_NAME, of the terms in a list GROUP_NUMBER_NAME: ``damage_S``, ``hardening_2_Q``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from idic.laws.composed.elasticity import FIBRE, HAHN_TSAI, ORTHOTROPIC, RAMBERG_OSGOOD, STIFFENING
from idic.laws.composed.flow_stress import (FREE, JOHNSON_COOK, LINEAR, NORTON, PERZYNA, PLATEAU, POWER,
                                                  POWER_REFERENCE, SWIFT, VOCE)
from idic.laws.composed.general_return import ARMSTRONG_FREDERICK, PRAGER
from idic.laws.composed.isotropic_return import DRUCKER_PRAGER, HILL48, IN_PLANE_SHEAR, MISES
from idic.laws.core import temperature
from idic.laws.core.law import LawParameter
from idic.laws.orthotropic import PARAMETERS as ORTHOTROPIC_PARAMETERS
from idic.laws.plasticity.free_locus import FREE_LOCUS, RINGS
from idic.laws.plasticity.free_locus import RING_KNOTS

GROUPS = ("elasticity", "nonlinear_elasticity", "yield_surface", "hardening", "backstress", "rate", "damage",
          "temperature")
LISTS = ("nonlinear_elasticity", "hardening", "backstress", "temperature")  # groups with any number of terms


@dataclass(frozen=True)
class Term:
    """One kind of term.

    Attributes
    ----------
    kind, group : str
        As in experiment.toml: ``hardening = [{ kind = "voce", ... }]``.
    code : int
        The kind in compiled code.
    parameters : tuple of LawParameter
    equation : str
        What it adds, and its source.
    """

    kind: str
    group: str
    code: int
    parameters: tuple[LawParameter, ...]
    equation: str

    def stem(self, number: int) -> str:
        """What the names of its parameters begin with; ``number`` counts the terms of a list from 1."""
        return f"{self.group}_{number}" if self.group in LISTS else self.group

    def named(self, number: int) -> tuple[LawParameter, ...]:
        """Its parameters under the names that they have in the law."""
        return tuple(replace(p, name=f"{self.stem(number)}_{p.name}") for p in self.parameters)


def _lankford(name: str, direction: str, default: float) -> LawParameter:
    return LawParameter(name, "-", f"width over thickness strain of a strip {direction} the rolling direction",
                        default=default, null=1.0, bounds=(0.05, 20.0))


_ANY_SIGN = (-np.inf, np.inf)

_AXES_ANGLE = LawParameter("angle", "deg", "from the mesh's x axis to material axis 1, about z", default=0.0, null=0.0,
                           positive=False, bounds=_ANY_SIGN)

TERMS = {term.kind: term for term in (
    Term("isotropic", "elasticity", 0, (), "E and nu of the law"),
    Term("orthotropic", "elasticity", ORTHOTROPIC, (*ORTHOTROPIC_PARAMETERS[:-1], _AXES_ANGLE),
         "E1, E2, nu12, G12 instead of E and nu, closed through the thickness as the law orthotropic; energy of a "
         "strain that is logarithmic to third order, Bazant (1998), doi:10.1115/1.2807001"),
    Term("fibre", "nonlinear_elasticity", FIBRE,
         (LawParameter("gamma", "-", "growth of the secant modulus along axis 1 with the strain there", default=15.0,
                       null=0.0, positive=False, bounds=_ANY_SIGN),),
         "t11 + gamma E1 e11^2: secant modulus E1 (1 + gamma e11)"),
    Term("stiffening", "nonlinear_elasticity", STIFFENING,
         (LawParameter("gamma", "-", "growth of the secant stiffness with the equivalent strain; negative softens",
                       default=5.0, null=0.0, positive=False, bounds=_ANY_SIGN),),
         "stress (1 + gamma k), k = sqrt(e : C : e / E): in tension and compression E (1 + gamma |strain|)"),
    Term("ramberg_osgood", "nonlinear_elasticity", RAMBERG_OSGOOD,
         (LawParameter("K", "-", "factor of the power term", default=100.0, null=0.0),
          LawParameter("n", "-", "exponent of the power term", default=2.5, bounds=(1.0, 20.0))),
         "strain = x + K x^n, x = stress / modulus: shear 12 of an orthotropic body, the deviator of an isotropic one; "
         "reversible; Ramberg & Osgood, NACA TN 902 (1943)"),
    Term("hahn_tsai", "nonlinear_elasticity", HAHN_TSAI,
         (LawParameter("alpha", "1/MPa^3", "shear strain per cube of the shear stress", default=3e-8, null=0.0),),
         "shear strain 12 = t12 / G12 + alpha t12^3; Hahn & Tsai, J. Compos. Mater. 7 (1973) 102, "
         "doi:10.1177/002199837300700108"),
    Term("mises", "yield_surface", MISES, (), "q = sqrt(3/2 s : s)"),
    Term("hill48", "yield_surface", HILL48,
         (_lankford("r0", "along", 1.6), _lankford("r45", "at 45 degrees to", 1.2), _lankford("r90", "across", 2.0),
          LawParameter("angle", "deg", "from the mesh's x axis to the rolling direction, about z", default=0.0,
                       null=0.0, positive=False, bounds=_ANY_SIGN)),
         "q of r0, r45, r90 as in j2_hill; Hill (1948), doi:10.1098/rspa.1948.0045"),
    Term("in_plane_shear", "yield_surface", IN_PLANE_SHEAR, (_AXES_ANGLE,),
         "q = |s12| in the material axes, p the plastic shear strain; nothing else yields"),
    Term("drucker_prager", "yield_surface", DRUCKER_PRAGER,
         (LawParameter("friction", "-", "growth of the flow stress with the pressure", default=0.3, null=0.0,
                       positive=False, bounds=(-2.9, 2.9)),),
         "q = flow stress + friction pressure, flow without change of volume; Drucker & Prager (1952), "
         "doi:10.1090/qam/48291"),
    Term("free_surface", "yield_surface", FREE_LOCUS, (),
         "q^8 a sum of eighth powers of linear forms of the stress on three rings of knots, convex for weights u1 ... "
         "of zero or more; free_surface or free_surface6 has 6 knots on a ring; Gotoh, Int. J. Mech. Sci. 19 "
         "(1977) 505, doi:10.1016/0020-7403(77)90043-1"),
    Term("linear", "hardening", LINEAR,
         (LawParameter("H", "MPa", "slope of the flow stress over plastic strain", default=1000.0, positive=False,
                       bounds=_ANY_SIGN),), "H p"),
    Term("voce", "hardening", VOCE,
         (LawParameter("Q", "MPa", "saturation of the hardening", default=100.0, positive=False, bounds=_ANY_SIGN),
          LawParameter("b", "-", "rate of the saturation over plastic strain", default=20.0)),
         "Q (1 - exp(-b p)) (Voce 1948)"),
    Term("plateau", "hardening", PLATEAU,
         (LawParameter("H", "MPa", "slope of the flow stress over plastic strain behind the plateau", default=1000.0,
                       positive=False, bounds=_ANY_SIGN),
          LawParameter("length", "-", "plastic strain up to which nothing hardens", default=0.003, null=0.0)),
         "H max(p - length, 0): Lueders' elongation as a flat part of the curve, without its bands"),
    Term("power", "hardening", POWER,
         (LawParameter("K", "MPa", "factor of the power law", default=300.0),
          LawParameter("n", "-", "exponent of the power law", default=0.3, bounds=(0.0, 5.0))),
         "K p^n (Ludwik 1909)"),
    Term("power_reference", "hardening", POWER_REFERENCE,
         (LawParameter("K0", "MPa", "hardening stress at the plastic strain ep0", default=50.0),
          LawParameter("n", "-", "exponent of the power law", default=0.3, bounds=(0.0, 5.0)),
          LawParameter("ep0", "-", "plastic strain at which K0 is added; about half the largest of the test, locked",
                       default=2e-3)),
         "K0 (p / ep0)^n (Ludwik 1909): power with K = K0 ep0^-n, for plastic strains below 1 %, where K and n "
         "cannot be separated"),
    Term("swift", "hardening", SWIFT,
         (LawParameter("K", "MPa", "flow stress where eps0 + plastic strain is 1", default=500.0),
          LawParameter("eps0", "-", "pre-strain; the initial yield stress is K eps0^n", default=0.01,
                       bounds=(0.0, 1.0)),
          LawParameter("n", "-", "exponent (0: no hardening, sigma = K)", default=0.2, bounds=(0.0, 5.0))),
         "K (eps0 + p)^n instead of yield_stress; Swift, J. Mech. Phys. Solids 1 (1952) 1, "
         "doi:10.1016/0022-5096(52)90002-1"),
    Term("free", "hardening", FREE, (),
         "linear between yield_stress, s2 ... sn at n knots, range ((k - 1) / (n - 1))^2; free or free8 has 8 of them, "
         "free12 has 12"),
    Term("prager", "backstress", PRAGER,
         (LawParameter("C", "MPa", "kinematic modulus: slope of the back stress over plastic strain",
                       default=2000.0),),
         "back stress' = 2/3 C (plastic strain)' (Prager 1956)"),
    Term("armstrong_frederick", "backstress", ARMSTRONG_FREDERICK,
         (LawParameter("C", "MPa", "kinematic modulus: initial slope of the back stress over plastic strain",
                       default=5000.0),
          LawParameter("gamma", "-", "recovery of the back stress, which saturates at C / gamma", default=50.0)),
         "back stress' = 2/3 C (plastic strain)' - gamma (back stress) p'; Armstrong & Frederick (1966); Chaboche, "
         "Int. J. Plast. 2 (1986) 149, doi:10.1016/0749-6419(86)90010-0"),
    Term("norton", "rate", NORTON,
         (LawParameter("eta", "MPa*s", "viscosity: the overstress at a plastic strain rate of 1/s", default=100.0),
          LawParameter("m", "-", "rate exponent, overstress = eta rate^(1/m) with the rate in 1/s", default=3.0,
                       bounds=(0.1, 1000.0))),
         "+ eta p'^(1/m); Chaboche, Int. J. Plast. 2 (1986) 149, doi:10.1016/0749-6419(86)90010-0"),
    Term("perzyna", "rate", PERZYNA,
         (LawParameter("tau", "s", "inverse of the plastic strain rate at which the flow stress has doubled",
                       default=0.01),
          LawParameter("m", "-", "rate exponent", default=3.0, bounds=(0.1, 1000.0))),
         "flow stress (1 + (tau p')^(1/m)); Perzyna (1966), doi:10.1016/S0065-2156(08)70009-7"),
    Term("johnson_cook", "rate", JOHNSON_COOK,
         (LawParameter("C", "-", "growth of the flow stress with ln of the rate", default=0.03),
          LawParameter("reference_rate", "1/s", "plastic strain rate above which the flow stress is rate-dependent; "
                                                "chosen, locked",
                       default=1e-3)),
         "flow stress (1 + C ln(1 + p' / reference_rate)); Johnson & Cook, Eng. Fract. Mech. 21 (1985) 31, "
         "doi:10.1016/0013-7944(85)90052-9"),
    Term("lemaitre", "damage", 1,
         (LawParameter("S", "MPa", "strength of damage: the energy density at which D grows as fast as p",
                       default=0.5),
          LawParameter("s", "-", "exponent of the energy density", default=1.0, bounds=(0.0, 20.0)),
          LawParameter("threshold", "-", "plastic strain at which damage starts", default=0.002, null=0.0),
          LawParameter("length", "mm", "element size for which S holds: crack band; 0 the same S in every element",
                       default=1.0, null=0.0)),
         "stress (1 - D), D' = (Y / S)^s p' h / length, h the size of the element; Lemaitre, J. Eng. Mater. Technol. "
         "107 (1985) 83, doi:10.1115/1.3225775"),
)}


TEMPERATURE_TERMS = {term.kind: term for term in (
    Term("linear", "temperature", temperature.LINEAR,
         (LawParameter("slope", "1/K", "relative growth per kelvin", default=-1e-3, null=0.0, positive=False,
                       bounds=_ANY_SIGN),), "times 1 + slope (T - reference_temperature)"),
    Term("johnson_cook", "temperature", temperature.JOHNSON_COOK,
         (LawParameter("m", "-", "exponent of the homologous temperature", default=1.0, bounds=(0.05, 20.0)),
          LawParameter("melting", "C", "temperature at which the factor is zero; chosen, locked", default=1500.0,
                       positive=False, bounds=(-temperature.KELVIN, np.inf))),
         "times 1 - ((T - reference_temperature) / (melting - reference_temperature))^m; Johnson & Cook, Eng. Fract. "
         "Mech. 21 (1985) 31, doi:10.1016/0013-7944(85)90052-9"),
    Term("arrhenius", "temperature", temperature.ARRHENIUS,
         (LawParameter("activation", "K", "activation energy over the gas constant; positive falls with T",
                       default=2000.0,
                       null=0.0, positive=False, bounds=_ANY_SIGN),),
         "times exp(activation (1/T - 1/reference_temperature)), both in K"),
)}
PRODUCT_SIGN, FLOW_STRESS = "*", "flow_stress"  # linear*yield_stress; yield stress and all hardening stresses
REFERENCE = LawParameter("reference_temperature", "C", "temperature at which the parameters hold as they are given",
                         default=20.0,
                         positive=False, bounds=(-temperature.KELVIN, np.inf))

WEIGHT_MAX_STEP = 1.0  # of a weight of a free yield surface, whose mean is 1: the surface changes little by one of them
LOCUS_NAME = re.compile(r"free_surface(\d*)")
DEFAULT_RING = 6  # knots on a ring of a free yield surface
DEFAULT_KNOTS, KNOTS = 8, (3, 24)  # of a free curve; fewest and most
FREE_NAME = re.compile(r"free(\d*)")


def term_of(kind: str) -> Term | None:
    """The term of that kind, ``free12`` one with 12 knots, ``linear*E`` a factor on E; None where there is none."""
    stem, times, targets = kind.partition(PRODUCT_SIGN)
    if times:
        return replace(TEMPERATURE_TERMS[stem], kind=kind) if stem in TEMPERATURE_TERMS and targets else None
    locus = LOCUS_NAME.fullmatch(kind)
    if locus is not None:
        return _free_surface(int(locus[1] or DEFAULT_RING))
    match = FREE_NAME.fullmatch(kind)
    if match is None:
        return TERMS.get(kind)
    n = int(match[1] or DEFAULT_KNOTS)
    if not KNOTS[0] <= n <= KNOTS[1]:
        return None
    levels = tuple(LawParameter(f"s{k}", "MPa", f"flow stress at knot {k} of {n}", default=200.0 + 25.0 * k)
                   for k in range(2, n + 1))
    range_parameter = LawParameter("range", "-", "plastic strain of the last knot; chosen, locked", default=0.2)
    return replace(TERMS["free"], kind=f"free{n}", code=FREE + n, parameters=(range_parameter, *levels))


def _free_surface(n: int) -> Term | None:
    """A free yield surface with n knots on a ring; None where it cannot have so many."""
    if not RING_KNOTS[0] <= n <= RING_KNOTS[1]:
        return None
    weights = tuple(LawParameter(f"u{k}", "-", f"weight of knot {k} of {RINGS * n}; all equal: Mises's surface",
                                 default=1.0 + 0.3 * (-1) ** k, positive=False, bounds=(0.0, np.inf),
                                 max_step=WEIGHT_MAX_STEP)
                    for k in range(1, RINGS * n + 1))
    return replace(TERMS["free_surface"], kind=f"free_surface{n}", code=FREE_LOCUS + n,
                   parameters=(_AXES_ANGLE, *weights))


def ring_knots_of(law: str) -> int:
    """The number of knots on a ring of the free yield surface in a law's name; 0 without one."""
    match = LOCUS_NAME.search(law)
    return int(match[1] or DEFAULT_RING) if match else 0


def surface_weights(n: int) -> tuple[str, ...]:
    """The parameters that are the weights of a free yield surface with n knots on a ring."""
    return tuple(f"yield_surface_u{k}" for k in range(1, RINGS * n + 1))


def kinds_of(group: str) -> tuple[str, ...]:
    """The kinds of a group, in the order of `TERMS`."""
    return tuple(term.kind for term in (*TERMS.values(), *TEMPERATURE_TERMS.values()) if term.group == group)
