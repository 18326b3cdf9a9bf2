from .composed.elastoplastic import ELASTOPLASTIC, composed_name
from .composed.free_rubber import FREE_RUBBER, INVARIANTS, knots_of_rubber, rubber_level_names
from .composed.material_card import PROGRAMS, material_card
from .composed.terms import (
    DEFAULT_KNOTS, DEFAULT_RING, GROUPS, KNOTS, LISTS, LOCUS_NAME, PRODUCT_SIGN, REFERENCE, TEMPERATURE_TERMS,
    TERMS, kinds_of, ring_knots_of, surface_weights, term_of,
)
from .composed.written_terms import WrittenTerm, terms_of
from .core import point, tensors
from .core.compilation import CompiledLaw, MODES, compile, has_code_on_disk, is_kept
from .core.crack_band import element_sizes
from .core.kernels import stress_loop
from .core.law import EXPANSION, LawParameter, LawSpec, all_laws, get_law, law_for, register
from .core.outside_values import code_of, outside_values
from .core.point import uniaxial
from .core.points import compiled_loop, directional_stresses, point_stresses, point_tangents
from .core.temperature import KELVIN, STEP, factor
from .core.user_laws import source_of
from .free_forms.free_curve import (
    ClassicalFit, TERM, basis, between_knots, classical_fits, knots, knots_of, level_names,
)
from .free_forms.relaxation_forms import FORMS, grid_covariance
from .free_forms.rubber_forms import RUBBER_TESTS, classical_forms, invariants, stress_matrix
from .free_forms.smoothness import OVER, ROOT, STRAIN, Smoothness, bends, rise
from .free_forms.surface_forms import FAMILY_ERROR, classical_surfaces, equivalent, knot_stresses, powers
from .plasticity.free_locus import POWER, RINGS, RING_KNOTS, prior_rows
from .rate.free_relaxation import (
    DEFAULT_SHARE, DEFAULT_TIMES, FREE_RELAXATION, TIMES, grid, relaxing, times_of, weight_names,
)

__all__ = [
    "DEFAULT_KNOTS", "DEFAULT_RING", "DEFAULT_SHARE", "DEFAULT_TIMES", "ELASTOPLASTIC", "EXPANSION", "FAMILY_ERROR",
    "FORMS", "FREE_RELAXATION", "FREE_RUBBER", "GROUPS", "INVARIANTS", "KELVIN", "KNOTS", "LISTS", "LOCUS_NAME",
    "MODES", "OVER", "POWER", "PRODUCT_SIGN", "PROGRAMS", "REFERENCE", "RINGS", "RING_KNOTS", "ROOT", "RUBBER_TESTS",
    "STEP", "STRAIN", "TEMPERATURE_TERMS", "TERM", "TERMS", "TIMES", "ClassicalFit", "CompiledLaw", "LawParameter",
    "LawSpec", "Smoothness", "WrittenTerm", "all_laws", "basis", "bends", "between_knots", "classical_fits",
    "classical_forms", "classical_surfaces", "code_of", "compile", "compiled_loop", "composed_name",
    "directional_stresses", "element_sizes", "equivalent", "factor", "get_law", "grid", "grid_covariance",
    "has_code_on_disk", "invariants", "is_kept", "kinds_of", "knot_stresses", "knots", "knots_of", "knots_of_rubber",
    "law_for", "level_names", "material_card", "outside_values", "point", "point_stresses", "point_tangents",
    "powers", "prior_rows", "register", "relaxing", "ring_knots_of", "rise", "rubber_level_names", "source_of",
    "stress_loop", "stress_matrix", "surface_weights", "tensors", "term_of", "terms_of", "times_of",
    "uniaxial", "weight_names",
]
