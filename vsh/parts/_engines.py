"""Where sums over parts are computed: here with threads, in a pool of processes, or by Dask."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any
from weakref import finalize

from vsh.checks.notebook import InNotebook
from vsh.errors import ParameterError, TableError
from vsh.parts._add import Tree, label_of
from vsh.system.parallel import process_pool, uninterrupted

#: A part alone in its process may end it so often before the part is blamed: the machine may have run out of memory.
ATTEMPTS = 2


class Engine(InNotebook):
    """What computes the sums of parts and adds them up in a fixed tree."""

    #: How many threads a sum may use where it is computed; None for one a core.
    threads: int | None = 1

    def total(self, work: Callable[[Any], Any], pieces: Sequence[Any], done: Callable[[], object]) -> Any:
        """The sum of `work` over the pieces.

        Parameters
        ----------
        work : function of a piece
            To anything that adds.
        pieces : sequence
            What parts are read from.
        done : function without arguments
            Called after every part.
        """
        raise NotImplementedError

    def fetched(self, piece: Any) -> Any:
        """A piece as something that can be read in this process.

        Parameters
        ----------
        piece : object
            What a part is read from.
        """
        return piece


class Here(Engine):
    """In this process, one part after the other, with as many threads as there are cores."""

    def __init__(self) -> None:
        self.threads = None

    def __str__(self) -> str:
        return "here"

    def total(self, work: Callable[[Any], Any], pieces: Sequence[Any], done: Callable[[], object]) -> Any:
        """The sum of `work` over the pieces."""
        tree = Tree()
        for piece in pieces:
            tree.add(work(piece))
            done()
        return tree.total()


class Processes(Engine):
    """In a pool of processes, each with one thread, a part at a time. They stay as long as the engine does.

    Parameters
    ----------
    workers : int
        How many.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._running: ProcessPoolExecutor | None = None
        self._worked = False

    def __str__(self) -> str:
        return f"by {self.workers} processes"

    def total(self, work: Callable[[Any], Any], pieces: Sequence[Any], done: Callable[[], object]) -> Any:
        """The sum of `work` over the pieces.

        Parameters
        ----------
        work, pieces, done
            As for `Engine.total`.

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
                f"this cannot be sent to other processes ({error}): functions must stand in a module that can be imported, "
                "not be a lambda or within another; or let Dask send them, with its own collections"
            ) from error
        tree = Tree()
        for leaf in self._in_order(work, pieces, done):
            tree.add(leaf)
        return tree.total()

    def _in_order(self, work, pieces, done) -> Iterator[Any]:
        """The results in the order of the pieces, however often a process is killed."""
        ready = {}
        waiting, suspects = list(range(len(pieces))), []
        following, single = 0, []
        while waiting or suspects:
            # After a process was killed, the parts that were under way go one by one: the guilty one is known then.
            if suspects:
                ready[suspects[0]] = self._alone(work, pieces, suspects[0], single)
                done()
                del suspects[0]
                if not suspects and single:
                    single.pop().shutdown()
            else:
                for number, result in self._together(work, pieces, waiting, suspects):
                    ready[number] = result
                    done()
                    while following in ready:
                        yield ready.pop(following)
                        following += 1
            while following in ready:
                yield ready.pop(following)
                following += 1

    def _together(self, work, pieces, waiting, suspects):
        """Numbers and results as they come; what a broken pool leaves undone goes to `suspects`."""
        running = {}
        if self._running is None:
            self._running = process_pool(self.workers)
            finalize(self, self._running.shutdown, wait=False, cancel_futures=True)
        try:
            while waiting or running:
                while waiting and len(running) < 2 * self.workers:
                    with uninterrupted():
                        running[self._running.submit(work, pieces[waiting[0]])] = waiting[0]
                    del waiting[0]
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    result = future.result()
                    self._worked = True
                    yield running.pop(future), result
        except BrokenProcessPool:
            suspects += sorted(running.values())
            self._running = None
        except BaseException:  # an interrupt, or a part that cannot be read: what waits is not begun
            for future in running:
                future.cancel()
            raise

    def _alone(self, work, pieces, number, single):
        """The result of one part by itself; `single` holds the process that is used again until a part ends it."""
        for _ in range(ATTEMPTS):
            if not single:
                single.append(process_pool(1))
            try:
                with uninterrupted():
                    future = single[0].submit(work, pieces[number])
                return future.result()
            except BrokenProcessPool:
                single.pop()
        name = f"part {number + 1} of {len(pieces)}, {label_of(pieces[number])}, ended the process that read it"
        script = 'A script that starts workers needs its work under `if __name__ == "__main__":`'
        memory = "is there memory enough for it? Take fewer workers, or smaller parts"
        if number == 0 and not self._worked:
            raise TableError(f"the processes end before they read anything. {script}. If it is there: {name}: {memory}")
        raise TableError(f"{name} {ATTEMPTS + 1} times: {memory}. ({script}.)")
