"""Work on many sources, a block at a time, on all cores, compiled where numba is installed; and free memory."""

import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, suppress
from contextvars import ContextVar
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeVar

from threadpoolctl import ThreadpoolController

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor  # imported where processes begin: few commands start any
from importlib.util import find_spec

resource: Any
try:
    import resource
except ImportError:  # Windows
    resource = None

T = TypeVar("T")
_HIDDEN: ContextVar[bool] = ContextVar("hidden", default=False)
#: Seconds before a bar or a line of progress is shown.
_DELAY = 2.0


@contextmanager
def set_variable_meanwhile(variable: ContextVar[T], value: T) -> Iterator[None]:
    """Meanwhile a variable of the context has a value."""
    token = variable.set(value)
    try:
        yield
    finally:
        variable.reset(token)


def without_progress_bars(hidden: bool = True) -> AbstractContextManager[None]:
    """No progress bar is shown meanwhile."""
    return set_variable_meanwhile(_HIDDEN, hidden or _HIDDEN.get())


def progress_bar(
    items: Iterable[Any] | None = None,
    total: int | None = None,
    words: str | None = None,
    shown: bool = True,
    unit: str = "it",
    **options: Any,
) -> Any:
    """A tqdm bar on stderr; none in a log file or a pipe."""
    if not (shown and not _HIDDEN.get() and sys.stderr is not None and sys.stderr.isatty()):
        return _NoBar(items)
    from tqdm import tqdm

    return tqdm(items, total=total, desc=words or None, delay=_DELAY, unit=unit, dynamic_ncols=True, **options)


#: What is at work, the innermost last; and how to end the line that tells it.
_STEPS: list[str] = ["at work"]
_ENDS: list[Callable[[], object]] = []


@contextmanager
def name_step(step_name: str) -> Iterator[None]:
    """Meanwhile the line of `show_elapsed_time` says that this is at work."""
    _STEPS.append(step_name)
    try:
        yield
    finally:
        _STEPS.pop()


@contextmanager
def show_elapsed_time(program: str) -> Iterator[None]:
    """After two seconds a line on stderr tells what a program does, until `hide_elapsed_time` or the block's end."""
    bar, has_ended = progress_bar(bar_format="{desc}: {elapsed}", leave=False), threading.Event()

    def update_line():
        while not has_ended.wait(0.5):
            bar.set_description_str(f"{program}, {_STEPS[-1]}", refresh=False)
            bar.update(0)
        bar.close()

    thread = threading.Thread(target=update_line, daemon=True)
    if not isinstance(bar, _NoBar):
        thread.start()
        _ENDS[:] = [has_ended.set, thread.join]
    try:
        yield
    finally:
        hide_elapsed_time()


def hide_elapsed_time() -> None:
    """Take the line of `show_elapsed_time` away, before something is printed."""
    while _ENDS:
        _ENDS.pop(0)()


class _NoBar:
    """Stand-in for a progress bar that nobody sees."""

    def __init__(self, items: Iterable[Any] | None) -> None:
        self._things = items

    def __iter__(self) -> Iterator[Any]:
        return iter(() if self._things is None else self._things)

    def __enter__(self) -> "_NoBar":
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *words, **options: None


_END: Any = object()
#: Rows of matrices from which on several threads are faster than one.
_MANY_ROWS = 500
#: What `limit_threads` set.
_THREAD_LIMIT: ContextVar[int | None] = ContextVar("threads", default=None)


def limit_threads(threads: int | None = None) -> AbstractContextManager[None]:
    """Within it, that many threads at most unless a function is told otherwise."""
    return set_variable_meanwhile(_THREAD_LIMIT, threads)


def thread_count(threads: int | None = None) -> int:
    """Number of threads to use: `threads`, the limit that is set, or one for each core this process may run on."""
    n_threads = threads or _THREAD_LIMIT.get()
    if n_threads:
        return n_threads
    affinity = getattr(os, "sched_getaffinity", None)  # not on macOS and Windows
    return len(affinity(0)) if affinity else (os.cpu_count() or 1)


