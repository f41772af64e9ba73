"""All realisations of a study, on all cores, each written when it is done, and tables of what came of them.

A killed study goes on where it was.
"""

import json
from collections.abc import Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import ndtr
from threadpoolctl import threadpool_limits

from study.config import Study, StudyError
from study.realise import prepare_realisation, prepared_sources, realise
from vsh.figures.plot import COLOURS, WIDTH, apply_style, legend_above, panels, symbol
from vsh.io import tables
from vsh.tools.files import atomic_write, exclusive, remove_unfinished
from vsh.tools.parallel import cores, delay_interrupts, ended_if_interrupted, process_pool, progress_bar
from vsh.tools.printing import printable
from vsh.tools.types import AxesArray, OnAxes, PathName, Table


def read_realisations(study: Study, folder: Path, n_realisations: int) -> Any:
    """Values and errors of all realisations, by case: dicts of name to (n_realisations,) arrays."""
    realisations = {}
    for case in study.cases:
        paths = [folder / "realisations" / case["name"] / f"{number:05d}.json" for number in range(n_realisations)]
        rows = [json.loads(path.read_text(encoding="utf-8")) for path in paths]
        realisations[case["name"]] = tuple(
            {name: np.array([row[quantity][name] for row in rows]) for name in rows[0][quantity]}
            for quantity in ("values", "sigma")
        )
    return realisations


def write_results(study: Study, folder: Path, n_realisations: int) -> None:
    """Write results.ecsv (every number of every realisation) and summary.ecsv (a row a case and parameter)."""
    realisations = read_realisations(study, folder, n_realisations)
    columns = {"case": [], "realisation": [], "parameter": [], "value": [], "sigma": []}
    for case, (values, sigma) in realisations.items():
        for name in values:
            columns["case"] += [case] * n_realisations
            columns["realisation"] += range(n_realisations)
            columns["parameter"] += [name] * n_realisations
            columns["value"] += values[name].tolist()
            columns["sigma"] += sigma[name].tolist()
    meta = {"study": study.settings["name"], "frame": study.settings["frame"], "n_realisations": n_realisations}
    tables.write(folder / "results.ecsv", columns, meta)
    rows = summary(study, realisations)
    tables.write(folder / "summary.ecsv", {key: [row[key] for row in rows] for key in rows[0]}, meta)


def summary(study: Study, realisations: Any) -> list[dict[str, Any]]:
    """Mean, standard deviation and mean formal error of every parameter: a list of dicts.

    The truth stands beside them, and how far the mean is from it in standard errors of the mean; how uncertain the
    scatter is after so many realisations; and the shares of them whose intervals of 68 and 95 % (1 and 1.96 σ) hold the
    truth, with the standard deviation that such a share would have if the errors were right.
    """
    rows = []
    for case, (values, sigma) in realisations.items():
        for name, value in values.items():
            true = truth_of(study, name)
            scatter = float(np.std(value, ddof=1)) if len(value) > 1 else float("nan")
            error = scatter / np.sqrt(len(value))
            n, deviation = len(value), np.abs(value - true) / sigma[name]
            row = {
                "case": case,
                "parameter": name,
                "n": n,
                "truth": true,
                "mean": float(value.mean()),
                "std": scatter,
                "sigma": float(sigma[name].mean()),
                "off": float((value.mean() - true) / error) if error > 0 else float("nan"),
                "std_error": float(scatter / np.sqrt(2 * max(1, n - 1))),
            }
            for share, reach in ((68, 1.0), (95, 1.959963984540054)):
                row[f"within_{share}"] = float((deviation <= reach).mean())
                row[f"within_{share}_error"] = float(np.sqrt(chance(reach) * (1 - chance(reach)) / n))
            rows.append(row)
    return rows


def chance(reach: float) -> float:
    """Probability that a normal deviate is within `reach` standard deviations."""
    return float(2 * ndtr(reach) - 1)


def table_of(rows: list[dict[str, Any]]) -> Table:
    """A summary as an astropy Table."""
    return tables.table_of({key: [row[key] for row in rows] for key in rows[0]})


