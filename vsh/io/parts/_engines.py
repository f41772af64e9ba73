"""Where sums over parts are computed: here with threads, in a pool of processes, or by Dask.

Dask sums on its local threads, on processes, or on a cluster; no other file knows it.
"""

from __future__ import annotations

import json
import logging
import pickle
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, ThreadPoolExecutor, wait
from contextlib import closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4
from weakref import finalize

from vsh.field import Field
from vsh.tools import arguments
from vsh.tools.errors import (
    EmptyFieldError,
    EmptySelectionError,
    FieldError,
    ParameterError,
    TableError,
    VshError,
    first_line,
)
from vsh.tools.notebook import InNotebook
from vsh.tools.notes import merge_notes
from vsh.tools.parallel import delay_interrupts, limit_threads, prefetch_items, process_pool
from vsh.tools.printing import printable

#: So many sums are added up at a time, level by level.
BRANCHES = 8


def add_sums(first: Any, second: Any) -> Any:
    """Add two sums: None is nothing, dicts add key by key, tuples item by item, all else by `+`."""
    if first is None or second is None:
        return second if first is None else first
    if isinstance(first, dict):
        names = dict.fromkeys([*first, *second])
        return {key: add_sums(first.get(key), second.get(key)) for key in names}
    if isinstance(first, tuple):
        return tuple(add_sums(term, other_term) for term, other_term in zip(first, second, strict=True))
    return first + second


def sum_terms(terms: Iterable[Any]) -> Any:
    """Sum some terms, from the first to the last; None if there is none."""
    total = None
    for term in terms:
        total = add_sums(total, term)
    return total


class SumTree:
    """A sum that is taken eight at a time, level by level, whatever computes the leaves and wherever.

    Examples
    --------
    >>> tree = SumTree()
    >>> for leaf in range(100):
    ...     tree.add(leaf)
    >>> tree.total()
    4950
    """

    def __init__(self) -> None:
        self.levels: list[list[Any]] = [[]]

    def add(self, leaf: Any) -> None:
        """The next leaf, in the order of the parts."""
        level = 0
        while True:
            if level == len(self.levels):
                self.levels.append([])
            self.levels[level].append(leaf)
            if len(self.levels[level]) < BRANCHES:
                return
            leaf, self.levels[level] = sum_terms(self.levels[level]), []
            level += 1

    def total(self) -> Any:
        """The sum of all leaves; None if nothing was added."""
        carry: list[Any] = []
        for level in self.levels:
            nodes = level + carry
            carry = [sum_terms(nodes)] if nodes else []
        return carry[0] if carry else None


def label_piece(piece: Any) -> str:
    """Label a part as messages name it."""
    if hasattr(piece, "__fspath__") or isinstance(piece, str):
        return str(piece)
    key = getattr(piece, "key", None)
    return str(key) if key is not None else f"a {type(piece).__name__}"


#: A part alone in its process may end it so often before the part is blamed: the machine may have run out of memory.
ATTEMPTS = 2


class Engine(InNotebook):
    """Engine that computes the sums of parts and adds them up in a fixed tree."""

    #: How many threads a sum may use where it is computed; None for one a core.
    threads: int | None = 1

    def total(self, work: Callable[[Any], Any], pieces: Sequence[Any], done: Callable[[], object]) -> Any:
        """The sum of `work` over the pieces."""
        raise NotImplementedError

    def fetched(self, piece: Any) -> Any:
        """A piece as something that can be read in this process."""
        return piece


#: Blocks smaller than this are read without a thread that reads ahead, which costs more.
_WORTH_A_THREAD = 2**15


def _read_blocks_ahead(first_block, blocks):
    """A first block and those behind it, each read in a thread while the one before it is summed, if they are large."""
    if first_block is None:
        return
    yield first_block
    with closing(prefetch_items(blocks) if len(first_block) >= _WORTH_A_THREAD else blocks) as later_blocks:
        yield from later_blocks


