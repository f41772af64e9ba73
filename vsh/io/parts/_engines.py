"""Where sums over parts are computed: here with threads, in a pool of processes, or by Dask."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, wait
from dataclasses import dataclass
from typing import Any
from weakref import finalize

from vsh.field import Field
from vsh.tools import arguments
from vsh.tools.errors import FieldError, NothingLeftError, NothingSelectedError, ParameterError, TableError, VshError
from vsh.tools.notebook import InNotebook
from vsh.tools.notes import merge_notes
from vsh.tools.parallel import limited, process_pool, uninterrupted

#: So many sums are added up at a time, level by level.
BRANCHES = 8


def added(first: Any, second: Any) -> Any:
    """Two sums as one: None is nothing, dicts add key by key, tuples item by item, all else by `+`."""
    if first is None or second is None:
        return second if first is None else first
    if isinstance(first, dict):
        keys = dict.fromkeys([*first, *second])
        return {key: added(first.get(key), second.get(key)) for key in keys}
    if isinstance(first, tuple):
        return tuple(added(one, two) for one, two in zip(first, second, strict=True))
    return first + second


def total_of(some: Iterable[Any]) -> Any:
    """The sum of a few, from the first to the last; None if there is none."""
    total = None
    for each in some:
        total = added(total, each)
    return total


class Tree:
    """A sum that is taken eight at a time, level by level, whatever computes the leaves and wherever.

    Examples
    --------
    >>> tree = Tree()
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
            leaf, self.levels[level] = total_of(self.levels[level]), []
            level += 1

    def total(self) -> Any:
        """The sum of all leaves; None if nothing was added."""
        carried: list[Any] = []
        for level in self.levels:
            nodes = level + carried
            carried = [total_of(nodes)] if nodes else []
        return carried[0] if carried else None


def label_of(piece: Any) -> str:
    """What a message calls a part."""
    if hasattr(piece, "__fspath__") or isinstance(piece, str):
        return str(piece)
    key = getattr(piece, "key", None)
    return str(key) if key is not None else f"a {type(piece).__name__}"


#: A part alone in its process may end it so often before the part is blamed: the machine may have run out of memory.
ATTEMPTS = 2


class Engine(InNotebook):
    """What computes the sums of parts and adds them up in a fixed tree."""

    #: How many threads a sum may use where it is computed; None for one a core.
    threads: int | None = 1

    def total(self, work: Callable[[Any], Any], pieces: Sequence[Any], done: Callable[[], object]) -> Any:
        """The sum of `work` over the pieces."""
        raise NotImplementedError

    def fetched(self, piece: Any) -> Any:
        """A piece as something that can be read in this process."""
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
        self._running: Any = None  # a pool of processes
        self._worked = False

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
        except BrokenExecutor:
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
            except BrokenExecutor:
                single.pop()
        name = f"part {number + 1} of {len(pieces)}, {label_of(pieces[number])}, ended the process that read it"
        script = 'A script that starts workers needs its work under `if __name__ == "__main__":`'
        memory = "is there memory enough for it? Take fewer workers, or smaller parts"
        if number == 0 and not self._worked:
            raise TableError(f"the processes end before they read anything. {script}. If it is there: {name}: {memory}")
        raise TableError(f"{name} {ATTEMPTS + 1} times: {memory}. ({script}.)")


def _through(steps, field):
    for step in steps:
        field = arguments.a(Field)("what a step returns", step(field))
    return field


def left_by(steps: tuple[Callable[[Field], Field], ...], block: Field) -> tuple[Field | None, LostNotes]:
    """What the steps leave of a block, None for nothing; and notes on what had no sources."""
    try:
        field = _through(steps, block)
    except NothingLeftError as error:  # there may be more in other blocks
        return None, LostNotes(error.notes)
    return (field, LostNotes()) if len(field) else (None, LostNotes(field.notes))


class LostNotes(list):
    """Notes of parts without a source; they add."""

    def __add__(self, other):
        return LostNotes(merge_notes(self, other))


def _named(piece, error):
    """What an error says, with the file that it is about."""
    name = label_of(piece)
    return str(error) if name in str(error) or isinstance(piece, Field) else f"{name}: {error}"


def _left_out(piece, error):
    """The error of a part all of whose rows are bad, with what can be done."""
    empty = NothingLeftError(f'{_named(piece, error)}. Leave them out with on_bad="drop" (--on-bad drop)')
    empty.notes = error.notes
    return empty


@dataclass(frozen=True)
class Work:
    """The sum over one part: (sum, notes of what had no sources, number of sources)."""

    read: Callable[[Any, tuple[str, ...]], Iterator[Field]]
    steps: tuple[Callable[[Field], Field], ...]
    function: Callable[[Field], Any]
    roles: tuple[str, ...]
    threads: int | None

    def __call__(self, piece: Any) -> Any:
        """The sum."""
        total, notes, sources = None, LostNotes(), 0
        with limited(self.threads):
            try:
                for block in self.read(piece, self.roles):
                    field, lost = left_by(self.steps, block)
                    notes = notes + lost
                    if field is not None:
                        total, sources = added(total, self.function(field)), sources + len(field)
            except NothingLeftError as error:  # of the whole part: a reader hands on what is lost of some of it
                chosen = isinstance(error, NothingSelectedError)  # other parts may hold some
                if error.notes and not chosen and getattr(self.read, "on_bad", "drop") == "raise":
                    raise _left_out(piece, error) from error
                notes = notes + LostNotes(error.notes)
            except FieldError as error:
                raise FieldError(_named(piece, error)) from error
            except TableError as error:
                raise TableError(_named(piece, error)) from error
            except VshError:
                raise
            except Exception as error:  # of a step or of what is summed
                error.add_note(f"in the part {label_of(piece)}")
                raise
        return total, notes, sources
