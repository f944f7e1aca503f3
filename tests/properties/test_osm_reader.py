"""Whatever the file, there is a sound town or one sentence; never a traceback, and never half a town."""

import gzip
import re
import tempfile
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import osmium
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sidestep.network.formats import load_town, save_town
from sidestep.network.geodesy import course_lengths, metres_between
from sidestep.network.opening_hours import open_minutes, opening_text
from sidestep.network.osm import OsmError, import_osm
from sidestep.network.town import Town, TownError

SUFFIXES = [".osm", ".osm.gz", ".osm.pbf", ".npz", ".graphml"]
STEP = 0.00003  # degrees, about 3 m: towns in which nearly everything may merge
KINDS = st.sampled_from(
    ["footway", "steps", "residential", "primary", "pedestrian", "cycleway", "motorway", "elevator", "platform"]
)
RIGHTS = st.sampled_from(["yes", "no", "private", "destination", "customers", "nobody knows", "yes;no", ""])
CONDITIONS = st.sampled_from(
    [
        "no @ (22:00-06:00)",
        "yes @ (Mo-Fr 08:00-18:00; PH off)",
        "destination @ (Sa)",
        "no @ (wet)",
        "no @",
        "@",
        "no @ (off)",
    ]
)
HOURS = st.sampled_from(["24/7", "off", "06:00-22:00", "Mo-Fr 22:00-06:00; Sa off", "sunrise-sunset", "PH off"])
ACCESS = {
    "access": RIGHTS,
    "foot": RIGHTS,
    "foot:forward": RIGHTS,
    "foot:backward": RIGHTS,
    "access:conditional": CONDITIONS,
    "foot:conditional": CONDITIONS,
    "opening_hours": HOURS,
    "kerb": st.sampled_from(["raised", "lowered", "flush", "high"]),
    "kerb:height": st.sampled_from(["0.12", "3 cm", "high", "9"]),
}
TAGS = st.fixed_dictionaries(
    {"highway": KINDS},
    optional={
        "area": st.sampled_from(["yes", "no"]),
        "oneway": st.sampled_from(["yes", "-1", "no"]),
        "oneway:foot": st.sampled_from(["yes", "-1", "no"]),
        "conveying": st.sampled_from(["forward", "backward"]),
        "width": st.sampled_from(["3", "2 m", "12'", "wide", "-1"]),
        "sidewalk": st.sampled_from(["both", "left", "no", "separate"]),
        **ACCESS,
        "incline": st.sampled_from(["5%", "-10°", "up", "down", "steep", "1:0"]),
        "level": st.sampled_from(["0", "1", "0;1"]),
        "name": st.sampled_from(["High Street", "Å"]),
    },
)
OBSTACLES = st.fixed_dictionaries(
    {},
    optional={
        "highway": st.sampled_from(["crossing", "traffic_signals", "elevator"]),
        "barrier": st.sampled_from(["gate", "wall", "kerb", "bollard", "nobody knows", "fence;gate"]),
        "entrance": st.sampled_from(["yes", "emergency"]),
        "locked": st.sampled_from(["yes", "no", "sometimes"]),
        **ACCESS,
    },
)
NODES = st.dictionaries(
    st.integers(1, 14), st.tuples(st.integers(0, 12), st.integers(0, 12), st.just({}) | OBSTACLES), min_size=2
)
WAYS = st.lists(st.tuples(st.lists(st.integers(1, 14), min_size=0, max_size=6), TAGS), min_size=1, max_size=10)


def xml(nodes, ways) -> bytes:
    lines = ['<osm version="0.6">']

    def said(tags) -> str:
        return "".join(f"<tag k={quoteattr(key)} v={quoteattr(value)}/>" for key, value in tags.items())

    for number, (x, y, tags) in nodes.items():
        lines.append(f'<node id="{number}" lat="{60 + y * STEP:.7f}" lon="{25 + x * STEP:.7f}">{said(tags)}</node>')
    for number, (refs, tags) in enumerate(ways, 1):
        closed = [*refs, *refs[:1]] if tags.get("area") == "yes" else refs
        through = "".join(f'<nd ref="{ref}"/>' for ref in closed)
        lines.append(f'<way id="{number}">{through}{said(tags)}</way>')
    # Multipolygons of whatever ways come next, one of them perhaps around a hole or absent.
    for number, (refs, tags) in enumerate(ways, 1):
        if tags.get("area") == "no":
            roles = enumerate(("outer", "", "inner")[len(refs) % 3 :], number + 1)
            members = "".join(f'<member type="way" ref="{way}" role="{role}"/>' for way, role in roles)
            square = said({**tags, "type": "multipolygon", "area": "yes"})
            lines.append(f'<relation id="{number}">{members}{square}</relation>')
    return "\n".join([*lines, "</osm>"]).encode()