def end_worker_with_parent() -> None:
    """The initialiser of a pool of processes: a worker ends with its parent, where it would wait for work for ever."""
    from multiprocessing import parent_process

    parent = parent_process()
    if parent is None:
        return

    def end_after_parent():
        parent.join()
        os._exit(1)

    threading.Thread(target=end_after_parent, daemon=True).start()


def process_pool(workers: int) -> "ProcessPoolExecutor":
    """Processes that leave an interrupt to their parent, and end with it; submit to them within `delay_interrupts`."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    # Spawned, not forked: the threads of NumPy and Arrow do not survive a fork.
    return ProcessPoolExecutor(workers, get_context("spawn"), _initialise_worker)


def _initialise_worker():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_worker_with_parent()


@contextmanager
def delay_interrupts() -> Iterator[None]:
    """Processes that start within it never see an interrupt; this one sees it afterwards."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    previous_mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, previous_mask)


def prefetch_items(items: Iterator[T]) -> Generator[T, None, None]:
    """Iterate over items, each made in a thread while the one before it is used."""
    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(next, items, _END)
        while (item := future.result()) is not _END:
            future = pool.submit(next, items, _END)
            yield item


@lru_cache
def _make_thread_controller():
    return ThreadpoolController()  # looks through all that is loaded, once


@contextmanager
def limit_blas(n_rows: int) -> Iterator[None]:
    """Within it BLAS works on small matrices in one thread: several would wait for each other longer than they work."""
    if n_rows > _MANY_ROWS:
        yield
        return
    with _make_thread_controller().limit(limits=1, user_api="blas"):
        yield


def map_blocks(
    function: Callable[[slice], T], n: int, block_size: int, threads: int | None = None, progress: str | None = None
) -> Iterator[T]:
    """Yield function(slice) for consecutive slices of `block_size` out of `n`, in order.

    NumPy lets go of the interpreter inside its loops, so threads suffice. The blocks share the cores, so BLAS is held
    to one thread meanwhile: left alone, the two fight for the cores and a sum takes ten times as long. At most two
    results a thread are waiting at any time, however many blocks there are.
    """
    slices = [slice(start, min(start + block_size, n)) for start in range(0, n, block_size)]
    threads = min(thread_count(threads), len(slices))
    bar = progress_bar(total=n, words=progress, shown=progress is not None, unit=" sources")
    with bar, _make_thread_controller().limit(limits=1, user_api="blas"):
        if threads <= 1:
            for block in slices:
                yield function(block)
                bar.update(block.stop - block.start)
            return
        with ThreadPoolExecutor(threads) as pool:
            waiting_results = deque()
            for block in slices:
                waiting_results.append((block, pool.submit(function, block)))
                if len(waiting_results) >= 2 * threads:
                    finished_block, future = waiting_results.popleft()
                    yield future.result()
                    bar.update(finished_block.stop - finished_block.start)
            for finished_block, future in waiting_results:
                yield future.result()
                bar.update(finished_block.stop - finished_block.start)


GIB = 2**30


def free_memory() -> float:
    """Bytes that this process may still use: what the machine has left, and what a limit on the process leaves."""
    limits = [float("inf")]
    with suppress(OSError, ValueError):  # Linux counts what it could let go of as well
        with open("/proc/meminfo", encoding="ascii") as file:
            lines = dict(line.split(":") for line in file)
        limits.append(1024.0 * int(lines["MemAvailable"].split()[0]))
    with suppress(AttributeError, ValueError, OSError):  # others tell no more than what they have
        if len(limits) == 1:
            limits.append(float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE"))
    limits.append(_find_memory_below_limit())
    return min(limits)


def _find_memory_below_limit():
    if resource is None:
        return float("inf")
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY:
        return float("inf")
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            usage = int(file.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        usage = 0
    return max(0.0, float(limit - usage))


def compile_loops(**options: Any) -> Callable[[Any], Any]:
    """Compile with numba, free of the interpreter's lock, and keep it on disk where there is a folder to write to."""
    from numba import njit

    def compile_function(function):
        try:
            return njit(function, cache=True, nogil=True, **options)
        except RuntimeError:
            return njit(function, nogil=True, **options)

    return compile_function


def has_numba() -> bool:
    """Return whether numba is installed."""
    return find_spec("numba") is not None
