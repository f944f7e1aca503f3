"""Names that publishers of counts give to columns, without case, blanks and punctuation."""

import re


def _names(text: str) -> frozenset[str]:
    return frozenset(text.split())


def _in_order(text: str) -> tuple[str, ...]:
    return tuple(text.split())


TIMES = _names(
    "epoch epochtime unixtime unixtimestamp "
    "time datetime datetimelocal localtime localdatetime timestamp timelocal dateandtime datehour starttime start "
    "begin timeofmeasurement sensingdatetime countdatetime dateobserved zeit zeitpunkt zeitstempel datumzeit "
    "datumuhrzeit horodatage dateheure dateetheuredecomptage fechahora aika aikaleima"
)
DATES = _names("date sensingdate countdate day datum tag fecha jour päivä pvm päivämäärä dato")
HOURS = _names("hour hours time hourday hourofday timeofday uhrzeit stunde zeit hora heure tunti klo aika tid")
HOUR_WORDS = HOURS | _names("h hr")
"""Words before the number of an hour in the names of columns."""
SENSORS = _in_order(
    "sensorname sensor countername counter sitename site stationname station locationname zählstelle standort "
    "messstelle street location name sensorid counterid siteid stationid locationid"
)
COUNTS = _in_order(
    "hourlycounts hourlycount totalofdirections pedestriancount pedestriancounts pedestrianscount pedestrians "
    "peoplecount people persons count counts totalcount total volume footfall anzahl fussgänger passanten "
    "jalankulkijat piétons peatones"
)
LATITUDES, LONGITUDES = _names("latitude lat breitengrad"), _names("longitude lon lng long längengrad")
PLACES = _names("location position coordinates geopoint geopoint2d latlon latlong latlng latitudelongitude")
"""Columns whose cells have latitude and longitude."""
DIRECTIONS = _names("direction directionname dir richtung sens suunta riktning sentido")
NEVER_COUNTED = _names(
    "id index unnamed0 objectid rowid fid year month mdate day week weekday dayofweek dow dayname quarter hour "
    "wochentag jahr monat temperature temp rain rainfall precipitation humidity"
)
"""Columns of a wide table that are no sensors."""
PAIRS = (
    ("in", "out"), ("inbound", "outbound"), ("ingoing", "outgoing"), ("incoming", "outgoing"), ("entry", "exit"),
    ("entering", "leaving"), ("entries", "exits"), ("towards", "away"), ("northbound", "southbound"), ("nb", "sb"),
    ("eastbound", "westbound"), ("eb", "wb"), ("direction1", "direction2"), ("dir1", "dir2"), ("ltr", "rtl"),
    ("ein", "aus"), ("hin", "zurück"), ("sisään", "ulos"), ("entrée", "sortie"), ("entrada", "salida"),
)  # fmt: skip
"""Words at the end of two columns that are the directions of one sensor. Compass words alone are none: "Quay north" and
"Quay south" may be two sensors."""


TOTALS = _names("total totals sum both all summe gesamt insgesamt yhteensä somme suma")
"""Words for the sum of two directions; alone for the sum of all sensors."""
TOTAL_LINES = TOTALS | _names(
    "grandtotal gesamtsumme totaal summa mean average mittelwert durchschnitt moyenne media keskiarvo median min max "
    "minimum maximum"
)
"""First words of lines that are no rows but sums or means of them."""


def plain(name: str) -> str:
    """A name without case, blanks and punctuation."""
    return re.sub(r"[\W_]", "", name.casefold())


_WORDS = "|".join([*(re.sub(r"(\d)", r"[ _]?\1", word) for pair in PAIRS for word in pair), *sorted(TOTALS)])
_AT_END = re.compile(rf"(|.*?[\s_\-–:(/\[,.])({_WORDS})[)\]]?", re.IGNORECASE)


def direction_in(name: str) -> tuple[str, str]:
    """A column's name without the word for a direction, or for the sum of both, at its end, and that word."""
    found = _AT_END.fullmatch(name)
    return (found[1].rstrip(" _-–:/([,."), plain(found[2])) if found else (name, "")
