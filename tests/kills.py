"""Kill long commands at random moments and start them again: nothing is half-written, and the end is the same bytes.

`python tests/kills.py 40` makes so many kills over five commands and prints a line for each command; it ends with
status 1 if a killed run left a damaged file, or a run that was started again ended with other bytes.
"""

import json
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import sim
from vsh.tools.files import UNFINISHED

sys.path.insert(0, str(Path(__file__).parent / "vsh" / "io" / "archive"))
from test_schema_and_epochs import packed, serving

#: What differs between two runs by their clocks alone.
CLOCKS = ("provenance.json", ".log", "run.toml")


def contents(folder):
    """The bytes of every result, by its name."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not path.name.endswith(CLOCKS)
    }


def _unfinished(name):
    """Whether a file says by its name that it is not finished; the next run takes it away."""
    return Path(name).name.startswith(UNFINISHED)


def prepare(folder):
    """Inputs of all commands, and the words of each."""
    (folder / "many").mkdir()
    for k in range(4):
        sim.observe(sim.quasars(20_000, rng=k), sim.spin((0, 0, 3)), rng=k, sigma=300.0).write(
            folder / f"many/{k}.fits"
        )
    transits = sim.epochs(sim.quasars(30, rng=1), sim.spin((0, 0, 100)), rng=2)
    (folder / "ids.txt").write_text("\n".join(str(each) for each in range(1, 31)))
    return transits, {
        "vsh-fit of a folder": "fit many --lmax 3 --dpi 40",
        "vsh-fit --clip of a folder": "fit many --lmax 3 --method clip=3 --format none",
        "vsh-archive epochs": "archive epochs --ids ids.txt --batch 1 --url {url}/data",
    }


def start(words, folder, output):
    command = [sys.executable, "-m", "vsh", *words.split(), "--output", output]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def main(number=40, seed=1):
    rng, faults = np.random.default_rng(seed), []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        transits, commands = prepare(folder)
        share = number // len(commands)

        def reply(path, form):
            time.sleep(0.05)  # long enough to be killed in between
            return 200, packed(transits, form["ID"].split(","))

        with serving(reply) as (url, _):
            for number_of, (label, words) in enumerate(commands.items()):
                words, before = words.format(url=url), len(faults)
                begin = time.monotonic()
                whole = start(words, folder, f"whole{number_of}")
                errors = whole.communicate()[1]
                took = time.monotonic() - begin
                if whole.returncode:
                    print(f"{label}: {errors}")
                    return 1
                wanted, stopped = contents(folder / f"whole{number_of}"), 0
                for k in range(share):
                    output = folder / f"out{number_of}-{k}"
                    process = start(words, folder, output.name)
                    time.sleep(rng.uniform(0.1, 0.85) * took)
                    process.send_signal(signal.SIGKILL)
                    process.communicate()
                    stopped += process.returncode == -signal.SIGKILL
                    half = contents(output) if output.exists() else {}
                    faults += [
                        f"{label}: {each} is half-written"
                        for each in half
                        if not _unfinished(each) and half[each] != wanted.get(each)
                    ]
                    again = start(words + " --overwrite" * (output / "provenance.json").exists(), folder, output.name)
                    errors = again.communicate()[1]
                    if again.returncode or contents(output) != wanted:
                        other = [each for each in wanted if contents(output).get(each) != wanted[each]]
                        faults.append(f"{label}: started again it differs in {other} ({errors.strip()[:200]})")
                print(f"{label}: {stopped} killed of {share}, {len(faults) - before} faults", flush=True)
    print(*dict.fromkeys(faults), sep="\n")
    print(json.dumps({"kills": number, "faults": len(faults)}))
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:3])))
