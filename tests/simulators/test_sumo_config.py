"""A configuration means what SUMO takes it to mean: its own run of a file is what ours is compared with."""

import ctypes
import gzip
import os
import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from params import slow
from writing_scenario import states_of_run

from regents_cosim.cases.shipped import network_config
from regents_cosim.errors import SumoError
from regents_cosim.simulators.sumo.config import SumoInput, read_input
from regents_cosim.simulators.sumo.process import load_libsumo, written_by_sumo
from regents_cosim.simulators.sumo.words import (
    ATTRIBUTES,
    ELEMENTS,
    FILES_OF_GUI,
    FILES_READ,
    OPTIONS,
    READ,
    WRITTEN,
)
from regents_cosim.sources.sumo import SumoRecordingJob, record_sumo, sumo_command
from regents_cosim.sources.windows import Windows
from regents_cosim.system.workers import run_isolated

MERGE = network_config("merge").parent
ONE = '<routes><vehicle id="{}" depart="0" departPos="{}"><route edges="main"/></vehicle></routes>'


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A network, routes of many names, and a working directory elsewhere."""
    there = tmp_path / "a place"
    (there / "sub").mkdir(parents=True)
    shutil.copy(MERGE / "merge.net.xml", there / "my net.net.xml")
    shutil.copy(MERGE / "merge.net.xml", there / "base.net.xml")
    shutil.copy(MERGE / "merge.rou.xml", there / "base.rou.xml")
    for number, (name, vehicle) in enumerate(NAMED.items()):
        (there / f"{name}.rou.xml").write_text(ONE.format(vehicle, 10 + 20 * number))
    monkeypatch.setenv("NET", "base")
    monkeypatch.setenv("WHOLE", str(there / "plain"))
    monkeypatch.setenv("CODED", "a%20space")
    monkeypatch.setenv("HOME", str(there))
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    return there


NAMED = {"plain": "plain", "a space": "space", "a%20space": "percent", "${NET}": "variable", "sub/é": "accent"}


def run(config: Path, *extra: str) -> set[str]:
    """Who is on the road at once in our run, and in SUMO's own."""
    folder = config.parent.parent / f"scratch{len(list(config.parent.parent.iterdir()))}"
    folder.mkdir()
    options = read_input(SumoInput(config, extra=extra))
    ours = run_isolated(states_of_run, sumo_command(SumoRecordingJob(options, Windows()), folder), 3)
    theirs = run_isolated(states_of_run, ["-c", str(config), *extra, "--step-length", "0.1", "--seed", "0"], 3)
    found = [{name for name, *_ in one[-1][0]} for one in (ours, theirs)]
    assert found[0] == found[1]
    return found[0]


@pytest.mark.parametrize(
    ("value", "who"),
    [
        slow("a%20space.rou.xml", {"space"}),
        slow("${NET}.rou.xml,plain.rou.xml", None),
        slow("%24{NET}.rou.xml", {"variable"}),
        slow("a%2520space.rou.xml", {"percent"}),
        slow("${WHOLE}.rou.xml", {"plain"}),
        slow("${CODED}.rou.xml", {"space"}),
        slow("${UNSET}plain.rou.xml", {"plain"}),
        slow("~/plain.rou.xml", {"plain"}),
        slow("./sub/../sub/é.rou.xml", {"accent"}),
    ],
)
def test_names_of_files_are_sumos(folder, value, who):
    (folder / "x.sumocfg").write_text(
        f'<configuration><net-file value="my%20net.net.xml"/><route-files value="{value}"/></configuration>'
    )
    found = run(folder / "x.sumocfg")
    assert found == who if who else found >= {"plain"}


@pytest.mark.slow
def test_the_folder_may_have_any_name_but_for_commas(folder):
    text = '<configuration><net-file value="base.net.xml"/><route-files value="plain.rou.xml"/></configuration>'
    (folder / "x.sumocfg").write_text(text)
    there = folder.rename(folder.parent / "${NET} %20 ~ é;")
    options = read_input(SumoInput(there / "x.sumocfg"))
    (folder.parent / "scratch").mkdir()
    words = sumo_command(SumoRecordingJob(options, Windows()), folder.parent / "scratch")
    assert {name for name, *_ in run_isolated(states_of_run, words, 3)[-1][0]} == {"plain"}
    there = there.rename(folder.parent / "Doe, Jane")
    with pytest.raises(SumoError, match="apart at commas"):
        record_sumo(SumoInput(there / "x.sumocfg"), tell=lambda _: None)


@pytest.mark.slow
def test_names_on_the_command_line_are_not_decoded(folder, monkeypatch):
    (folder / "x.sumocfg").write_text('<configuration><net-file value="base.net.xml"/></configuration>')
    monkeypatch.chdir(folder)
    assert run(folder / "x.sumocfg", "-r", "a%20space.rou.xml") == {"percent"}
    assert run(folder / "x.sumocfg", "--routes", "${NET}.rou.xml,a%20space.rou.xml") >= {"percent"}