def check_sound(town: Town) -> None:
    assert town.streets > 0
    assert (town.tail != town.head).all()
    assert (town.width > 0).all()
    assert (town.signals >= 0).all()
    assert (town.length > 0).all()
    along = course_lengths(town.points, town.first)
    straight = metres_between(town.place[town.tail], town.place[town.head])
    assert (along >= straight * (1 - 1e-9)).all()
    np.testing.assert_array_equal(town.points[town.first[:-1]], town.place[town.tail])
    np.testing.assert_array_equal(town.points[town.first[1:] - 1], town.place[town.head])
    street, backwards = town.street_of_segment()
    tail = np.where(backwards, town.head[street], town.tail[street])
    head = np.where(backwards, town.tail[street], town.head[street])
    links = coo_array((np.ones(len(tail)), (tail, head)), shape=(town.nodes,) * 2)
    assert connected_components(links, connection="strong")[0] == 1
    assert len(set(town.ids.tolist())) == town.nodes

    assert (town.kerb >= 0).all()
    for text in set(town.opening):
        minutes = open_minutes(text)
        assert minutes is not None
        assert minutes.any()
        assert opening_text(minutes) == text
    # Public streets are connected without restricted ones.
    public = ~town.restricted
    if public.any():
        ends, single = np.stack([town.tail, town.head], axis=1)[public], town.one_way[public]
        tail, head = np.concatenate([ends, ends[~single, ::-1]]).T
        links = coo_array((np.ones(len(tail)), (tail, head)), shape=(town.nodes,) * 2)
        of = connected_components(links, connection="strong")[1]
        assert len(set(of[ends].ravel().tolist())) == 1


def check_sentence(error: Exception, path: Path) -> None:
    assert str(path) in str(error)
    assert "\n" not in str(error)


@pytest.fixture(scope="module")
def folder():
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


@pytest.fixture(scope="module")
def valid(folder) -> dict[str, Path]:
    """A small town in all formats, and as files of our own."""
    nodes = {
        1 + x + 4 * y: (12 * x, 12 * y, {"highway": "crossing"} if x == y else {}) for x in range(4) for y in range(4)
    }
    rows = [tuple(1 + x + 4 * y for x in range(4)) for y in range(4)]
    columns = [tuple(1 + x + 4 * y for y in range(4)) for x in range(4)]
    plain = xml(nodes, [(refs, {"highway": "footway", "name": "Å", "width": "3"}) for refs in [*rows, *columns]])
    path = folder / "valid.osm"
    path.write_bytes(plain)
    with osmium.SimpleWriter(str(folder / "valid.osm.pbf"), overwrite=True) as writer:
        for thing in osmium.FileProcessor(str(path)):
            writer.add(thing)
    town, _ = import_osm(path)
    save_town(town, folder / "valid.npz")
    save_town(town, folder / "valid.graphml")
    (folder / "valid.osm.gz").write_bytes(gzip.compress(plain))
    # Paths, not bytes, which would drown every report of a failure.
    return {suffix: folder / f"valid{suffix}" for suffix in SUFFIXES}