def truth_of(study: Study, name: str) -> float:
    """The true value of a parameter."""
    from study.realise import true_velocity

    truth, name = study.truth, name.split("@")[0].removeprefix("g_")
    if name == "H0":
        return truth["hubble"]
    vector, axis = name.rsplit("_", 1)
    vector_names = {"epsilon": "orientation", "omega": "spin", "a": "acceleration"}
    values = true_velocity(study).value if vector == "v" else truth[vector_names[vector]]
    return float(values["xyz".index(axis)])


_MARKS = "os^Dv<>P"
#: Names are still read of so many parameters.
_NAMED = 24


def _distinct(rows):
    """The parameters, without those that have the numbers of one before them: degree 1 alone where that is all."""
    statistics: dict[str, list[Any]] = {}
    for row in rows:
        numbers = [f"{row[key]:.6g}" for key in ("mean", "std", "sigma")]
        statistics.setdefault(row["parameter"], []).append((row["case"], *numbers))
    representatives: dict[Any, str] = {}
    for name, all_numbers in statistics.items():
        representatives.setdefault(tuple(all_numbers), name)
    return list(representatives.values())


def _symbol(name):
    """A parameter as it is printed in a figure: the degree of its fit behind its symbol."""
    parameter, _, degree = name.partition("@")
    return symbol(parameter) + (f", $L = {degree}$" if degree else "")


