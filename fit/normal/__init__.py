"""Normal equations, and the moments of the sources that they are made of: both add."""

from fit.normal._coverage import add_coverage_notes
from fit.normal._equations import NormalEquations, TemplateField, eliminate, gaussian_prior
from fit.normal._moments import Moments
from fit.normal._solving import fit_field, solve
from fit.normal._sum import normal_equations
from fit.normal._templates import Template, template_fields

__all__: list[str] = []