def sound_or_rejected(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    if ".osm" in path.name:
        try:
            town, _ = import_osm(path)
        except OsmError as error:
            check_sentence(error, path)
        else:
            check_sound(town)
        return
    try:
        town = load_town(path)
    except TownError as error:
        check_sentence(error, path)
    else:
        town.network()


@settings(max_examples=250)
@given(nodes=NODES, ways=WAYS, merge=st.sampled_from([0.0, 5.0, 20.0]))
def test_small_towns(folder, nodes, ways, merge: float) -> None:
    path = folder / "small.osm"
    path.write_bytes(xml(nodes, ways))
    try:
        town, report = import_osm(path, merge=merge)
    except OsmError as error:
        check_sentence(error, path)
        return
    check_sound(town)
    if not merge:
        np.testing.assert_allclose(town.length, course_lengths(town.points, town.first), rtol=1e-5, atol=0.2)
    assert (report.nodes, report.streets) == (town.nodes, town.streets)
    relations = sum(tags.get("area") == "no" for _, tags in ways)
    assert report.walkable <= report.ways == len(ways) + relations
    assert all(number > 0 for number in (*report.dropped.values(), *report.repaired.values()))
    # each crossing of traffic counts for one street at most
    stands = [tags.get("highway") for *_, tags in nodes.values()]
    # a way that differs by direction is two streets with the same crossings
    differ = 1 + any(key.startswith("foot:") for _, tags in ways for key in tags)
    assert town.signals.sum() <= differ * stands.count("traffic_signals")
    assert town.crossings.sum() <= differ * stands.count("crossing")
    for suffix in (".npz", ".graphml"):
        save_town(town, folder / f"small{suffix}")
        again = load_town(folder / f"small{suffix}")
        assert (again.length.tolist(), again.tail.tolist()) == (town.length.tolist(), town.tail.tolist())


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=40)
@given(content=st.binary(max_size=200))
def test_random_bytes(folder, suffix: str, content: bytes) -> None:
    sound_or_rejected(folder / f"random{suffix}", content)


# Where, as a part of the file, and what stands there instead.
CHANGES = st.lists(st.tuples(st.integers(0, 9999), st.integers(0, 255)), max_size=4)


def changed(content: bytes, changes: list[tuple[int, int]]) -> bytes:
    damaged = bytearray(content)
    for where, value in changes:
        damaged[where * len(damaged) // 10000] = value
    return bytes(damaged)


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=60)
@given(changes=CHANGES, cut=st.none() | st.integers(0, 9999))
def test_truncated_and_mutated(folder, valid, suffix: str, changes, cut: int | None) -> None:
    content = changed(valid[suffix].read_bytes(), changes)
    sound_or_rejected(folder / f"mutated{suffix}", content if cut is None else content[: cut * len(content) // 10000])


@settings(max_examples=60)
@given(changes=CHANGES)
def test_mutated_before_packing(folder, valid, changes) -> None:
    """What the checksum of a .gz file would catch, had it not been made of the damaged file."""
    sound_or_rejected(folder / "packed.osm.gz", gzip.compress(changed(valid[".osm"].read_bytes(), changes), 1))


OVERPASS = b"""<osm version="0.6"><way id="1"><center lat="0" lon="0"/><nd ref="1" lat="0" lon="-0.001"/>
<nd ref="2" lat="0" lon="0"/><tag k="highway" v="footway"/></way><way id="2"><nd ref="3" lat="0.001" lon="0.001"/>
<nd ref="4" lat="0.001" lon="0.002"/><tag k="highway" v="footway"/></way><relation id="3"><member type="way" ref="5"
role="outer"><nd lat="0" lon="0"/><nd lat="0" lon="0.001"/><nd lat="0.001" lon="0.001"/><nd lat="0" lon="0"/></member>
<tag k="type" v="multipolygon"/><tag k="highway" v="pedestrian"/></relation></osm>"""


@settings(max_examples=60)
@given(changes=CHANGES)
@example(changes=[])
def test_mutated_members(folder, changes) -> None:
    """Ways that stand in relations alone, as Overpass writes them."""
    sound_or_rejected(folder / "overpass.osm", changed(OVERPASS, changes))


@settings(max_examples=150)
@given(
    nodes=st.lists(st.dictionaries(st.text(max_size=12), st.text(max_size=12), max_size=3), min_size=2, max_size=5),
    ways=st.lists(st.dictionaries(st.text(max_size=12), st.text(max_size=12), max_size=4), min_size=1, max_size=4),
)
def test_any_tags(folder, nodes, ways) -> None:
    """Read whatever keys and values people invent."""
    legal = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd]")  # XML holds nothing else
    clean = [{legal.sub("", k): legal.sub("", v) for k, v in tags.items()} for tags in [*nodes, *ways]]
    path = folder / "any.osm"
    known = {1 + number: (20 * number, 5 * number, tags) for number, tags in enumerate(clean[: len(nodes)])}
    walked = [(list(known), {"highway": "footway"}), *((list(known), tags) for tags in clean[len(nodes) :])]
    path.write_bytes(xml(known, walked))
    try:
        town, _ = import_osm(path, merge=0)
    except OsmError as error:
        check_sentence(error, path)
    else:
        check_sound(town)
