import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import takewhile
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT, few_or_many

import sim
from fit.posterior import Flat, Posterior, sample
from fit.posterior._sampling import compute_split_r_hat
from vsh.tools.errors import CheckpointError
from vsh.tools.files import atomic_write

COMMON = {"hubble_prior": Flat(20, 150), "n_samples": 3200, "max_samples": 1, "n_walkers": 32, "rng": 3, "flows": None}
COMMON |= {"progress": False}


@pytest.fixture(scope="module")
def field():
    truth = sim.secular_parallax((300.0, 0, 0)) + sim.acceleration((0, 4, 0))
    return sim.observe(sim.galaxies(300, rng=1), truth, rng=2, sigma=3.0)


def test_chain_goes_on_bit_for_bit(field, tmp_path):
    whole = sample(field, **COMMON)
    path = tmp_path / "chain.npz"
    sample(field, **COMMON | {"n_samples": 1000}, checkpoint=path)
    longer = sample(field, **COMMON, checkpoint=path)
    assert (longer.chain == whole.chain).all()
    assert (longer.log_probability == whole.log_probability).all()
    again = sample(field, **COMMON, checkpoint=path)  # nothing is left to do
    assert (again.chain == whole.chain).all()
    shorter = sample(field, **COMMON | {"n_samples": 1600}, checkpoint=path)
    assert (shorter.chain == whole.chain[:50]).all()


def test_same_seed_gives_the_same_chain(field):
    one, two = (sample(field, **COMMON) for _ in range(2))
    assert (one.chain == two.chain).all()
    other = sample(field, **COMMON | {"rng": 4})
    assert not (one.chain == other.chain).any()
    assert (sample(field, **COMMON, threads=1).chain[-1] == one.chain[-1]).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rng": 4}, "seed: there"),
        ({"n_walkers": 34}, "walkers: there 32, here 34"),
        ({"peculiar_dispersion": 700.0}, r"peculiar_dispersion: there 750.0, here 700.0"),
        ({"hubble_prior": Flat(20, 151)}, r"hubble: there Flat\(low=20, high=150\), here Flat\(low=20, high=151\)"),
        ({"velocity_prior": lambda v: -np.sum(v**2, 1) / 1e5}, "velocity: there Gaussian"),
        ({"spin": "free"}, "spin: there None, here free"),
        ({"excess_noise": 1.0}, "excess_noise: there 0.0, here 1.0"),
    ],
)
def test_another_model_is_refused(field, tmp_path, change, words):
    path = tmp_path / "chain.npz"
    sample(field, **COMMON, checkpoint=path)
    with pytest.raises(CheckpointError, match=words):
        sample(field, **COMMON | change, checkpoint=path)


def test_function_that_changed_is_refused(field, tmp_path):
    path = tmp_path / "chain.npz"

    def of(width):
        return lambda v: -np.sum(v**2, 1) / width

    sample(field, of(1e5), **COMMON, checkpoint=path)
    sample(field, of(1e5), **COMMON, checkpoint=path)
    with pytest.raises(CheckpointError, match="start: there"):  # the code is the same, its values are not
        sample(field, of(2e5), **COMMON, checkpoint=path)


def test_other_data_are_refused(field, tmp_path):
    path = tmp_path / "chain.npz"
    sample(field, **COMMON, checkpoint=path)
    with pytest.raises(CheckpointError, match="data: there 300 sources.*here 299 sources"):
        sample(field[1:], **COMMON, checkpoint=path)


