"""A file of counts, posted to a server as if they were counted now."""

import json
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from http.client import HTTPException
from typing import Any
from urllib.error import HTTPError, URLError
from urllib.parse import urlsplit
from urllib.request import Request, urlopen
from zoneinfo import ZoneInfo

import numpy as np

from sidestep.crowds.counts import CountTable
from sidestep.crowds.wall_time import local_time
from sidestep.errors import SidestepError

PATIENCE = 30.0
"""Seconds to wait for an answer."""
ANEW = 600.0
"""Seconds after which the clock is set anew, which otherwise lapses."""
HOUR = timedelta(hours=1)
MINUTE = "%a %Y-%m-%d %H:%M"
"""How times are told."""


class ReplayError(SidestepError):
    """A server that cannot be reached, or that refuses what is posted; ``field`` is the option at fault."""


class Client:
    """Asks a server of Sidestep.

    Parameters
    ----------
    url
        Address of the server.
    key
        API key; None where it needs none.

    Raises
    ------
    ReplayError
        What is no address of HTTP (field ``url``).
    """

    def __init__(self, url: str, key: str | None) -> None:
        if urlsplit(url).scheme not in {"http", "https"} or not urlsplit(url).netloc:
            raise ReplayError(f"--url must be an address such as http://127.0.0.1:8000, not {url!r:.80}", field="url")
        self._url, self._key = url.rstrip("/"), key

    def ask(self, method: str, path: str, content: Any = None) -> Any:
        """Send a request, with content as JSON.

        Parameters
        ----------
        method, path, content
            Of the request.

        Returns
        -------
        Any
            What the answer holds.

        Raises
        ------
        ReplayError
            No answer (field ``url``), or one that refuses.
        """
        body = None if content is None else json.dumps(content).encode()
        headers = {} if body is None else {"content-type": "application/json"}
        if self._key is not None:
            headers["authorization"] = f"Bearer {self._key}"
        asked = Request(self._url + path, body, headers, method=method)  # noqa: S310 - the scheme was checked
        try:
            with urlopen(asked, timeout=PATIENCE) as answer:  # noqa: S310
                return json.loads(answer.read() or b"null")
        except HTTPError as error:
            raise ReplayError(_refusal(error), field="api_key_file" if error.code == 401 else "file") from error
        except (URLError, OSError, HTTPException, ValueError) as error:
            why = getattr(error, "reason", None) or error
            said = f"no server of Sidestep answers at {self._url}: {why}"
            raise ReplayError(f"{said}; start one with: sidestep serve", field="url") from error


def _refusal(error: HTTPError) -> str:
    try:
        said = json.loads(error.read())["detail"]
    except (ValueError, KeyError, TypeError, OSError):
        said = error.reason
    return f"the server refuses: {said}"


def hours_of(table: CountTable, begin: datetime | None) -> Iterator[tuple[datetime, dict[str, float]]]:
    """The hours of a table, with what sensors counted in each.

    Parameters
    ----------
    table
        Hourly counts.
    begin
        Local wall time from which on they are wanted; None: all.

    Yields
    ------
    datetime, dict
        Local wall time at which the hour begins, and persons by sensor.
    """
    first = 0 if begin is None else int(np.searchsorted(table.times, np.datetime64(begin, "h")))
    for hour, row in zip(table.times[first:].astype("datetime64[s]").tolist(), table.counts[first:], strict=True):
        yield hour, {name: float(count) for name, count in zip(table.sensors, row, strict=True) if np.isfinite(count)}


def replay(
    client: Client, table: CountTable, speed: float, begin: datetime | None, tell: Callable[[str], None]
) -> None:
    """Set a server's clock to the time of a table, and post each hour as it ends by that clock.

    Parameters
    ----------
    client
        Of the server.
    table
        Hourly counts.
    speed
        Seconds of the table in each second.
    begin
        Local wall time to begin with; by default the table's first hour.
    tell
        Is told what is left out, how long it takes, and what was posted, line by line.

    Raises
    ------
    ReplayError
        A time to begin with that is not in the table (field ``begin``), no sensor that the server knows (``file``), a
        clock that is simulated already (``url``), and all that :meth:`Client.ask` raises.
    """
    features = client.ask("GET", "/sensors")["features"]
    known = {each["properties"]["sensor"] for each in features}
    zone = ZoneInfo(client.ask("GET", "/town")["timezone"] or "UTC")
    if not known & set(table.sensors):
        names = ", ".join(sorted(known)[:3]) or "none"
        raise ReplayError(f"{table.source} has none of the server's sensors, such as {names}", field="file")
    wall = None if begin is None else local_time(begin, zone.key)
    first, last = table.times[[0, -1]].astype("datetime64[s]").tolist()
    if wall is not None and not first <= wall < last + HOUR:
        said = f"{table.source} has counts from {first:{MINUTE}} to {last + HOUR:{MINUTE}}"
        raise ReplayError(f"{said}; begin in between, not at {wall:{MINUTE}}", field="begin")
    if client.ask("GET", "/clock")["simulated"]:
        said = "the server's clock is simulated already, by another replay or by PUT /clock"
        raise ReplayError(f"{said}; wait for its end, or give the clock back by DELETE /clock", field="url")
    if left_out := sorted(set(table.sensors) - known):
        tell(f"Left out, since the server does not have these sensors: {', '.join(left_out)}")
    hours = list(hours_of(table, wall))
    began, start = hours[0][0].replace(tzinfo=zone), time.monotonic()
    span = f"{hours[0][0]:{MINUTE}} to {last + HOUR:{MINUTE}}"
    tell(f"Posting {len(hours):,} hour{'s' * (len(hours) != 1)}, {span}, each in {3600 / speed:,.4g} s")
    try:
        client.ask("PUT", "/clock", {"now": began.isoformat(), "speed": speed})
        for hour, counts in hours:
            ends = (hour.replace(tzinfo=zone).astimezone(UTC) + HOUR - began.astimezone(UTC)).total_seconds() / speed
            while (left := start + ends - time.monotonic()) > 0:
                time.sleep(min(left, ANEW))
                passed = timedelta(seconds=(time.monotonic() - start) * speed)
                client.ask("PUT", "/clock", {"now": (began.astimezone(UTC) + passed).isoformat(), "speed": speed})
            rows = [
                {"sensor": name, "time": hour.replace(tzinfo=zone).isoformat(), "seconds": 3600, "count": count}
                for name, count in counts.items()
                if name in known
            ]
            taken = client.ask("POST", "/counts", rows)["accepted"] if rows else 0
            tell(f"{hour:{MINUTE}} to {hour + HOUR:%H:%M}: {taken} counts")
    finally:
        client.ask("DELETE", "/clock")
