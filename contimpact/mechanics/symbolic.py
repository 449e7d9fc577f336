"""Now `contimpact.models.symbolic`."""

from ..models.symbolic import MeanTransient, Stumpff, Transient, fourier_series, harmonic_means

__all__ = ["MeanTransient", "Stumpff", "Transient", "fourier_series", "harmonic_means"]