def test_damaged_files_are_refused(field, tmp_path):
    path = tmp_path / "chain.npz"
    sample(field, **COMMON, checkpoint=path)
    whole = path.read_bytes()
    flipped = whole[:5000] + bytes([whole[5000] ^ 255]) + whole[5001:]
    for content in (whole[: len(whole) // 2], b"", b"SIMPLE  =                    T", flipped):
        path.write_bytes(content)
        with pytest.raises(CheckpointError, match="no chain of this program, or damaged"):
            sample(field, **COMMON, checkpoint=path)
        assert path.read_bytes() == content
    np.savez(path, chain=np.zeros(3))
    with pytest.raises(CheckpointError, match="KeyError"):
        sample(field, **COMMON, checkpoint=path)
    with pytest.raises(CheckpointError, match="no such folder"):
        sample(field, **COMMON, checkpoint=tmp_path / "nowhere" / "chain.npz")
    with pytest.raises(CheckpointError, match="cannot be written"):
        sample(field, **COMMON, checkpoint=tmp_path)


def test_file_is_whole_or_not_there(tmp_path):
    path = tmp_path / "file"
    with atomic_write(path) as new:
        new.write_text("old")

    def fail():
        with atomic_write(path, overwrite=True) as new:
            new.write_text("ne")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert path.read_text() == "old"
    assert [x.name for x in tmp_path.iterdir()] == ["file"]


def run(folder, seconds=None):
    program = ROOT / "tests" / "fit" / "posterior" / "chain_to_kill.py"
    process = subprocess.Popen([sys.executable, program, folder / "chain.npz", folder / "out.npy"], cwd=ROOT)
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        process.kill()  # SIGKILL: nothing can be tidied up
        process.wait()
        return False
    assert process.returncode == 0
    return True


@pytest.mark.slow
@few_or_many(5, 30, "chains")
def test_killed_at_any_moment(chains, tmp_path):
    """Each chain is killed up to three times, and then goes on to its end."""

    def kill_and_go_on(folder, seconds):
        folder.mkdir()
        kills = len(list(takewhile(lambda each: not run(folder, each), seconds)))
        run(folder)
        return kills, np.load(folder / "out.npy")

    run(tmp_path)
    whole = np.load(tmp_path / "out.npy")
    with ThreadPoolExecutor(4) as pool:
        times = np.random.default_rng(1).uniform(0.2, 3.0, (chains, 3))
        kills, found = zip(*pool.map(kill_and_go_on, [tmp_path / str(i) for i in range(chains)], times), strict=True)
    assert all((chain == whole).all() for chain in found)
    assert sum(kills) >= 2 * chains


@pytest.mark.parametrize("column", ["lon", "lat", "motion", "sigma", "rho", "redshift", "magnitude"])
def test_every_column_is_in_the_fingerprint(field, column, tmp_path):
    """A survivor of deliberate breaks: redshift out of the fingerprint."""
    other = replace(field, **{column: getattr(field, column) + 1e-9})
    sample(other, **COMMON, checkpoint=tmp_path / "one.npz")
    with pytest.raises(CheckpointError, match="data: there"):
        sample(field, **COMMON, checkpoint=tmp_path / "one.npz")


def test_burn_in_and_thinning_interval():
    """A survivor of deliberate breaks: five autocorrelation times of the slowest, half of the quickest."""
    rng = np.random.default_rng(1)
    chain = np.zeros((4000, 8, 2))
    for t in range(1, 4000):  # autoregressive: integrated times (1 + a)/(1 − a), 19 and 3
        chain[t] = np.array([0.9, 0.5]) * chain[t - 1] + rng.normal(size=(8, 2))
    model = SimpleNamespace(names=("slow", "quick"))
    found = Posterior(chain=chain, log_probability=chain[..., 0], model=model, frame="icrs", notes=(), seed=1)
    assert found.autocorrelation["slow"] == pytest.approx(19, rel=0.25)
    assert found.burn_in == int(np.ceil(5 * found.autocorrelation["slow"]))
    assert found.thinning == max(1, int(found.autocorrelation["quick"] / 2))


def test_halves_that_differ_are_seen_in_r_hat():
    """By the formula, of walkers that wander off by four of their widths from the first half to the second."""
    noise = np.random.default_rng(2).normal(size=(2000, 8, 1))
    drift = np.repeat([0.0, 4.0], 1000)[:, None, None]
    one, away = compute_split_r_hat(noise)[0], compute_split_r_hat(noise + drift)[0]
    assert 0.999 < one < 1.01
    assert away == pytest.approx(np.sqrt(1 + 4.0**2 * 16 / 15 / 4), rel=0.02)  # 16 halves, eight of them four away
