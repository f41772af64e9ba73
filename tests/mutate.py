"""Break the code in the places that matter most, one at a time, in a copy: does a test find each?

`python tests/mutate.py` plants every break, runs the tests named beside it and prints which were found; it ends
with status 1 if one was not, or if a place to break is not there any more. `python tests/mutate.py 3 7` runs some.

`python tests/mutate.py --random 120 --seed 5` draws the places instead, evenly by lines of code: an operator, a number, a
condition or a default is changed, and the quick tests that run this line, the quickest first, have to notice; where none
does, those of the folder and those that name the function. Which tests run which line is measured once, by a run of the
quick tests under coverage. It prints what survived, which somebody has to judge: some changes make no difference.
"""

import argparse
import ast
import collections
import concurrent.futures
import os
import queue
import random
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import coverage
import pytest
from breaks import BREAKS

ROOT = Path(__file__).resolve().parents[1]


def _path_of(test):
    """Where a file of tests is, perhaps with the name of one of its tests."""
    name, *rest = test.split("::")
    found = next((ROOT / "tests").rglob(name)).relative_to(ROOT).as_posix()
    return "::".join([found, *rest])


#: What an operator becomes.
SWAPS = {
    ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==", ast.Is: "is not",
    ast.IsNot: "is", ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.Pow: "*", ast.And: "or", ast.Or: "and",
}  # fmt: skip
#: What only draws or says something.
HARMLESS = re.compile(r"_plot|plot/|page/|figures|printing|notebook|parsing|_text\.py|errors\.py")


def mutants(source):
    """All (kind, first byte, last byte, new text, function) that a file has, messages and annotations left out."""
    starts, whole = [0], source.encode()
    for line in whole.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def place(node):
        return starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset

    def text(node):
        return whole[slice(*place(node))].decode()

    def visit(node, function):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            function = node.name
        if isinstance(node, ast.Raise | ast.JoinedStr | ast.Assert):
            return
        if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in SWAPS:
            new = f"({text(node.left)}) {SWAPS[type(node.ops[0])]} ({text(node.comparators[0])})"
            yield "comparison", *place(node), new, function
        elif (
            isinstance(node, ast.BinOp) and type(node.op) in SWAPS and "str" not in (text(node.left), text(node.right))
        ):
            yield "operator", *place(node), f"({text(node.left)}) {SWAPS[type(node.op)]} ({text(node.right)})", function
        elif isinstance(node, ast.BoolOp):
            yield (
                "condition",
                *place(node),
                f") {SWAPS[type(node.op)]} (".join(map(text, node.values)).join("()"),
                function,
            )
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
            yield "sign", *place(node), f"({text(node.operand)})", function
        elif isinstance(node, ast.If | ast.IfExp):
            yield "branch", *place(node.test), f"not ({text(node.test)})", function
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            yield "number", *place(node), repr(node.value * 2 + 1), function
        skipped = {id(getattr(node, name, None)) for name in ("annotation", "returns")}
        for each in ast.iter_child_nodes(node):
            if id(each) not in skipped:
                yield from visit(each, function)

    yield from visit(ast.parse(source), "")


def draw(number, seed):
    """Random mutants: files by their lines, kinds evenly, places evenly."""
    rng = random.Random(seed)
    files = [path for package in ("vsh", "sim", "fit", "study") for path in sorted((ROOT / package).rglob("*.py"))]
    files = [path for path in files if not HARMLESS.search(path.relative_to(ROOT).as_posix())]
    sources = [path.read_text(encoding="utf-8") for path in files]
    while number:
        path, source = rng.choices(
            list(zip(files, sources, strict=True)), [len(each.splitlines()) for each in sources]
        )[0]
        every = list(mutants(source))
        if not every:
            continue
        kind = rng.choice(sorted({each[0] for each in every}))
        yield path.relative_to(ROOT), source, *rng.choice([each for each in every if each[0] == kind])
        number -= 1


