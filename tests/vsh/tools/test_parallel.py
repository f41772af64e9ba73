import subprocess
import sys

import pytest

from vsh.tools.parallel import end_worker_with_parent, map_blocks

POOL = """
import os, time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from vsh.tools.parallel import end_worker_with_parent
if __name__ == "__main__":
    with ProcessPoolExecutor(2, mp_context=get_context("spawn"), initializer=end_worker_with_parent) as pool:
        pool.submit(os.getpid).result(), pool.submit(os.getpid).result()
        print("begun", flush=True)
        time.sleep(600)
"""


def test_workers_leave_with_a_killed_parent(tmp_path):
    """The pipe's end comes when the last process that holds it is gone."""
    script = tmp_path / "pool.py"
    script.write_text(POOL)
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "begun\n"
        process.kill()
        assert process.communicate(timeout=60)[0] == ""


def test_outside_a_pool_there_is_no_parent():
    assert end_worker_with_parent() is None


@pytest.mark.parametrize("threads", [1, 2])
def test_blocks_come_in_order(threads):
    assert list(map_blocks(lambda s: (s.start, s.stop), 5, 2, threads)) == [(0, 2), (2, 4), (4, 5)]
