"""Every published analysis of quasar motions from one catalogue, and what a referee would ask of it."""

from study.referee._quasars import Quasars, read_quasars
from study.referee._referee import Referee, referee
from study.referee._rows import Analysis, Check, Row, Value

__all__ = ["Analysis", "Check", "Quasars", "Referee", "Row", "Value", "read_quasars", "referee"]