def tests_of(path, function):
    """The files of tests beside a file of code, and those that name the function or the file."""
    beside = ROOT / "tests" / path.parent
    near = sorted(beside.rglob("test_*.py")) if beside.is_dir() else []
    words = {path.stem.strip("_"), function.strip("_")} - {""}
    by_name = re.compile(rf"\b({'|'.join(map(re.escape, words))})\b")
    naming = [each for each in (ROOT / "tests").rglob("test_*.py") if by_name.search(each.read_text(encoding="utf-8"))]
    chosen = dict.fromkeys([*near[:12], *sorted(naming, key=lambda each: path.parent.name not in each.as_posix())[:16]])
    return [each.relative_to(ROOT).as_posix() for each in chosen]


def copied(folder):
    """A copy of the project, and the environment in which Python imports it and pytest finds the hook below."""
    copy = Path(folder) / "copy"
    ignored = shutil.ignore_patterns(".venv*", ".git", "__pycache__", "paper", "demo", ".hypothesis", "_build")
    shutil.copytree(ROOT, copy, ignore=ignored)
    paths = f"{copy}{os.pathsep}{copy / 'tests'}"
    return copy, os.environ | {"PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1", "OMP_NUM_THREADS": "1"}


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_logstart(nodeid):
    """Coverage is told which test runs, with `-p mutate`."""
    if running := coverage.Coverage.current():
        running.switch_context(nodeid)


def measure_tests(copy, environment):
    """The tests that run each line: {(file, line): [test, ...]}, the quickest first; and the seconds of each test."""
    settings = copy / "coverage.ini"
    settings.write_text(
        "[run]\nsource = vsh,sim,fit,study\nparallel = true\nconcurrency = multiprocessing,thread\npatch = subprocess\n"
        "relative_files = true\ncontext = ${PYTEST_CURRENT_TEST-}\n"
    )
    command = [sys.executable, "-m", "coverage", "run", f"--rcfile={settings}", "-m", "pytest", "-p", "mutate", "-q"]
    options = ["-p", "no:cacheprovider", "-m", "not slow", "-n", "auto", "--dist", "worksteal", "-vv", "--durations=0"]
    done = subprocess.run([*command, *options], cwd=copy, env=environment, capture_output=True, text=True, check=False)
    seconds = collections.Counter()
    for spent, test in re.findall(r"^(\d+\.\d+)s (?:call|setup|teardown) +(.+)$", done.stdout, re.MULTILINE):
        seconds[test.strip()] += float(spent)
    print(done.stdout[-300:], flush=True)
    combine = [sys.executable, "-m", "coverage", "combine", "--quiet", f"--rcfile={settings}"]
    subprocess.run(combine, cwd=copy, env=environment, check=True)
    lines, contexts = collections.defaultdict(set), coverage.CoverageData(str(copy / ".coverage"))
    contexts.read()
    for file in contexts.measured_files():
        for line, tests in contexts.contexts_by_lineno(file).items():
            named = {re.sub(r" \((?:setup|call|teardown)\)$", "", each) for each in tests}
            lines[file, line] |= {each for each in named if each in seconds and str(copy) not in each}
    return {place: sorted(tests, key=seconds.__getitem__) for place, tests in lines.items()}, seconds


def find_line(source, number):
    """Where it is measured which tests run a line: at the line, or, of a header, at the body; None of what imports run."""
    homes = [
        node
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.FunctionDef) and node.lineno <= number <= node.end_lineno
    ]
    if not homes:
        return None
    home = max(homes, key=lambda node: node.lineno)
    body = home.body[1:] if ast.get_docstring(home) and len(home.body) > 1 else home.body
    return max(number, body[0].lineno)


