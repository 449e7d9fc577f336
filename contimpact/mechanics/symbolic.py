"""Now `contimpact.models.symbolic`."""

from ..models.symbolic import DecayingStumpff, Stumpff, fourier_series, harmonic_means

__all__ = ["DecayingStumpff", "Stumpff", "fourier_series", "harmonic_means"]
