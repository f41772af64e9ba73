"""All realisations of a study, on all cores, each written when it is done; a killed study goes on."""

import json
from concurrent.futures import FIRST_COMPLETED, wait
from pathlib import Path

from threadpoolctl import threadpool_limits

from study.config import Study, StudyError
from study.prepare import prepared
from study.realise import prepared_sources, realise
from study.results import write_results
from vsh.tools.files import atomic_write, exclusive, remove_unfinished
from vsh.tools.parallel import cores, ended_if_interrupted, process_pool, progress_bar, uninterrupted
from vsh.tools.printing import printable
from vsh.tools.types import PathName


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
        for each in ("prepared", *(f"realisations/{case['name']}" for case in study.cases)):
            (folder / each).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StudyError(f"{folder} cannot be made a folder: {error.strerror}") from error
    with exclusive(folder / "study.json"):
        return _run(study, folder, n_realisations, workers, progress)


def _run(study, folder, n_realisations, workers, progress):
    """The same while no other process works in the folder."""
    _claim(study, folder)
    count = n_realisations or study.n_realisations
    tasks = []
    for index, case in enumerate(study.cases):
        if study.mission["attitude"] == "solved":
            files = {"joint": prepared_sources(study, case, folder / "prepared", progress)}
        else:
            files = {
                kind: prepared(study, case, kind, folder / "prepared", progress) for kind in case if kind != "name"
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
                _one(study, folder, task)
                bar.update()
        return
    with bar, process_pool(min(workers, len(tasks))) as pool, ended_if_interrupted():
        waiting, left = {}, iter(tasks)
        for task in left:
            with uninterrupted():
                waiting[pool.submit(_one, study, folder, task)] = task
            if len(waiting) < 2 * workers:
                continue
            done, _ = wait(waiting, return_when=FIRST_COMPLETED)
            _collect(waiting, done, bar)
        while waiting:
            done, _ = wait(waiting, return_when=FIRST_COMPLETED)
            _collect(waiting, done, bar)


def _collect(waiting, done, bar):
    for future in done:
        waiting.pop(future)
        future.result()
        bar.update()


def _one(study, folder, task):
    """One realisation, in a process of its own: computed, and written whole."""
    index, files, number = task
    with threadpool_limits(1):
        outcome = realise(study, index, files, number)
    path = _path(folder, study.cases[index], number)
    with atomic_write(path) as new:
        new.write_text(json.dumps(outcome, indent=1), encoding="utf-8")


def _path(folder, case, number):
    return folder / "realisations" / case["name"] / f"{number:05d}.json"


def _check_folder(folder):
    """Raise StudyError if a folder holds anything but a study."""
    shown = printable(folder)
    if folder.exists() and not folder.is_dir():
        raise StudyError(f"{shown} is a file, not a folder")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / "study.json").is_file():
        raise StudyError(f"{shown} holds files that are no study's: name a new folder")


def _claim(study, folder):
    """Write the configuration into a new folder; compare it with that of an old one."""
    path, plain = folder / "study.json", study.plain()
    if not path.exists():
        with atomic_write(path) as new:
            new.write_text(json.dumps(plain, indent=1), encoding="utf-8")
        return
    try:
        old = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        raise StudyError(f"{path} is damaged: take another folder, or delete this one") from None
    differences = list(_differences(old, plain))
    if differences:
        raise StudyError(
            f"{folder} holds another study ({'; '.join(differences[:5])}): take another folder, or delete it"
        )


def _differences(old, new, where=""):
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted({*old, *new}):
            yield from _differences(old.get(key), new.get(key), f"{where}{'.' if where else ''}{key}")
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for i, pair in enumerate(zip(old, new, strict=True)):
            yield from _differences(*pair, f"{where}[{i}]")
    elif old != new:
        yield f"{where}: there {old}, here {new}"
