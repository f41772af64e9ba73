"""Break the code in the places that matter most, one at a time, in a copy: does a test find each?

`python tests/mutate.py` plants every break, runs the tests named beside it and prints which were found; it ends
with status 1 if one was not, or if a place to break is not there any more. `python tests/mutate.py 3 7` runs some.

`python tests/mutate.py --random 120 --seed 5` draws the places instead, evenly by lines of code: an operator, a number, a
condition or a default is changed, and the quick tests of the folder and those that name the function run. It prints what
survived, which somebody has to judge: some changes make no difference.
"""

import argparse
import ast
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

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
    starts = [0]
    for line in source.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def place(node):
        return starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset

    def text(node):
        return ast.get_source_segment(source, node)

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
    """A copy of the project, and the environment in which Python imports it."""
    copy = Path(folder) / "copy"
    ignored = shutil.ignore_patterns(".venv*", ".git", "__pycache__", "paper", "demo", ".hypothesis")
    shutil.copytree(ROOT, copy, ignore=ignored)
    return copy, os.environ | {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}


def run_random(number, seed):
    """Plant random mutants one at a time; prints the share that the quick tests find."""
    found = 0
    with tempfile.TemporaryDirectory() as folder:
        copy, environment = copied(folder)
        for path, source, kind, first, last, new, function in draw(number, seed):
            whole = source.encode()
            old = whole[first:last].decode()
            (copy / path).write_bytes(whole[:first] + new.encode() + whole[last:])
            tests = [*tests_of(path, function), "--doctest-modules", path.as_posix()]
            command = [
                sys.executable,
                "-m",
                "pytest",
                "-q",
                "-x",
                "-p",
                "no:cacheprovider",
                "-m",
                "not slow",
                "-n",
                "2",
            ]
            try:
                done = subprocess.run([*command, *tests], cwd=copy, env=environment, capture_output=True, text=True,
                                      check=False, timeout=600)  # fmt: skip
                state = "SURVIVES" if not done.returncode else "NOT RUN"
                state = "found" if re.search(r"\d+ (failed|error)", done.stdout) else state
            except subprocess.TimeoutExpired:
                state = "found"  # it never ends
            (copy / path).write_bytes(whole)
            found += state == "found"
            line = whole[:first].count(b"\n") + 1
            print(f"{state:10} {kind:10} {path}:{line} {function}: {old!r} → {new!r}", flush=True)
    print(f"{found} of {number} random mutants found (seed {seed})")
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
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    sys.exit(run_random(options.random, options.seed) if options.random else main(options.breaks))