@pytest.mark.slow
@pytest.mark.parametrize("option", ["route", slow("additional")])
def test_names_of_what_is_included_are_taken_as_they_are(folder, option):
    names = ["a space", "a%20space", "${NET}", "sub/é"]
    included = "".join(f'<include href="{name}.rou.xml"/>' for name in names)
    (folder / "x.sumocfg").write_text(
        f'<configuration><net-file value="base.net.xml"/><{option}-files value="in.xml"/></configuration>'
    )
    for more in ("", "<unheard-of/>"):  # the file itself, and a copy
        (folder / "in.xml").write_text(f"<routes>{included}{more}</routes>")
        assert run(folder / "x.sumocfg") == {NAMED[name] for name in names}


ELSEWHERE = {
    "other sections": '<output><scale value="0.4"/></output><report><begin value="20"/><end value="60"/></report>',
    "text": "<time><begin>20</begin><end>60</end></time><scale>0.4</scale>",
    "synonyms": '<time><b v="20"/><e value="60"/></time><gui_only><scale v="0.4"/></gui_only>',
    "no sections": '<begin value="20"/><end value="60"/><scale value="0.4"/>',
}


@pytest.mark.parametrize("text", ELSEWHERE.values(), ids=ELSEWHERE)
def test_options_count_wherever_they_stand(folder, text):
    (folder / "x.sumocfg").write_text(
        '<configuration><input><net-file value="base.net.xml"/><route-files value="base.rou.xml"/></input>'
        f"{text}</configuration>"
    )
    assert read_input(SumoInput(folder / "x.sumocfg")).others == {"begin": "20", "end": "60", "scale": "0.4"}


def test_the_root_element_may_have_any_name(folder):
    (folder / "x.sumocfg").write_text('<c><net value="base.net.xml"/><begin value="20"/></c>')
    assert read_input(SumoInput(folder / "x.sumocfg")).others == {"begin": "20"}


@pytest.mark.slow
def test_windows_lie_between_begin_and_end(folder):
    (folder / "x.sumocfg").write_text(
        '<configuration><input><net-file value="base.net.xml"/><route-files value="base.rou.xml"/></input>'
        '<report><begin value="20"/><end>60</end></report></configuration>'
    )
    for scenario in record_sumo(SumoInput(folder / "x.sumocfg"), Windows(count=4), tell=lambda _: None):
        assert 20.0 <= scenario.provenance.begin_s <= 52.0


@pytest.mark.parametrize(
    ("text", "extra", "sublane"),
    [
        ('<lateral-resolution value="-1"/>', (), False),
        ("<lateral-resolution>0</lateral-resolution>", (), False),
        ('<lateral-resolution value="0.8"/>', (), True),
        ('<lateral-resolution value="0.8"/>', ("--lateral-resolution", "0"), False),
        ("", ("--lateral-resolution=-1",), False),
        ("", ("--lateral-resolution", "0.4"), True),
        ("", ("--pedestrian.striping.stripe-width", "0.7"), False),
    ],
)
def test_the_sublane_model_is_on_by_its_value(folder, tmp_path, text, extra, sublane):
    (folder / "x.sumocfg").write_text(
        f'<configuration><net-file value="base.net.xml"/>{text}</configuration>',
    )
    options = read_input(SumoInput(folder / "x.sumocfg", extra=extra))
    config = Path(sumo_command(SumoRecordingJob(options, Windows()), tmp_path)[1]).read_text()
    assert ("lanechange.duration" not in config) == sublane


@pytest.mark.parametrize(("extra", "threads"), [((), "1"), (("--threads", "2"), "2")])
def test_one_thread_gives_the_same_traffic_each_time(folder, tmp_path, extra, threads):
    (folder / "x.sumocfg").write_text('<c><net value="base.net.xml"/><threads value="16"/></c>')
    options = read_input(SumoInput(folder / "x.sumocfg", extra=extra))
    config = Path(sumo_command(SumoRecordingJob(options, Windows()), tmp_path)[1]).read_text()
    assert f'<threads value="{threads}"/>' in config


@pytest.mark.slow
def test_lateral_resolution_of_none_gives_the_windows_of_no_such_option():
    plain, none = (
        record_sumo(SumoInput(network_config("merge"), end_s=60.0, extra=extra), Windows(count=2))
        for extra in ((), ("--lateral-resolution", "-1"))
    )
    assert [one.tracks.x.tolist() for one in plain] == [one.tracks.x.tolist() for one in none]


@pytest.mark.slow
def test_a_mesoscopic_simulation_is_refused_however_it_is_said(folder):
    for text, extra in (("<mesosim>on</mesosim>", ()), ("", ("--mesosim",)), ("", ("--mesosim", "X"))):
        (folder / "x.sumocfg").write_text(f'<c><n v="base.net.xml"/>{text}</c>')
        with pytest.raises(SumoError, match="mesoscopic"):
            record_sumo(SumoInput(folder / "x.sumocfg", extra=extra))


