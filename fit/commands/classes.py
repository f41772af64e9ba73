"""What `vsh-fit --classes` does: spin and acceleration of classes of sources, with errors that they share."""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

import fit
from vsh.commands import reading, values
from vsh.field import Field
from vsh.io.parts import as_parts
from vsh.tools.errors import NothingLeftError, NothingSelectedError, ParameterError

_HALVES = ("icrs", "galactic", "ecliptic")


def shared_by(
    source: Any,
    path: str,
    options: argparse.Namespace,
    estimate: Any,
    templates: Sequence[Any] = (),
    n_sources: int = 0,
) -> Any:
    """Normal equations of each class by the weights of the `estimate`, and what they share.

    Those of `n_sources` that are in no class are counted.
    """
    name, _, rest = options.classes.partition(":")
    if name == "halves":
        if rest not in _HALVES:
            raise ParameterError(f"--classes halves:FRAME, where the frame is {', '.join(_HALVES)}, not {rest!r}")
        whole = _read(source, path, options, options.where)
        labels = ["northern half", "southern half"]
        parts = [_of_half(whole, rest, north) for north in (True, False)]
    else:
        labels, conditions = _conditions(options.classes)
        parts = [_class(source, path, options, label, condition) for label, condition in zip(labels, conditions)]
        if ";" in options.classes:
            _check_apart(source, path, options, labels, conditions, parts)
    lmax, inside = estimate.solution.modes.lmax, 0
    method, value = values.method_and_value(options.method)
    if method == "clip":
        inside = sum(as_parts(part).sum(len) for part in parts)
        parts = [fit.estimate(part, lmax, method, value).sources for part in parts]
    parts = [part.to_frame(options.frame) for part in parts]
    make = partial(estimate.equations, templates=templates)
    normals = [make(part, lmax) for part in parts]
    normals = fit.background.widened(normals, make, parts)
    classes = fit.background.shared(
        normals, range(2, lmax + 1), labels=labels, noise_scale=estimate.is_scaled, rng=options.seed
    )
    inside, notes = inside or sum(each.n_sources for each in normals), []
    if n_sources > inside:
        notes.append(f"{n_sources - inside} of {n_sources} sources are in no class: no value, or between conditions")
    return replace(classes, notes=(*classes.notes, *notes, estimate.class_note))


def _conditions(text: str) -> tuple[list[str], list[str]]:
    """Labels of the classes and the conditions of their rows: COLUMN:EDGE,EDGE, or conditions between semicolons."""
    if ";" in text:
        conditions = [part.strip() for part in text.split(";") if part.strip()]
        return conditions, conditions
    name, _, rest = text.rpartition(":")
    try:
        edges = [float(each) for each in rest.split(",")]
    except ValueError:
        edges = []
    if not name.strip() or not edges or not (np.diff(edges) > 0).all():
        raise ParameterError(
            f"--classes is COLUMN:EDGE,EDGE with edges that rise, conditions between semicolons, or halves:FRAME, not "
            f"{text!r}"
        )
    name = name.strip()
    inner = [f"{low:g} <= {name} < {high:g}" for low, high in pairwise(edges)]
    conditions = [f"{name} < {edges[0]:g}", *inner, f"{name} >= {edges[-1]:g}"]
    return [condition.replace("<=", "≤").replace(">=", "≥") for condition in conditions], conditions


def _read(source, path, options, where):
    from vsh.io import catalogue

    if reading.in_parts(options):
        return catalogue.parts(path, **reading.reading_parts(options) | {"where": where})
    return catalogue.read_field(source, **reading.arguments(options) | {"where": where}, roles=())


def _class(source, path, options, label, condition):
    where = condition if options.where is None else f"({options.where}) and ({condition})"
    try:
        return _read(source, path, options, where)
    except NothingSelectedError:
        raise ParameterError(f"the class {label} is empty: choose other edges, or leave it out") from None


def _check_apart(source, path, options, labels, conditions, parts):
    """Raise ParameterError where a source is in two classes."""
    whole = _class(source, path, options, "all", " or ".join(f"({condition})" for condition in conditions))
    counts = [as_parts(part).sum(len) for part in parts]
    total = as_parts(whole).sum(len)
    if sum(counts) > total:
        raise ParameterError(
            f"{sum(counts) - total} sources are in more than one of the classes {'; '.join(labels)}: make them exclude "
            "each other"
        )


def _of_half(whole, frame, north):
    if isinstance(whole, Field):
        return _half(whole, frame, north)
    return whole.map(partial(_half, frame=frame, north=north))


def _half(field, frame, north):
    lat = field.to_frame(frame).lat
    keep = lat >= 0 if north else lat < 0
    if not keep.any():
        raise NothingLeftError("this part of the catalogue lies in the other half of the sky")
    return field[keep]
