"""Sums by Dask: on its local threads, on processes, or on a cluster. The only file that knows it."""

import json
import logging
from collections.abc import Callable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

from vsh.io.parts._engines import BRANCHES, Engine, label_of, total_of
from vsh.tools.errors import ParameterError, TableError, VshError, first_line
from vsh.tools.printing import printable

#: How long a scheduler may take to answer. [s]
PATIENCE = 20
_KEY = "vsh-part-"


def is_delayed(thing: Any) -> bool:
    """Whether an object is one value of Dask's that is computed when it is asked for, not a collection of them."""
    kind = type(thing)  # a delayed object itself has any attribute that is asked for
    return hasattr(kind, "__dask_graph__") and not hasattr(kind, "to_delayed")


@dataclass(frozen=True)
class Dask(Engine):
    """By Dask: on the cluster at an address, on the client that is open, or else on this machine.

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
        client, own = self._client()
        if client is None:
            return self._local(work, pieces, done)
        try:
            return _on_cluster(client, work, pieces, done)
        finally:
            if own:
                client.close()

    def fetched(self, piece: Any) -> Any:
        """A piece as something that can be read in this process.

        Parameters
        ----------
        piece : object
            What a part is read from.
        """
        if not is_delayed(piece):
            return piece
        client, own = self._client()
        try:
            return client.compute(piece).result() if client else piece.compute(scheduler="threads")
        finally:
            if own:
                client.close()

    def _local(self, work, pieces, done):
        root = _grown(_leaves(work, pieces))
        from dask.callbacks import Callback

        def after(key, *_):
            if str(key).startswith(_KEY):
                done()

        options = {"scheduler": "processes", "num_workers": self.workers} if self.workers else {"scheduler": "threads"}
        with Callback(posttask=after):
            return _in_our_words(lambda: root.compute(**options), lambda: _first_that_fails(pieces))

    def _client(self):
        """A client and whether it was opened here; None where there is no cluster."""
        try:
            import distributed
        except ImportError as error:
            if self.address:
                raise TableError(
                    f"a scheduler needs dask.distributed: pip install 'vsh-astrometry[dask]' ({error})"
                ) from error
            return None, False
        try:
            client = distributed.get_client()
        except ValueError:
            client = None
        if self.address is None or (
            client is not None
            and client.scheduler is not None
            and self.address in (client.scheduler.address, client.scheduler_file)
        ):
            return client, False
        file = "://" not in self.address
        if file and not Path(self.address).is_file():  # for which Dask would wait for ever
            raise TableError(f"{self.address} is neither an address such as tcp://host:8786 nor a scheduler file")
        if file:
            _check_scheduler_file(self.address)
        where = {"scheduler_file" if file else "address": self.address}
        try:
            with _without_log("distributed"):  # which tells what it tries meanwhile
                return distributed.Client(**where, timeout=PATIENCE, set_as_default=False), True
        except (OSError, ValueError, TimeoutError) as error:
            raise TableError(
                f"the scheduler {self.address} cannot be reached: {error or type(error).__name__}"
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
def _without_log(name):
    logger = logging.getLogger(name)
    before = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(before)


def _leaves(work, pieces):
    """The sums of the parts, delayed; under new names, so that nothing that failed is remembered."""
    leaf, run = _dask().delayed(work, pure=False), uuid4().hex[:12]
    return [leaf(piece, dask_key_name=f"{_KEY}{i}-{run}") for i, piece in enumerate(pieces)]


def _grown(level):
    """The tree over them, delayed."""
    add = _dask().delayed(total_of, pure=False)
    while len(level) > 1:
        groups = [level[i : i + BRANCHES] for i in range(0, len(level), BRANCHES)]
        level = [add(group) if len(group) > 1 else group[0] for group in groups]
    return level[0]


def _on_cluster(client, work, pieces, done):
    from distributed.scheduler import KilledWorker

    leaves = _leaves(work, pieces)
    try:
        return _in_our_words(lambda: _gathered(client, leaves, done), lambda: _first_that_fails(pieces))
    except KilledWorker as error:
        key = str(error.task)
    # Parts that waited at the same worker are blamed too. Alone, the guilty one does it again, and it alone.
    numbers = range(len(pieces))
    blamed = [i for i in numbers if key in (leaves[i].key, getattr(pieces[i], "key", None))]
    for number in [*blamed, *(i for i in numbers if i not in blamed)]:
        try:
            client.compute(_leaves(work, [pieces[number]])[0]).result()
        except KilledWorker as error:
            name = f"part {number + 1} of {len(pieces)}, {label_of(pieces[number])}"
            raise TableError(f"{name}, ended every worker that computed it ({error})") from error
    try:
        return _gathered(client, _leaves(work, pieces), lambda: None)
    except KilledWorker as error:
        raise TableError(f"workers ended while they computed {error.task} ({error})") from error


def _first_that_fails(pieces):
    """Which part's own graph raises, and a word on it."""
    for number, piece in enumerate(pieces):
        if is_delayed(piece):
            try:
                piece.compute(scheduler="threads")
            except Exception as error:  # whatever the graph of a part raises
                return f"part {number + 1} of {len(pieces)} cannot be computed", error
    return "a part cannot be computed", None