class InProcess(Engine):
    """Engine in this process, one part after the other, with one thread per core.

    Parameters
    ----------
    readers : int
        So many threads read the first blocks of the parts that follow, while one is summed.
    """

    def __init__(self, readers: int = 0) -> None:
        self.threads, self.readers = None, readers

    def __str__(self) -> str:
        return "here"

    def total(self, work: Any, pieces: Sequence[Any], done: Callable[[], object]) -> Any:
        """The sum of `work` over the pieces."""
        tree = SumTree()
        with ThreadPoolExecutor(max(self.readers, 1)) as pool:  # which starts no thread before it is asked to
            begun_reads: deque[Future] = deque()
            try:
                for number, piece in enumerate(pieces):
                    if self.readers:
                        next_pieces = pieces[number + len(begun_reads) : number + 1 + self.readers]
                        begun_reads.extend(pool.submit(work.begin_reading, next_piece) for next_piece in next_pieces)
                    tree.add(work(piece, begun_reads.popleft() if begun_reads else None))
                    done()
            finally:
                pool.shutdown(cancel_futures=True)
        return tree.total()


class Processes(Engine):
    """Engine with a pool of processes, each with one thread, which stay as long as the engine does.

    Parameters
    ----------
    workers : int
        How many.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._pool: Any = None  # a pool of processes
        self._has_worked = False

    def __str__(self) -> str:
        return f"by {self.workers} processes"

    def total(self, work: Callable[[Any], Any], pieces: Sequence[Any], done: Callable[[], object]) -> Any:
        """The sum of `work` over the `pieces`, each reported by `done`, as for `Engine.total`.

        Raises
        ------
        ParameterError
            If the work cannot be sent to other processes.
        TableError
            If a part ends every process that reads it.
        """
        try:
            pickle.dumps(work)
        except Exception as error:  # whatever an object makes of being pickled
            raise ParameterError(
                f"this cannot be sent to other processes ({error}): functions must stand in a module that can be "
                "imported, not be a lambda or within another; or let Dask send them, with its own collections"
            ) from error
        tree = SumTree()
        for leaf in self._yield_results_in_order(work, pieces, done):
            tree.add(leaf)
        return tree.total()

    def _yield_results_in_order(self, work, pieces, callback) -> Iterator[Any]:
        """The results in the order of the pieces."""
        ready_results, next_number = {}, 0
        for number, result in self._run_despite_kills(work, pieces):
            ready_results[number] = result
            callback()
            while next_number in ready_results:
                yield ready_results.pop(next_number)
                next_number += 1

    def _run_despite_kills(self, work, pieces):
        """Numbers and results as they come, however often a process is killed."""
        waiting_numbers, suspect_numbers, single_pool = list(range(len(pieces))), [], []
        while waiting_numbers:
            yield from self._run_pieces_together(work, pieces, waiting_numbers, suspect_numbers)
            # After a process was killed, the parts that were under way go one by one: the guilty one is known then.
            for number in suspect_numbers:
                yield number, self._run_piece_alone(work, pieces, number, single_pool)
            suspect_numbers.clear()
            if single_pool:
                single_pool.pop().shutdown()

    def _run_pieces_together(self, work, pieces, waiting_numbers, suspect_numbers):
        """Numbers and results as they come; what a broken pool leaves undone goes to `suspect_numbers`."""
        number_by_future = {}
        if self._pool is None:
            self._pool = process_pool(self.workers)
            finalize(self, self._pool.shutdown, wait=False, cancel_futures=True)
        try:
            while waiting_numbers or number_by_future:
                while waiting_numbers and len(number_by_future) < 2 * self.workers:
                    with delay_interrupts():
                        number_by_future[self._pool.submit(work, pieces[waiting_numbers[0]])] = waiting_numbers[0]
                    del waiting_numbers[0]
                for future in wait(number_by_future, return_when=FIRST_COMPLETED).done:
                    result = future.result()
                    self._has_worked = True
                    yield number_by_future.pop(future), result
        except BrokenExecutor:
            suspect_numbers += sorted(number_by_future.values())
            self._pool = None
        except BaseException:  # an interrupt, or a part that cannot be read: what waits is not begun
            for future in number_by_future:
                future.cancel()
            raise

    def _run_piece_alone(self, work, pieces, number, single_pool):
        """The result of one part by itself; `single_pool` holds the process that is used again until a part ends it."""
        for _ in range(ATTEMPTS):
            if not single_pool:
                single_pool.append(process_pool(1))
            try:
                with delay_interrupts():
                    future = single_pool[0].submit(work, pieces[number])
                return future.result()
            except BrokenExecutor:
                single_pool.pop()
        name = f"part {number + 1} of {len(pieces)}, {label_piece(pieces[number])}, ended the process that read it"
        script = 'A script that starts workers needs its work under `if __name__ == "__main__":`'
        memory = "is there memory enough for it? Take fewer workers, or smaller parts"
        if number == 0 and not self._has_worked:
            raise TableError(f"the processes end before they read anything. {script}. If it is there: {name}: {memory}")
        raise TableError(f"{name} {ATTEMPTS + 1} times: {memory}. ({script}.)")


def apply_steps(steps: tuple[Callable[[Field], Field], ...], block: Field) -> tuple[Field | None, EmptyPartNotes]:
    """Apply the steps to a block: the sources that are left, or None, and notes on empty blocks."""
    field = block
    try:
        for step in steps:
            field = arguments.a(type(field))("what a step returns", step(field))
    except EmptyFieldError as error:  # there may be more in other blocks
        return None, EmptyPartNotes(error.notes)
    return (field, EmptyPartNotes()) if len(field) else (None, EmptyPartNotes(field.notes))


class EmptyPartNotes(list):
    """Notes of parts without a source; they add."""

    def __add__(self, other):
        return EmptyPartNotes(merge_notes(self, other))


def _label_error(piece, error):
    """Add the name of a part to the message of an error, unless it is there."""
    label = label_piece(piece)
    return str(error) if label in str(error) or isinstance(piece, Field) else f"{label}: {error}"


def _make_unusable_rows_error(piece, error):
    """Make the error of a part all of whose rows are bad, with what can be done."""
    unusable = EmptyFieldError(f'{_label_error(piece, error)}. Leave them out with on_bad="drop" (--on-bad drop)')
    unusable.notes = error.notes
    return unusable


@dataclass(frozen=True)
class PartSum:
    """The sum over one part: (sum, notes of what had no sources, number of sources)."""

    read: Callable[[Any, tuple[str, ...]], Iterator[Field]]
    steps: tuple[Callable[[Field], Field], ...]
    function: Callable[[Field], Any]
    roles: tuple[str, ...]
    threads: int | None

    def begin_reading(self, piece: Any) -> tuple[Field | None, Iterator[Field]]:
        """The first block of a piece, if there is one, and an iterator over the others."""
        blocks = self.read(piece, self.roles)
        return next(blocks, None), blocks

    def __call__(self, piece: Any, begun_read: Future | None = None) -> Any:
        """The sum over a piece, of which the first block may be read already."""
        total, notes, n_sources = None, EmptyPartNotes(), 0
        with limit_threads(self.threads):
            try:
                for block in _read_blocks_ahead(*(begun_read.result() if begun_read else self.begin_reading(piece))):
                    field, empty_notes = apply_steps(self.steps, block)
                    notes = notes + empty_notes
                    if field is not None:
                        total, n_sources = add_sums(total, self.function(field)), n_sources + len(field)
            except EmptyFieldError as error:  # of the whole part: a reader hands on what is lost of some of it
                is_empty_selection = isinstance(error, EmptySelectionError)  # other parts may hold some
                if error.notes and not is_empty_selection and getattr(self.read, "on_bad", "drop") == "raise":
                    raise _make_unusable_rows_error(piece, error) from error
                notes = notes + EmptyPartNotes(error.notes)
            except (FieldError, TableError) as error:
                raise type(error)(_label_error(piece, error)) from error
            except VshError:
                raise
            except Exception as error:  # of a step or of what is summed
                error.add_note(f"in the part {label_piece(piece)}")
                raise
        return total, notes, n_sources


#: How long a scheduler may take to answer. [s]
PATIENCE = 20
_KEY_PREFIX = "vsh-part-"


def is_delayed(value: Any) -> bool:
    """Return whether an object is one value of Dask's that is computed when it is asked for, not a collection of
    them."""
    cls = type(value)  # a delayed object itself has any attribute that is asked for
    return hasattr(cls, "__dask_graph__") and not hasattr(cls, "to_delayed")


@dataclass(frozen=True)
class Dask(Engine):
    """Engine by Dask: on the cluster at an address, on the client that is open, or else on this machine.

    Attributes
    ----------
    address : str, optional
        Address of a scheduler, tcp://host:8786; or the path of a scheduler file.
    workers : int, optional
        How many processes on this machine where there is no cluster; threads in this process unless given.
    """

    address: str | None = None
    workers: int | None = None

    def __str__(self) -> str:
        return f"by Dask{f' at {self.address}' if self.address else ''}"

    def total(self, work: Callable[[Any], Any], pieces: Sequence[Any], done: Callable[[], object]) -> Any:
        """The sum of `work` over the `pieces`, each reported by `done`, as for `Engine.total`.

        Raises
        ------
        TableError
            If a part ends every worker that reads it, or the scheduler cannot be reached.
        """
        if not pieces:
            return None
        with self._open_client() as client:
            if client is None:
                return self._sum_locally(work, pieces, done)
            return _sum_on_cluster(client, work, pieces, done)

    def fetched(self, piece: Any) -> Any:
        """A piece as something that can be read in this process.

        Parameters
        ----------
        piece : object
            What a part is read from.
        """
        if not is_delayed(piece):
            return piece
        with self._open_client() as client:
            return client.compute(piece).result() if client else piece.compute(scheduler="threads")

    def _sum_locally(self, work, pieces, callback):
        delayed_total = _delay_sum_tree(_delay_piece_sums(work, pieces))
        from dask.callbacks import Callback

        def report_part(key, *_):
            if str(key).startswith(_KEY_PREFIX):
                callback()

        options = {"scheduler": "processes", "num_workers": self.workers} if self.workers else {"scheduler": "threads"}
        with Callback(posttask=report_part):
            return _run_with_translated_errors(lambda: delayed_total.compute(**options), pieces)

    def _open_client(self):
        """Open a context with a client, which is closed if it was opened here; with None where there is no cluster."""
        try:
            import distributed
        except ImportError as error:
            if self.address:
                raise TableError(
                    f"a scheduler needs dask.distributed: pip install 'vsh-astrometry[dask]' ({error})"
                ) from error
            return nullcontext()
        try:
            client: Any = distributed.get_client()
        except ValueError:
            client = None
        scheduler = getattr(client, "scheduler", None)
        is_same_scheduler = scheduler is not None and self.address in (scheduler.address, client.scheduler_file)
        if self.address is None or is_same_scheduler:
            return nullcontext(client)
        is_scheduler_file = "://" not in self.address
        if is_scheduler_file and not Path(self.address).is_file():  # for which Dask would wait for ever
            raise TableError(f"{self.address} is neither an address such as tcp://host:8786 nor a scheduler file")
        if is_scheduler_file:
            _check_scheduler_file(self.address)
        scheduler_option = {"scheduler_file" if is_scheduler_file else "address": self.address}
        try:
            with _silence_log("distributed"):  # which tells what it tries meanwhile
                return closing(distributed.Client(**scheduler_option, timeout=PATIENCE, set_as_default=False))
        except (OSError, ValueError, TimeoutError) as error:
            raise TableError(
                f"the scheduler {self.address} cannot be reached: {str(error) or type(error).__name__}"
            ) from error


def _check_scheduler_file(path):
    """Raise TableError where a file names no scheduler: Dask would wait for one."""
    try:
        with open(path, encoding="utf-8") as file:
            address = json.load(file)["address"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        address = None
    if not isinstance(address, str):
        raise TableError(f"{printable(path)} is no file of a scheduler: Dask writes one, with its address in it")


@contextmanager
def _silence_log(logger_name):
    logger = logging.getLogger(logger_name)
    level = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(level)


def _delay_piece_sums(work, pieces):
    """Delay the sums of the parts; under new names, so that nothing that failed is remembered."""
    delayed_work, run_id = _import_dask().delayed(work, pure=False), uuid4().hex[:12]
    return [delayed_work(piece, dask_key_name=f"{_KEY_PREFIX}{i}-{run_id}") for i, piece in enumerate(pieces)]


def _delay_sum_tree(level):
    """Delay the tree of sums over some delayed ones."""
    add = _import_dask().delayed(sum_terms, pure=False)
    while len(level) > 1:
        groups = [level[i : i + BRANCHES] for i in range(0, len(level), BRANCHES)]
        level = [add(group) if len(group) > 1 else group[0] for group in groups]
    return level[0]


def _sum_on_cluster(client, work, pieces, callback):
    from distributed.scheduler import KilledWorker

    leaves = _delay_piece_sums(work, pieces)
    try:
        return _run_with_translated_errors(lambda: _gather_total(client, leaves, callback), pieces)
    except KilledWorker as error:
        key = str(error.task)
    # Parts that waited at the same worker are blamed too. Alone, the guilty one does it again, and it alone.
    numbers = range(len(pieces))
    suspects = [i for i in numbers if key in (leaves[i].key, getattr(pieces[i], "key", None))]
    for number in [*suspects, *(i for i in numbers if i not in suspects)]:
        try:
            client.compute(_delay_piece_sums(work, [pieces[number]])[0]).result()
        except KilledWorker as error:
            part_label = f"part {number + 1} of {len(pieces)}, {label_piece(pieces[number])}"
            raise TableError(f"{part_label}, ended every worker that computed it ({error})") from error
    try:
        return _gather_total(client, _delay_piece_sums(work, pieces), lambda: None)
    except KilledWorker as error:
        raise TableError(f"workers ended while they computed {error.task} ({error})") from error


def _describe_failing_part(pieces):
    """Describe the part whose own graph raises; with the error itself, or None."""
    for number, piece in enumerate(pieces):
        if is_delayed(piece):
            try:
                piece.compute(scheduler="threads")
            except Exception as error:  # whatever the graph of a part raises
                return f"part {number + 1} of {len(pieces)} cannot be computed", error
    return "a part cannot be computed", None


def _run_with_translated_errors(compute, pieces):
    """Convert an error of Dask's own graph into one of ours."""
    untranslated_errors: tuple[type[BaseException], ...] = (VshError, MemoryError)
    with suppress(ImportError):  # Dask's own threads and processes do without
        from distributed.scheduler import KilledWorker

        untranslated_errors = (*untranslated_errors, KilledWorker)
    try:
        return compute()
    except untranslated_errors:
        raise
    except Exception as error:  # whatever the graph of a part raises
        message, cause = _describe_failing_part(pieces)
        raise TableError(f"{message}: {type(cause or error).__name__}: {first_line(cause or error)}") from error