@pytest.mark.parametrize(
    ("text", "extra", "words"),
    [
        ("<bogus value='1'/>", (), "SUMO refused: No option with the name 'bogus'"),
        ("<begin value='1'/><b value='2'/>", (), "SUMO refused: .*begin|SUMO refused: .*'b'"),
        ("<help value='true'/>", (), "was asked for a simulation"),
        ("", ("--nonsense",), "SUMO refused: .*nonsense"),
        ("", ("-c", "other.sumocfg"), "SUMO refused: .*'c'"),
    ],
)
def test_what_sumo_cannot_read_is_one_line(folder, text, extra, words):
    (folder / "x.sumocfg").write_text(f'<configuration><net-file value="base.net.xml"/>{text}</configuration>')
    with pytest.raises(SumoError, match=words) as error:
        read_input(SumoInput(folder / "x.sumocfg", extra=extra))
    assert "\n" not in str(error.value)


def test_a_packed_configuration_is_named(folder):
    path = folder / "x.sumocfg.gz"
    path.write_bytes(gzip.compress(b'<configuration><net-file value="base.net.xml"/></configuration>'))
    with pytest.raises(SumoError, match=r"x.sumocfg.gz: SUMO refused: .*expected a plain configuration"):
        read_input(SumoInput(path))


@pytest.mark.slow
def test_what_is_typed_after_two_dashes_may_write(folder, monkeypatch):
    (folder / "x.sumocfg").write_text(
        '<configuration><net-file value="base.net.xml"/><route-files value="plain.rou.xml"/>'
        '<tripinfo-output value="trips.xml"/></configuration>'
    )
    monkeypatch.chdir(folder.parent)
    assert run(folder / "x.sumocfg", "--fcd-output", "my 100%.xml", "--netstate", "NUL") == {"plain"}
    assert (folder.parent / "my 100%.xml").is_file()


# --- what SUMO knows is what we have looked at -------------------------------------------------------

# Neither kept nor with a file: what an output holds, what SUMO says and shows, ways in, what a recording decides.
NOT_KEPT = (
    "-output.", "output.", "output-", "save-", "netstate-dump", "write-", "log.", "gui-testing", "window-", "game",
    "device.ssm.file", "device.toc.file", "pedestrian.jupedsim.wkt.geo", "verbose", "print-options", "help", "version",
    "no-warnings", "aggregate-warnings", "language", "duration-log", "no-step-log", "step-log", "remote-port",
    "num-clients", "random", "seed", "step-length", "quit-on-end", "start", "delay", "breakpoints", "demo",
    "disable-textures", "registry-viewport", "tracker-interval",
)  # fmt: skip


def test_every_option_of_sumo_was_looked_at():
    template = ET.fromstring(run_isolated(written_by_sumo, ["--save-template", "stdout"]))
    kinds = {option.tag: option.get("type") for section in template for option in section}
    files = {name for name, kind in kinds.items() if kind == "FILE"}
    assert not files & OPTIONS
    others = {name for name in files - FILES_OF_GUI if not name.endswith(("output", "-template", "-schema"))}
    assert others == (
        FILES_READ | {
            "configuration-file", "save-configuration", "device.ssm.filter-edges.input-file", "netstate-dump",
            "save-state.prefix", "save-state.files", "log", "message-log", "error-log",
            "pedestrian.jupedsim.wkt", "pedestrian.jupedsim.py", "fcd-output.filter-edges.input-file",
        }
    ) & files  # fmt: skip
    left = [name for name in kinds if name not in OPTIONS | files and not any(part in name for part in NOT_KEPT)]
    assert left == []


def words_of_sumo() -> tuple[set[str], set[str]]:
    """The elements and the attributes that SUMO knows, from its library."""

    class Entry(ctypes.Structure):
        _fields_ = (("word", ctypes.c_char_p), ("number", ctypes.c_int))

    (path,) = Path(load_libsumo().__file__).parent.glob("_libsumo*.so")
    library = ctypes.CDLL(str(path))
    found = []
    for name in ("tags", "attrs"):
        at = ctypes.addressof(Entry.in_dll(library, f"_ZN18SUMOXMLDefinitions4{name}E".replace("4attrs", "5attrs")))
        words = set()
        while word := Entry.from_address(at).word:
            words.add(word.decode())
            at += ctypes.sizeof(Entry)
        found.append(words)
    return found[0], found[1]


@pytest.mark.skipif(os.name != "posix", reason="names of symbols")
def test_every_word_of_sumos_files_was_looked_at():
    tags, attributes = run_isolated(words_of_sumo)
    assert len(tags) > 500
    assert {tag for tag in tags if " " not in tag} <= ELEMENTS
    assert {word for name in attributes for word in name.split()} - ATTRIBUTES == {
        "xmlns:xsi", "xsi:noNamespaceSchemaLocation", "file", *READ, *WRITTEN, "saveFile",
        *(name for name in attributes if name.endswith(("-file", "-files"))),
    }  # fmt: skip
    assert not ATTRIBUTES & {"file", "saveFile", *READ, *WRITTEN}