def _in_our_words(compute, guilty):
    """What a graph of Dask's own raises before a part is ours to read, as an error of ours."""
    from distributed.scheduler import KilledWorker

    try:
        return compute()
    except (VshError, KilledWorker, MemoryError):
        raise
    except Exception as error:  # whatever the graph of a part raises
        words, own = guilty()
        raise TableError(f"{words}: {type(own or error).__name__}: {first_line(own or error)}") from error


def _gathered(client, leaves, done):
    from distributed import as_completed

    *futures, total = client.compute([*leaves, _grown(leaves)])
    # Each is let go when it is done: the tree keeps what it still needs.
    finished = as_completed(futures, loop=client.loop)
    del futures
    try:
        for future in finished:
            if future.status == "error":
                break
            done()
            del future
        return total.result()
    finally:
        total.cancel()


def _dask():
    try:
        import dask
    except ImportError as error:
        raise ParameterError(
            f"parts of Dask, and schedulers, need it: pip install 'vsh-astrometry[dask]' ({error})"
        ) from error
    return dask


#: A catalogue of LSDB whose wanted columns take less is kept in memory between passes. [bytes]
KEPT = 2**30


def delayed_of(collection: Any, columns: Sequence[str]) -> list[Any]:
    """Some columns of a collection of Dask or LSDB, as delayed partitions.

    LSDB reads all columns of a catalogue that was opened with them, and chooses then: as long as nothing else was done
    to it, it is opened again with those that are wanted. What fits into a gibibyte is read once, and kept for the
    passes to come.
    """
    wanted = list(dict.fromkeys(columns))
    operation = getattr(collection, "_operation", None)
    if operation is None:
        return collection[wanted].to_delayed()
    import dask

    structure = getattr(collection, "hc_structure", None)
    rows = getattr(getattr(structure, "catalog_info", None), "total_rows", None)
    chosen = _opened_again(collection, operation, structure, wanted)
    delayed = (collection[wanted] if chosen is None else chosen).to_delayed()
    fits = rows and 8 * int(rows) * len(wanted) <= KEPT
    return list(dask.persist(*delayed)) if fits else delayed


def _opened_again(collection, operation, structure, wanted):
    """A catalogue of LSDB as it was opened, with fewer columns; None where something else was done to it."""
    path = getattr(structure, "catalog_path", None)
    if path is None or type(operation).__name__ != "FromHealpixMap" or set(wanted) == set(collection.columns):
        return None
    try:
        import lsdb

        again = lsdb.open_catalog(path, columns=wanted)
        return again if again.get_healpix_pixels() == collection.get_healpix_pixels() else None
    except Exception:  # another version of LSDB, or files that went: all columns are read then
        return None
