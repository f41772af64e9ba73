"""SAMP, against a hub on this machine: a receiver loads the table that is sent, and what is missing is said."""

import warnings

import numpy as np
import pytest
from astropy.table import Table

import sim
from fit.commands.fit import main
from vsh.io import samp
from vsh.tools.errors import WriteError

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # astropy deprecates its SAMP for pyvo's in version 8
    samp_of_astropy = pytest.importorskip("astropy.samp")
    Client = samp_of_astropy.SAMPIntegratedClient


@pytest.fixture
def hub(monkeypatch, tmp_path):
    monkeypatch.setenv("SAMP_HUB", f"std-lockurl:{(tmp_path / 'samp').as_uri()}")
    samp_of_astropy.conf.use_internet = False
    hub = samp_of_astropy.SAMPHubServer(
        web_profile=False, mode="multiple", lockfile=str(tmp_path / "samp"), addr="127.0.0.1"
    )
    hub.start()
    yield hub
    hub.stop()


@pytest.fixture
def receiver(hub):
    """A program that loads tables, and those that it got."""
    client, got = Client(name="receiver"), []
    client.connect(hub=hub)

    def load(private_key, sender_id, msg_id, mtype, params, extra):
        got.append((params["name"], Table.read(params["url"].removeprefix("file://"), format="votable")))
        client.reply(msg_id, {"samp.status": "samp.ok", "samp.result": {}})

    client.bind_receive_call("table.load.votable", load)
    yield got
    client.disconnect()


def test_table_is_received(receiver):
    assert samp.send(Table({"ra": [1.0, 2.0]}), "mine") == ["receiver"]
    ((name, table),) = receiver
    assert name == "mine"
    np.testing.assert_array_equal(table["ra"], [1.0, 2.0])


def test_vsh_fit_sends_the_residuals(receiver, tmp_path, capsys):
    field = sim.observe(sim.quasars(300, rng=1), sim.spin((0, 0, 3)), rng=2, release="DR5")
    field.write(tmp_path / "q.fits")
    assert main([str(tmp_path / "q.fits"), "--lmax", "1", "--samp"]) == 0
    assert "sent to receiver" in capsys.readouterr().out
    ((name, table),) = receiver
    assert name == "q.fits"
    assert {"residual_east", "residual_north", "weight"} <= set(table.colnames)
    assert len(table) == 300


def test_nobody_loads_tables(hub):
    with pytest.raises(WriteError, match="no program on the SAMP hub loads tables"):
        samp.send(Table({"ra": [1.0]}), "mine")


def test_no_hub_runs(monkeypatch, tmp_path):
    monkeypatch.setenv("SAMP_HUB", f"std-lockurl:{(tmp_path / 'none').as_uri()}")
    with pytest.raises(WriteError, match="no SAMP hub runs: start TOPCAT or Aladin"):
        samp.send(Table({"ra": [1.0]}), "mine")
