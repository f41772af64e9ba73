"""Sums by Dask: on its local threads, on processes, or on a cluster. The only file that knows it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any
from uuid import uuid4

from vsh.errors import ParameterError, TableError
from vsh.parts._add import BRANCHES, total_of
from vsh.parts._engines import Engine, label_of

_KEY = "vsh-part-"


def is_delayed(thing: Any) -> bool:
    """Whether an object is one value of Dask's that is computed when it is asked for, not a collection of them.

    Parameters
    ----------
    thing : object
        Any.
    """
    kind = type(thing)  # a delayed object itself has any attribute that is asked for
    return hasattr(kind, "__dask_graph__") and not hasattr(kind, "to_delayed")


@dataclass(frozen=True)
class Dask(Engine):
    """By Dask: on the cluster at an address, on the client that is open, or else on this machine.

    Attributes
    ----------
    address : str, optional
        Of a scheduler, tcp://host:8786; or the path of a scheduler file.
    workers : int, optional
        How many processes on this machine where there is no cluster; threads in this process unless given.
    """

    address: str | None = None
    workers: int | None = None

    def __str__(self) -> str:
        return f"by Dask{f' at {self.address}' if self.address else ''}"

    def total(self, work: Callable[[Any], Any], pieces: Sequence[Any], done: Callable[[], object]) -> Any:
        """The sum of `work` over the pieces.

        Parameters
        ----------
        work, pieces, done
            As for `Engine.total`.

        Raises
        ------
        TableError
            If a part ends every worker that reads it, or the scheduler cannot be reached.
        """
        if not pieces:
            return None
        dask = _dask()
        run = uuid4().hex[:12]
        leaf = dask.delayed(work, pure=False)
        level = [leaf(piece, dask_key_name=f"{_KEY}{i}-{run}") for i, piece in enumerate(pieces)]
        leaves = level
        while len(level) > 1:
            groups = [level[i : i + BRANCHES] for i in range(0, len(level), BRANCHES)]
            level = [dask.delayed(total_of, pure=False)(group) if len(group) > 1 else group[0] for group in groups]
        client, own = self._client()
        if client is None:
            return self._local(level[0], done)
        try:
            return _on_cluster(client, leaves, level[0], pieces, done)
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

    def _local(self, root, done):
        from dask.callbacks import Callback

        def after(key, *_):
            if str(key).startswith(_KEY):
                done()

        options = {"scheduler": "processes", "num_workers": self.workers} if self.workers else {"scheduler": "threads"}
        with Callback(posttask=after):
            return root.compute(**options)

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
            client is not None and self.address in (client.scheduler.address, client.scheduler_file)
        ):
            return client, False
        where = {"address": self.address} if "://" in self.address else {"scheduler_file": self.address}
        try:
            return distributed.Client(**where, timeout=20, set_as_default=False), True
        except (OSError, ValueError, TimeoutError) as error:
            raise TableError(
                f"the scheduler {self.address} cannot be reached: {error or type(error).__name__}"
            ) from error


def _on_cluster(client, leaves, root, pieces, done):
    from distributed import as_completed
    from distributed.scheduler import KilledWorker

    *futures, total = client.compute([*leaves, root])
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
    except KilledWorker as error:
        raise TableError(f"{_guilty(str(error.task), pieces)} ended every worker that computed it ({error})") from error
    finally:
        total.cancel()


def _guilty(key, pieces):
    for number, piece in enumerate(pieces):
        if key.startswith(f"{_KEY}{number}-") or key == getattr(piece, "key", None):
            return f"part {number + 1} of {len(pieces)}, {label_of(piece)},"
    return f"the task {key}"


def _dask():
    try:
        import dask
    except ImportError as error:
        raise ParameterError(
            f"parts of Dask, and schedulers, need it: pip install 'vsh-astrometry[dask]' ({error})"
        ) from error
    return dask
