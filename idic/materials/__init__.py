"""Constitutive laws: one point, one function, one file. Importing this package registers all laws and compiles none."""

from idic.materials import elastic, j2_linear, j2_power, j2_voce, neo_hookean, orthotropic  # noqa: F401 (registers)
from idic.materials.compilation import MODES, CompiledLaw, compile
from idic.materials.law import LawParameter, LawSpec, all_laws, get_law, register

__all__ = ["MODES", "CompiledLaw", "LawParameter", "LawSpec", "all_laws", "compile", "get_law", "register"]
