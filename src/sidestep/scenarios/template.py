"""A scenario file to start from: every field, with what it means and what it is by default."""

import os
import re
import shutil
from pathlib import Path

from sidestep.files import OutputError, reason
from sidestep.scenarios.builtin import BUILT_IN
from sidestep.scenarios.model import ScenarioError

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


def new_scenario(folder: Path, name: str) -> Path:
    """Make a folder of this name with a ``scenario.toml`` in it, whole or not at all.

    Raises
    ------
    ScenarioError
        A name that cannot be, or that a built-in scenario has.
    OutputError
        A folder that is there already or cannot be made.
    """
    if not _NAME.fullmatch(name):
        raise ScenarioError(
            f"a scenario's name is made of letters, digits, - and _, begins with none of the last two and has at most "
            f"64 of them; {name!r:.80} is none"
        )
    if name in BUILT_IN:
        raise ScenarioError(f"{name} is the name of a built-in scenario; choose another")
    made = folder / name
    if os.path.lexists(made):
        raise OutputError(f"{made} is there already, and is left as it is")
    temporary = folder / f".{name}.{os.getpid()}.part"
    try:
        temporary.mkdir()
        (temporary / "scenario.toml").write_text(template(name), encoding="utf-8")
        temporary.rename(made)
    except OSError as error:
        raise OutputError(f"cannot make the folder {made}: {reason(error)}") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return made / "scenario.toml"


def template(name: str) -> str:
    """The text of a scenario file: central Helsinki with Auckland's counts, and what may be changed."""
    venue = BUILT_IN["helsinki"].venue
    assert venue is not None  # noqa: S101 # it is there to be one
    width = max(len(sensor.name) for sensor in venue.sensors) + 2
    names = (f'"{sensor.name}"' for sensor in venue.sensors)
    sensors = "\n".join(f'{quoted:{width}} = "paired"' for quoted in names)
    return _TEXT.replace("SENSORS", sensors).replace("NAME", name)


_TEXT = """\
# A scenario of Sidestep: streets, the people on them, and who walks there. See docs/scenarios.md.
#
# It runs as it is: `sidestep compare NAME/scenario.toml --walks 50 --planners shortest-path`.
# All fields but network.file may be left out. Files are looked for from the folder of this file.

name = "NAME"  # by default the name of the folder
summary = "central Helsinki with counts of Auckland, a synthetic pairing"  # one line

[network]
# Streets: "helsinki", which comes with Sidestep, or a file, .npz or .graphml. `sidestep import-osm` makes one of an
# OpenStreetMap extract.
file = "helsinki"

[counts]
# People counted each hour: "auckland" (the default), which comes with Sidestep, or a CSV file with a column `time`
# (hours of local wall time) and one for each sensor. `sidestep counts FILE` shows what is in it.
file = "auckland"
# First day, and the one past the last, that usual crowds are fitted to; at least four weeks. By default these,
# which are Auckland's: choose your own for counts of your own.
fitted = [2024-01-01, 2025-01-01]
# The same of the days that walks are tested in, none of those above: at least two whole weeks, Monday to Sunday. By
# default these.
tested = [2025-03-10, 2025-06-01]
# Seed of 0 or more that draws a street for each sensor that is "paired". 0 by default.
pairing = 0
# Streets that each "paired" sensor stands on, each with weeks of its own. 1 by default,
# and wherever sensors have places.
places = 10

[sensors]
# Where the sensors stand: "name, as in the counts" = [latitude, longitude], in degrees, at most 250 m from a street.
# "paired" draws a street for a sensor: such a pairing is SYNTHETIC, and so are the crowds that follow from it.
# By default these with Auckland's counts, and all that were counted, "paired", with your own.
SENSORS

[demand]
# How many people walk for each that was counted; 1 by default. 120 is an invented event day.
crowding = 120
# How unevenly they do: the standard deviation of the logarithm of demand from place to place, drawn anew for every
# future, since nobody knows beforehand where an event's crowds go. 0 by default.
uneven = 0.5
# Metres of walking in which the crowd at a sensor falls to 37 % (1/e). 150 by default.
reach = 40
# With a table of crowds (`sidestep counts import`) as counts.file, in place of all that sensors need: memory from slot
# to slot, and deviation of the logarithm, of what is drawn around the table. [0.9, 0.0], exactly as in it, by default.
noise = [0.9, 0.0]
# Days on which people walk: names in a list, ["Mon", "Sat"], or a span. "Mon-Sun" by default.
days = "Mon-Sun"
# Hours of the day between which they set out, 0 to 24. [10, 20] by default.
hours = [10, 20]

[walking]
# Speed by density: "weidmann" (the default), or "power-capped" (the paper's, but never above free speed).
law = "weidmann"
# Crossing times through all slots, "integrated" (the default), or by the density at entry, "entry" (the paper's).
rule = "integrated"
# Minutes after which a walk is given up, and counts as this long. 180 by default.
horizon_minutes = 180
# Minutes after the full hour at which people set out, earliest and latest. [0, 60] by default.
departures_minutes = [0, 60]
# Minutes in which crowds do not change. 5 by default.
slot_minutes = 5

[walks]
# Where walks begin and end: numbers of crossings, as `sidestep route` gives them, or [latitude, longitude] in degrees,
# which is taken to the nearest crossing, in any mix: origins = [17, [60.1699, 24.9384]]. By default, and with [],
# anywhere. No walk ends where it begins.
origins = []
destinations = []
# Walks of a comparison. 500 by default.
count = 500

# Vehicles that walkers wait for where a street crosses traffic, as its lights and crossings are known from
# OpenStreetMap. Without this table nobody waits. These are the defaults; none of them was measured.
# [traffic]
# cycle = 90  # seconds from one green to the next, of all lights
# green = 30  # seconds of each cycle in which walkers may go
# seed = 0  # draws the offset of each light: when in the cycle it turns green
# vehicles = 500  # an hour on each street that is crossed without lights, in the busiest hour of the day
# critical_gap = 8  # seconds between two vehicles in which walkers cross
# Lights whose timing is known, each on the street nearest to it; offset is how many seconds it turns green after
# those of offset 0.
# [traffic.lights]
# "Kaivokatu" = { at = [60.1705, 24.9415], cycle = 80, green = 25, offset = 10 }

# What walkers keep low: the sum of these weights times seconds, metres, and the crowd met on the way (its density,
# integrated over the walk, in person seconds per square metre). Without this table it is time.
# [objective]
# time = 1.0  # 1 by default
# distance = 0.0
# exposure = 0.5  # with 1, a second among one person per square metre counts as two
# max_density = 4.0  # persons per square metre above which nobody should enter a street; by default none

[agent]
# What the agent sees: "local", "map" (the default) or "live". See docs/levels.md.
level = "map"
"""
