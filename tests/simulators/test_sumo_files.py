"""The files that SUMO opens by itself are bounded before it gets them, and so are those that they name."""

import gzip
import os
import time
from pathlib import Path

import pytest
from params import slow

from regents_cosim.cases.shipped import network_config
from regents_cosim.checks.xml_input import read_tree
from regents_cosim.errors import SumoError
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.simulators.sumo.files import ShownFiles, survey
from regents_cosim.simulators.sumo.net import read_road_map
from regents_cosim.sources.sumo import record_sumo
from regents_cosim.sources.windows import Windows

NET = network_config("merge").parent / "merge.net.xml"


def wide(elements=150_000):
    return b"<routes>" + b'<vType id="t"/>' * elements + b"</routes>"


def padded(root=b"routes"):
    return b"<%b>" % root + b" " * (18 << 20) + b"</%b>" % root


BOMBS = {
    "text": (gzip.compress(padded()), "holds more than 1[67].* MiB"),
    "elements": (gzip.compress(wide()), "more than [23].... elements in so small a file"),
    "depth": (b"<routes>" + b"<a>" * 300, "nested more than 100 deep"),
    "type": (b'<!DOCTYPE routes [<!ENTITY a "a">]><routes/>', "document type"),
    "damage": (b"<routes>", "broken or truncated XML"),
    "itself": (b'<routes><include href="a.xml"/></routes>', "which is included already"),
}


def refused(words, **given):
    with pytest.raises(SumoError, match=words) as error:
        record_sumo(SumoInput(net=NET, **given), Windows(horizon_s=2.0))
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 500


@pytest.mark.parametrize("name", BOMBS)
@pytest.mark.parametrize("option", ["routes", "additional"])
def test_what_would_fill_the_memory_does_not_reach_sumo(tmp_path, name, option):
    content, words = BOMBS[name]
    (tmp_path / "a.xml").write_bytes(content)
    refused(words, **{option: (tmp_path / "a.xml",)})


@pytest.mark.parametrize("name", BOMBS)
def test_nor_does_what_a_file_includes(tmp_path, name):
    content, words = BOMBS[name]
    (tmp_path / "a.xml").write_bytes(content)
    (tmp_path / "b.xml").write_text('<additional><include href="a.xml"/></additional>')
    refused(words, additional=(tmp_path / "b.xml",))


@pytest.mark.parametrize("name", sorted({*BOMBS} - {"itself"}))
@pytest.mark.parametrize("value", [slow("a.xml"), "${HERE}/a.xml", slow("other.py,a.xml")])
def test_nor_does_what_an_option_of_the_configuration_names(tmp_path, monkeypatch, name, value):
    monkeypatch.setenv("HERE", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    content, words = BOMBS[name]
    (tmp_path / "a.xml").write_bytes(content)
    (tmp_path / "other.py").write_bytes(b"print(1)")
    (tmp_path / "b.sumocfg").write_text(f'<configuration><weight-files value="{value}"/></configuration>')
    refused(words, config=tmp_path / "b.sumocfg")


def test_a_file_that_is_included_again_and_again_multiplies(tmp_path):
    (tmp_path / "a.xml").write_bytes(b"<routes/>")
    (tmp_path / "b.xml").write_text("<routes>" + '<include href="a.xml"/>' * 2 + "</routes>")
    refused("which is included already", routes=(tmp_path / "b.xml",))
    (tmp_path / "c.xml").write_text("<additional>" + '<rerouter file="a.xml"/>' * 101 + "</additional>")
    refused("101 times, expected at most 100", additional=(tmp_path / "c.xml",))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_named_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "b.xml").write_text('<routes><include href="pipe"/></routes>')
    refused("is not a file", routes=(tmp_path / "b.xml",))
    (tmp_path / "b.sumocfg").write_text('<configuration><load-state value="pipe"/></configuration>')
    refused("is not a file", config=tmp_path / "b.sumocfg")


@pytest.mark.slow
@pytest.mark.parametrize("packed", [slow(False), True])
def test_a_tag_of_megabytes_is_read_in_time(tmp_path, packed):
    content = b"<additional " + b" ".join(b'a%d=""' % k for k in range(300_000)) + b"/>"
    (tmp_path / "a.xml").write_bytes(gzip.compress(content) if packed else content)
    began = time.process_time()
    survey([tmp_path / "a.xml"])
    read_tree(tmp_path / "a.xml", "an additional file", SumoError)
    assert time.process_time() - began < 60.0  # what is quadratic takes hours


def test_what_cities_use_is_read(tmp_path):
    """Many vehicles in plain text, an include, a sign's file named twice, outputs of an earlier run, a script."""
    (tmp_path / "a.xml").write_bytes(wide(20_000))
    (tmp_path / "sign.xml").write_bytes(b'<vss><step time="0" speed="9"/></vss>')
    (tmp_path / "out.xml").write_bytes(b"<detector> cut off")
    (tmp_path / "b.add.xml").write_bytes(
        b'<additional><include href="a.xml"/><variableSpeedSign id="a" file="sign.xml"/>'
        b'<variableSpeedSign id="b" file="sign.xml"/><e1Detector id="e" file="out.xml"/><poly imgFile="out.xml"/>'
        b"</additional>"
    )
    (tmp_path / "sub").mkdir()
    survey([tmp_path / "b.add.xml"])


def shown(path, folder):
    """What SUMO is shown of a file."""
    folder.mkdir()
    return ShownFiles(survey([path]), folder).of(path)


