"""Send tables to the programs on a SAMP hub: TOPCAT, Aladin and others that are open on this machine."""

import tempfile
import warnings
from pathlib import Path
from typing import Any

from vsh.io.tables import write_table
from vsh.tools.errors import WriteError, first_line
from vsh.tools.types import Table

#: The message that asks a program to load a VOTable (IVOA's SAMP 1.3 and its list of MTypes).
_LOAD = "table.load.votable"
#: How long a program is waited for that loads a table. [s]
_PATIENCE = 30


def _client_class() -> Any:
    """The client of pyvo, or of astropy, where it was until version 8."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            from pyvo.samp import SAMPIntegratedClient
        except ImportError:
            try:
                from astropy.samp import SAMPIntegratedClient
            except ImportError as error:
                raise WriteError("SAMP needs pyvo: pip install pyvo") from error
        return SAMPIntegratedClient


def send(table: Table, name: str) -> list[str]:
    """Send a table to every program on the hub that loads VOTables.

    Parameters
    ----------
    table : astropy Table
        What is sent.
    name : str
        What the programs call it.

    Returns
    -------
    list of str
        Names of the programs that have loaded it.

    Raises
    ------
    WriteError
        If no hub runs, no program on it loads tables, or one fails to.
    """
    client = _client_class()(name="vsh-astrometry", description="Vector spherical harmonics of proper motions")
    try:
        client.connect()
    except Exception as error:  # whatever a hub that is away makes of the client
        raise WriteError(f"no SAMP hub runs: start TOPCAT or Aladin first ({first_line(error)})") from error
    titles = []
    try:
        receivers = list(client.get_subscribed_clients(_LOAD))
        if not receivers:
            raise WriteError("no program on the SAMP hub loads tables: start TOPCAT or Aladin")
        with tempfile.TemporaryDirectory(prefix="vsh-") as folder:
            path = Path(folder, "table.vot")
            write_table(table, path)
            parameters = {"url": path.as_uri(), "name": name, "table-id": f"vsh-astrometry:{name}"}
            for receiver in receivers:
                title = str(client.get_metadata(receiver).get("samp.name", receiver))
                answer = client.ecall_and_wait(receiver, _LOAD, str(_PATIENCE), **parameters)
                if answer.get("samp.status") != "samp.ok":
                    error_text = answer.get("samp.error", {}).get("samp.errortxt", "it did not say why")
                    raise WriteError(f"{title} could not load the table: {error_text}")
                titles.append(title)
    finally:
        client.disconnect()
    return titles
