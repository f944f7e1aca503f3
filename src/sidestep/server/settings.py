"""How the server is set up: options of the command line, and secrets from the environment or a file."""

import os
import re
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from sidestep.errors import SidestepError
from sidestep.files import own_data, private_folder, reading

KEY_VARIABLE = "SIDESTEP_API_KEY"
"""The environment variable that holds the API key."""
SETTINGS_VARIABLE = "SIDESTEP_SERVER"
"""The environment variable by which worker processes get the settings, without the key."""
LEAST_KEY = 16
"""Fewest characters of an API key."""
LOOPBACK = ("127.0.0.1", "::1", "localhost")


class Settings(BaseModel):
    """What a server is told."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    scenario: str = "helsinki"
    """A scenario's name or file."""
    model: str | None = None
    """Folder of a trained model."""
    host: str = "127.0.0.1"
    """Address to listen on."""
    store: str | None = None
    """Where counts and walks are kept, as a URL; None: in a file of this user's for the scenario."""
    key_file: str | None = None
    """File with the API key; by default it is in the environment."""
    origins: tuple[str, ...] = ()
    """Origins whose pages may ask (CORS), such as ``https://example.org``."""
    hosts: tuple[str, ...] = ()
    """Names besides those of loopback by which browsers may address the server when they write."""
    proxies: tuple[str, ...] = ()
    """Addresses and networks of proxies that are believed when they say for whom they ask."""
    requests_per_second: Annotated[float, Field(gt=0)] = 1000.0
    """The most of one address, after twice as many at once."""
    workers: Annotated[int, Field(ge=1, le=64)] = 1
    """Processes."""

    @property
    def on_loopback(self) -> bool:
        """Whether only this machine can reach the server."""
        return self.host in LOOPBACK or self.host.startswith("127.")

    def store_url(self, scenario: str) -> str:
        """Where counts and walks are kept.

        Parameters
        ----------
        scenario
            Its name.

        Returns
        -------
        str
            A URL.

        Raises
        ------
        SidestepError
            A user without a home folder (field ``store``).
        """
        if self.store is not None:
            return self.store if "://" in self.store else f"sqlite:///{Path(self.store).absolute()}"
        with_name = re.sub(r"[^\w.-]", "_", scenario)
        return f"sqlite:///{private_folder(own_data('stores')) / with_name}.db"

    def key(self) -> str | None:
        """Read the API key.

        Returns
        -------
        str or None
            None where there is none.

        Raises
        ------
        SidestepError
            A file that cannot be read (field ``api_key_file``), or a key that is too short.
        """
        if self.key_file is not None:
            with reading(Path(self.key_file), SidestepError, "the API key") as file:
                found = file.read(4096).decode().strip()
        else:
            found = os.environ.get(KEY_VARIABLE, "").strip()
            if not found:
                return None
        if len(found) < LEAST_KEY or not found.isascii() or not found.isprintable():
            said = f"an API key must have {LEAST_KEY} printable ASCII characters or more"
            raise SidestepError(f"{said}; make one with: openssl rand -hex 32", field="api_key_file")
        return found
