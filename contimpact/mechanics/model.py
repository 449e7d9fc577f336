"""Now `contimpact.models.model`."""

from ..models.model import Formulas, Model, Parameter, Symmetry, Wall

__all__ = ["Formulas", "Model", "Parameter", "Symmetry", "Wall"]