def _gather_total(client, leaves, callback):
    from distributed import as_completed

    *futures, total = client.compute([*leaves, _delay_sum_tree(leaves)])
    # Each is let go when it is done: the tree keeps what it still needs.
    completed_futures = as_completed(futures, loop=client.loop)
    del futures
    try:
        for future in completed_futures:
            if future.status == "error":
                break
            callback()
            del future
        return total.result()
    finally:
        total.cancel()


def _import_dask():
    try:
        import dask
    except ImportError as error:
        raise ParameterError(
            f"parts of Dask, and schedulers, need it: pip install 'vsh-astrometry[dask]' ({error})"
        ) from error
    return dask


#: A catalogue of LSDB whose wanted columns take less is kept in memory between passes. [bytes]
KEPT = 2**30


def delay_partitions(collection: Any, columns: Sequence[str]) -> list[Any]:
    """Delay the partitions of a collection of Dask or LSDB, with some columns of it.

    LSDB reads all columns of a catalogue that was opened with them, and chooses then: as long as nothing else was done
    to it, it is opened again with those that are expected. What fits into a gibibyte is read once, and kept for the
    passes to come.
    """
    names = list(dict.fromkeys(columns))
    operation = getattr(collection, "_operation", None)
    if operation is None:
        return collection[names].to_delayed()
    import dask

    structure = getattr(collection, "hc_structure", None)
    n_rows = getattr(getattr(structure, "catalog_info", None), "total_rows", None)
    catalogue = _reopen_catalogue(collection, operation, structure, names)
    partitions = (collection[names] if catalogue is None else catalogue).to_delayed()
    fits_memory = n_rows and 8 * int(n_rows) * len(names) <= KEPT
    return list(dask.persist(*partitions)) if fits_memory else partitions


def _reopen_catalogue(collection, operation, structure, names):
    """Open a catalogue of LSDB as it was opened, with fewer columns; None where something else was done to it."""
    path = getattr(structure, "catalog_path", None)
    if path is None or type(operation).__name__ != "FromHealpixMap" or set(names) == set(collection.columns):
        return None
    try:
        import lsdb

        catalogue = lsdb.open_catalog(path, columns=names)
        return catalogue if catalogue.get_healpix_pixels() == collection.get_healpix_pixels() else None
    except Exception:  # another version of LSDB, or files that went: all columns are read then
        return None
