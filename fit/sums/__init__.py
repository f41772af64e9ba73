"""Sums over sources: three ways to the same normal equations, and the sandwich of residuals."""

from fit.sums._design_matrix import design_matrix_sums, design_matrix_up_to
from fit.sums._dipole import dipole_sums
from fit.sums._rings import Rings, compressed_sums, fourier_sums, rings_of
from fit.sums._sandwich import leverage, outer_products, sandwich, weighted_matrix, weighted_sums

__all__: list[str] = []