def judge(mutant, copy, environment, tests_by_line, seconds):
    """Plant one random mutant in a copy and run its tests; returns (found, the line to print)."""
    path, source, kind, first, last, new, function = mutant
    whole = source.encode()
    number = whole[:first].count(b"\n") + 1
    line = f"{kind:10} {path}:{number} {function}: {whole[first:last].decode()!r} → {new!r}"
    place, covering, spent = find_line(source, number), [], 0.0
    # Of a statement of several lines those below its first may have no tests.
    lines = (tests_by_line.get((path.as_posix(), each)) for each in range(place or 0, (place or 0) - 15, -1))
    for test in next(filter(None, lines), []):
        spent += seconds[test]
        if spent > 240 or len(covering) == 1000:
            break
        covering.append(test)
    (copy / path).write_bytes(whole[:first] + new.encode() + whole[last:])
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-m", "not slow"]
    tests = covering or [*tests_of(path, function), "--doctest-modules", path.as_posix()]
    try:
        done = subprocess.run([*command, *tests], cwd=copy, env=environment, capture_output=True, text=True,
                              check=False, timeout=600)  # fmt: skip
        # A test that is not there is no answer; what pytest cannot even import is one.
        missing = re.search(r"^ERROR: not found.*", done.stderr + done.stdout, re.MULTILINE)
        if missing:
            raise RuntimeError(missing[0])
        found = re.search(r"\d+ (failed|error)", done.stdout) is not None or done.returncode in (3, 4)
    except subprocess.TimeoutExpired:
        found = True  # it never ends
    finally:
        (copy / path).write_bytes(whole)
    return found, f"{'found' if found else 'SURVIVES':10} {len(covering):4} tests  {line}"


def run_random(number, seeds):
    """Plant random mutants, one at a time in each of as many copies as there are cores; prints what the tests find."""
    with tempfile.TemporaryDirectory() as folder:
        copy, environment = copied(f"{folder}/0")
        measured = measure_tests(copy, environment)
        copies = queue.Queue()
        for each in range(os.cpu_count()):
            copies.put((copy, environment) if not each else copied(f"{folder}/{each}"))

        def run(mutant):
            taken = copies.get()
            try:
                found, line = judge(mutant, *taken, *measured)
            finally:
                copies.put(taken)
            print(line, flush=True)
            return found

        for seed in seeds:
            with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
                found = sum(pool.map(run, list(draw(number, seed))))
            print(f"{found} of {number} random mutants found (seed {seed})", flush=True)
    return False


def main(chosen=()):
    chosen = set(chosen) or set(range(len(BREAKS)))
    lost = []
    with tempfile.TemporaryDirectory() as folder:
        copy, environment = copied(folder)
        for number in sorted(chosen):
            name, old, new, tests = BREAKS[number]
            path = copy / name
            whole = path.read_text(encoding="utf-8")
            if whole.count(old) < 1:
                print(f"{number:3} {name}: {old!r} is not there any more")
                lost.append(number)
                continue
            path.write_text(whole.replace(old, new, 1), encoding="utf-8")
            paths = [_path_of(each) for each in tests.split()]
            command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-n", "2", *paths]
            # The quick tests first; what none of them sees a slow one has to.
            for which in [["-m", "not slow"]] * ("::" not in tests) + [[]]:
                done = subprocess.run(
                    [*command, *which], cwd=copy, env=environment, capture_output=True, text=True, check=False
                )
                if found := re.search(r"\d+ failed", done.stdout) is not None:
                    break
            path.write_text(whole, encoding="utf-8")
            if not found and done.returncode:
                print(done.stdout[-2000:], done.stderr[-2000:])
            print(f"{number:3} {'found' if found else 'NOT FOUND':10} {name}: {old!r} → {new!r}", flush=True)
            if not found:
                lost.append(number)
    print(f"{len(chosen) - len(lost)} of {len(chosen)} deliberate breaks found")
    return bool(lost)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("breaks", nargs="*", type=int)
    parser.add_argument("--random", type=int, metavar="N")
    parser.add_argument("--seed", type=int, nargs="+", default=[1])
    options = parser.parse_args()
    sys.exit(run_random(options.random, options.seed) if options.random else main(options.breaks))