@apply_style
def plot_calibration(rows: Sequence[Mapping[str, Any]], *, ax: OnAxes | None = None) -> AxesArray:
    """Off mean, scatter over formal error, and coverage of every parameter, with the errors of so few realisations."""
    cases = list(dict.fromkeys(row["case"] for row in rows))
    names = _distinct(rows)
    width = max(WIDTH, 0.16 * len(names) + 0.8)
    off, scatter, coverage = axes_array = panels(ax, 3, 1, size=(width, 4.6), sharex=True)
    for i, case in enumerate(cases):
        case_rows = [row for row in rows if row["case"] == case and row["parameter"] in names]
        shift = (i - (len(cases) - 1) / 2) * 0.6 / max(1, len(cases))
        x = np.array([names.index(row["parameter"]) for row in case_rows]) + shift
        value = {
            key: np.array([row[key] for row in case_rows], float)
            for key in case_rows[0]
            if key not in ("case", "parameter")
        }
        colour, mark = COLOURS[i % len(COLOURS)], _MARKS[i % len(_MARKS)]
        n = value["n"]
        with np.errstate(divide="ignore", invalid="ignore"):
            style = {"color": colour, "fmt": mark, "markersize": 2.5, "linewidth": 0.7}
            off.errorbar(x, (value["mean"] - value["truth"]) / value["std"], 1 / np.sqrt(n), label=case, **style)
            scatter.errorbar(x, value["std"] / value["sigma"], value["std_error"] / value["sigma"], **style)
        for share, open_ in ((68, False), (95, True)):
            face = {"markerfacecolor": "white"} if open_ else {}
            coverage.errorbar(x, value[f"within_{share}"], value[f"within_{share}_error"], **style, **face)
    off.axhline(0, color="0.5", linewidth=0.6, zorder=0)
    off.set_ylabel("(mean − truth)\n/ scatter")
    scatter.axhline(1, color="0.5", linewidth=0.6, zorder=0)
    scatter.set_ylabel("scatter\n/ formal error")
    for level in (0.6827, 0.95):
        coverage.axhline(level, color="0.5", linewidth=0.6, zorder=0)
    coverage.set_ylim(0, 1.12)  # error bars end above 1
    coverage.set_ylabel("truth within\n68 % (95 %: open)")
    step = -(-len(names) // _NAMED) if len(names) > 4 * _NAMED else 1
    coverage.set_xticks(range(0, len(names), step), [_symbol(name) for name in names[::step]], rotation=90, fontsize=6)
    legend_above(off, 4)
    return axes_array


def run(
    study: Study,
    folder: PathName,
    *,
    n_realisations: int | None = None,
    workers: int | None = None,
    progress: bool = True,
) -> Path:
    """Run a study into a folder, or go on with one.

    Parameters
    ----------
    study : Study
        The configuration.
    folder : path
        study.json, prepared/, realisations/CASE/NNNN.json, and results.ecsv and summary.ecsv at the end. A
        study that was killed leaves whole files only; run again, it ends in the same bytes as one that was not.
    n_realisations : int, optional
        In place of the configuration's.
    workers : int, optional
        Processes; one a core unless given.
    progress : bool
        Bars with the time left.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    StudyError
        If the folder belongs to another configuration; the message names the difference.
    """
    folder = Path(folder)
    _check_folder(folder)
    try:
        for subfolder in ("prepared", *(f"realisations/{case['name']}" for case in study.cases)):
            (folder / subfolder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StudyError(f"{folder} cannot be made a folder: {error.strerror}") from error
    with exclusive(folder / "study.json"):
        return _run(study, folder, n_realisations, workers, progress)


def _run(study, folder, n_realisations, workers, progress):
    """Run while no other process works in the folder."""
    _claim(study, folder)
    count = n_realisations or study.n_realisations
    tasks = []
    for index, case in enumerate(study.cases):
        if study.mission["attitude"] == "solved":
            files = {"joint": prepared_sources(study, case, folder / "prepared", progress)}
        else:
            files = {
                source_type: prepare_realisation(study, case, source_type, folder / "prepared", progress)
                for source_type in case
                if source_type != "name"
            }
        tasks += [(index, files, number) for number in range(count) if not _path(folder, case, number).exists()]
    tasks.sort(key=lambda task: (task[2], task[0]))  # every case gets on alike
    _work(study, folder, tasks, workers or cores(), progress)
    remove_unfinished(folder)  # what a killed run was writing
    write_results(study, folder, count)
    return folder


def _work(study, folder, tasks, workers, progress):
    bar = progress_bar(None, len(tasks), "realisations", progress, smoothing=0.05)
    if not tasks:
        return
    if workers == 1:  # here: scripts without `if __name__ == "__main__"` may ask for it
        with bar:
            for task in tasks:
                _run_realisation(study, folder, task)
                bar.update()
        return
    with bar, process_pool(min(workers, len(tasks))) as pool, ended_if_interrupted():
        waiting, queue = {}, iter(tasks)
        for task in queue:
            with delay_interrupts():
                waiting[pool.submit(_run_realisation, study, folder, task)] = task
            if len(waiting) < 2 * workers:
                continue
            futures, _ = wait(waiting, return_when=FIRST_COMPLETED)
            _collect(waiting, futures, bar)
        while waiting:
            futures, _ = wait(waiting, return_when=FIRST_COMPLETED)
            _collect(waiting, futures, bar)


def _collect(waiting, futures, bar):
    for future in futures:
        waiting.pop(future)
        future.result()
        bar.update()


def _run_realisation(study, folder, task):
    """Compute a realisation in a process of its own, and write it whole."""
    index, files, number = task
    with threadpool_limits(1):
        outcome = realise(study, index, files, number)
    path = _path(folder, study.cases[index], number)
    with atomic_write(path, overwrite=True) as output:
        output.write_text(json.dumps(outcome, indent=1), encoding="utf-8")


def _path(folder, case, number):
    return folder / "realisations" / case["name"] / f"{number:05d}.json"


def _check_folder(folder):
    """Raise StudyError if a folder holds anything but a study."""
    label = printable(folder)
    if folder.exists() and not folder.is_dir():
        raise StudyError(f"{label} is a file, not a folder")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / "study.json").is_file():
        raise StudyError(f"{label} holds files that are no study's: name a new folder")


def _claim(study, folder):
    """Write the configuration into a new folder; compare it with that of an old one."""
    path, plain = folder / "study.json", study.plain()
    if not path.exists():
        with atomic_write(path) as output:
            output.write_text(json.dumps(plain, indent=1), encoding="utf-8")
        return
    try:
        configuration = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        raise StudyError(f"{path} is damaged: take another folder, or delete this one") from None
    differences = list(_differences(configuration, plain))
    if differences:
        raise StudyError(
            f"{folder} holds another study ({'; '.join(differences[:5])}): take another folder, or delete it"
        )


def _differences(stored_value, value, key_path=""):
    if isinstance(stored_value, dict) and isinstance(value, dict):
        for key in sorted({*stored_value, *value}):
            yield from _differences(stored_value.get(key), value.get(key), f"{key_path}{'.' if key_path else ''}{key}")
    elif isinstance(stored_value, list) and isinstance(value, list) and len(stored_value) == len(value):
        for i, pair in enumerate(zip(stored_value, value, strict=True)):
            yield from _differences(*pair, f"{key_path}[{i}]")
    elif stored_value != value:
        yield f"{key_path}: there {stored_value}, here {value}"