def test_what_writes_nothing_is_read_by_sumo_itself(tmp_path):
    (tmp_path / "b.xml").write_text('<routes><include href="a.xml"/></routes>')
    (tmp_path / "a.xml").write_text('<routes><vType id="a"><param key="mine" value="1"/></vType></routes>')
    assert shown(tmp_path / "b.xml", tmp_path / "s") == tmp_path / "b.xml"
    assert list((tmp_path / "s").iterdir()) == []


CHANGED = {
    '<e1Detector id="é&amp;" file="o.xml"/>': '<e1Detector id="é&amp;" file="NUL"></e1Detector>',
    '<timedEvent dest="localhost:99"/>': '<timedEvent dest="NUL"></timedEvent>',
    '<rerouter file="r.xml"/><e3Detector file="x"/>':
        '<rerouter file="HERE/r.xml"></rerouter><e3Detector file="NUL"></e3Detector>',
    '<vType id="a"><param key="device.SSM.File" value="o"/><param key="k" value="1&#10;2"/></vType>':
        '<vType id="a"><unknown></unknown><param key="k" value="1&#10;2"></param></vType>',
    '<dump to="o.xml"><vehicle id="1"/></dump>': '<unknown><vehicle id="1"></vehicle></unknown>',
    '<vehicle id="1" write="o.xml"/>': '<vehicle id="1"></vehicle>',
}  # fmt: skip


@pytest.mark.parametrize("text", CHANGED)
def test_of_all_else_sumo_is_shown_a_copy(tmp_path, text):
    (tmp_path / "a.xml").write_text(f"<additional>{text}</additional>", encoding="utf-8")
    (tmp_path / "b.xml").write_text('<anything><poly imgFile="p.png"/><include href="./a.xml"/></anything>')
    copy = shown(tmp_path / "b.xml", tmp_path / "s")
    assert copy.read_text() == (
        f'<unknown><poly imgFile="{tmp_path}/p.png"></poly><include href="{tmp_path}/s/1-a.xml"></include></unknown>'
    )
    expected = CHANGED[text].replace("HERE", str(tmp_path))
    assert (tmp_path / "s" / "1-a.xml").read_text(encoding="utf-8") == f"<additional>{expected}</additional>"


def test_a_second_name_of_a_file_is_no_way_around(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "d.xml").write_text('<additional><e1Detector file="o.xml"/></additional>')
    (tmp_path / "link").symlink_to(tmp_path / "sub")
    for number, name in enumerate(("link/d.xml", "sub/../link/d.xml", "sub/./d.xml")):
        (tmp_path / "a.xml").write_text(f'<additional><include href="{name}"/></additional>')
        copy = shown(tmp_path / "a.xml", tmp_path / f"s{number}")
        assert "o.xml" not in copy.with_name("1-d.xml").read_text()
        assert "1-d.xml" in copy.read_text()


def test_an_encoding_that_two_readers_may_take_differently_is_not_left_to_sumo(tmp_path):
    text = '<?xml version="1.0" encoding="windows-1252"?><additional><poly id="\u20ac"/></additional>'
    (tmp_path / "a.xml").write_bytes(text.encode("windows-1252"))
    assert shown(tmp_path / "a.xml", tmp_path / "s").read_text(encoding="utf-8") == (
        '<additional><poly id="\u20ac"></poly></additional>'
    )


@pytest.mark.slow
def test_sumo_takes_the_routes_that_a_file_includes(tmp_path):
    edge = next(lane.id.rpartition("_")[0] for lane in read_road_map(NET).lanes if not lane.id.startswith(":"))
    cars = "".join(
        f'<vehicle id="{x}" depart="0" departPos="{x}" departSpeed="10"><route edges="{edge}"/></vehicle>'
        for x in (30, 50, 70)
    )
    (tmp_path / "a.xml").write_text(f"<routes>{cars}</routes>")
    (tmp_path / "b.xml").write_text('<routes><include href="a.xml"/></routes>')
    include = SumoInput(net=NET, routes=(tmp_path / "b.xml",), end_s=4.0)
    direct = SumoInput(net=NET, routes=(tmp_path / "a.xml",), end_s=4.0)
    assert [agents(one) for one in (include, direct)] == [["30", "50", "70"]] * 2


def agents(source: SumoInput) -> list[str]:
    (scenario,) = record_sumo(source, Windows(horizon_s=2.0, count=1))
    return sorted(agent.id for agent in scenario.agents)


def test_the_cities_at_hand_are_read_also_packed(tmp_path):
    folder = Path(os.environ.get("REGENTS_DATA", "nowhere")) / "sumo"
    for number, path in enumerate(folder.glob("*/*.rou.xml")):
        packed = tmp_path / f"{number}.rou.xml.gz"
        packed.write_bytes(gzip.compress(path.read_bytes()))
        survey([path, packed])


@pytest.mark.slow
def test_a_day_of_traffic_packs_tighter_than_any_network(tmp_path):
    """A vehicle in 2.5 bytes, as in route files of real cities; SUMO takes 3 KB for each that waits."""
    cars = b"".join(b'<vehicle id="%d" depart="%d" type="t" route="r"/>' % (k, k // 100) for k in range(300_000))
    (tmp_path / "a.rou.xml.gz").write_bytes(gzip.compress(b"<routes>" + cars + b"</routes>"))
    assert (tmp_path / "a.rou.xml.gz").stat().st_size < 900_000
    survey([tmp_path / "a.rou.xml.gz"])
