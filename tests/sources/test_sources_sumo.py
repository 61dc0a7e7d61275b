import itertools
import multiprocessing
import shutil
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from params import slow
from places import DATA, NETS

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_case
from regents_cosim.errors import NoWindowError, RegentsError, SumoError
from regents_cosim.geometry.boxes import corners
from regents_cosim.saving import save_unlisted
from regents_cosim.simulators.sumo.config import SumoInput, read_input
from regents_cosim.simulators.sumo.net import read_road_map
from regents_cosim.sources.conflicts import possible_conflict
from regents_cosim.sources.record import record
from regents_cosim.sources.sumo import SumoRecordingJob, record_slots, record_sumo, sumo_command
from regents_cosim.sources.windows import Windows
from regents_cosim.system.workers import run_isolated

MERGE = NETS / "merge" / "merge.sumocfg"
CROSSING = NETS / "crossing" / "crossing.sumocfg"
MERGE_NET = NETS / "merge" / "merge.net.xml"


@pytest.fixture(scope="module")
def merge():
    return record_sumo(SumoInput(MERGE, end_s=200.0), Windows(count=4, seed=1))


def config(folder: Path, text: str, name: str = "x.sumocfg") -> Path:
    path = folder / name
    path.write_text(f"<configuration>{text}</configuration>")
    return path


def test_every_window_keeps_the_contract(merge):
    assert len(merge) == 4
    for scenario in merge:
        tracks = scenario.tracks
        assert scenario.dt == 0.1
        assert tracks.steps == 81
        assert tracks.valid[0].all()
        assert np.hypot(np.diff(tracks.x[0]), np.diff(tracks.y[0])).sum() >= 5.0
        assert tracks.speed[0].mean() > 1.0
        apart = np.hypot(tracks.x[1:] - tracks.x[0], tracks.y[1:] - tracks.y[0])
        company = (apart <= 50.0) & (tracks.speed[1:] > 1.0) & tracks.valid[1:]
        assert company.sum(axis=0).max() >= 2
        assert (np.where(tracks.valid[1:], apart, np.inf).min(axis=1) <= 100.0).all()
        assert not any(scenario.ego.id in found.agents for found in scenario.overlaps)
        assert 0.0 <= scenario.provenance.begin_s <= 200.0 - 8.0


def test_boxes_are_on_the_road_and_look_ahead(merge):
    for scenario in merge:
        valid = scenario.tracks.valid
        assert scenario.road.contains(corners(scenario.boxes)[valid]).all()
        dx, dy = np.diff(scenario.tracks.x), np.diff(scenario.tracks.y)
        moved = valid[:, 1:] & valid[:, :-1] & (np.hypot(dx, dy) > 0.1)
        ahead = dx * np.cos(scenario.tracks.yaw[:, 1:]) + dy * np.sin(scenario.tracks.yaw[:, 1:])
        assert (ahead[moved] > 0.95 * np.hypot(dx, dy)[moved]).all()


def lane_changes(*extra: str) -> tuple[int, float]:
    """How many vehicles on the main road, which runs along x, change lanes; the largest step sideways [m]."""
    source = SumoInput(MERGE, end_s=150.0, extra=extra)
    changed, largest = set(), 0.0
    for scenario in record_sumo(source, Windows(count=12)):
        t = scenario.tracks
        main = np.array([agent.id.startswith("main") for agent in scenario.agents])
        aside = np.where(t.valid[:, 1:] & t.valid[:, :-1] & main[:, None], np.diff(t.y), 0.0)
        largest = max(largest, float(np.abs(aside).max()))
        changed |= {a.id for a, way in zip(scenario.agents, aside.sum(axis=1), strict=True) if abs(way) > 2.5}
    return len(changed), largest


@pytest.mark.slow
def test_lane_changes_are_motions_not_jumps():
    changes, largest = lane_changes()
    assert changes > 0
    assert largest < 0.35
    at_once, farthest = lane_changes("--lanechange.duration", "0")  # as SUMO was told to, so they are kept
    assert at_once > 0
    assert farthest > 2.0


def test_sizes_and_kinds_come_from_the_vehicle_types(merge):
    sizes = {(a.kind, a.length, a.width) for s in merge for a in s.agents}
    assert ("car", 4.8, 1.8) in sizes
    assert sizes <= {
        ("car", 4.8, 1.8), ("car", 6.0, 2.0), ("truck", 10.5, 2.5), ("bus", 12.0, 2.5), ("motorcycle", 2.2, 0.9)
    }  # fmt: skip


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bits_and_survives_the_disk(merge, tmp_path):
    again = record_sumo(SumoInput(MERGE, end_s=200.0), Windows(count=4, seed=1))
    assert [content_hash(s) for s in again] == [content_hash(s) for s in merge]
    assert len({s.id for s in merge}) == 4
    other = record_sumo(SumoInput(MERGE, end_s=200.0), Windows(count=4, seed=2))
    assert [content_hash(s) for s in other] != [content_hash(s) for s in merge]
    loaded = load_case(save_unlisted(merge[0], tmp_path))
    assert content_hash(loaded) == content_hash(merge[0])


@pytest.mark.slow
def test_an_executor_gives_the_same(merge):
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        there = record_sumo(SumoInput(MERGE, end_s=200.0), Windows(count=4, seed=1), executor=pool)
    assert [content_hash(s) for s in there] == [content_hash(s) for s in merge]


@pytest.mark.slow
@pytest.mark.parametrize("ego", ["truck", "ramp.exit"])
def test_the_ego_may_be_named_by_its_type_or_its_flow(ego):
    chosen = record_sumo(SumoInput(MERGE, end_s=120.0, ego=ego), Windows(count=3, seed=1))
    kinds = {scenario.ego.kind for scenario in chosen}
    flows = {scenario.ego.id.rpartition(".")[0] for scenario in chosen}
    assert ego in (kinds if ego == "truck" else flows)
    assert len(kinds if ego == "truck" else flows) == 1


def of_one_type(tmp_path, words):
    """Vehicles of one type, one after the other on the main road of merge."""
    trips = "".join(f'<trip id="v{k}" type="t" depart="{2 * k}" from="main" to="exit"/>' for k in range(12))
    path = tmp_path / "one.rou.xml"
    path.write_text(f'<routes><vType id="t" {words}/>{trips}</routes>')
    return SumoInput(net=MERGE_NET, routes=(path,), end_s=40.0)


@pytest.mark.slow
def test_an_ego_that_is_no_passenger_car_is_said(tmp_path):
    said: list[str] = []
    trailers = of_one_type(tmp_path, 'vClass="trailer"')
    (found,) = record(trailers, count=1, tell=said.append)
    assert (found.ego.kind, found.ego.length) == ("truck", 16.5)
    assert "the ego is no passenger car in 1 of 1 windows: truck 16.5 m (`ego_kind` car takes no other)" in said
    with pytest.raises(NoWindowError, match="of another kind than `ego_kind` car"):
        record(trailers, ego_kind="car", tell=said.append)
    said.clear()
    record(trailers, count=1, ego_kind="truck", tell=said.append)
    record(replace(trailers, ego="t"), count=1, tell=said.append)  # who is named need not be told of
    assert not [line for line in said if "passenger car" in line]


@pytest.mark.slow
def test_a_longer_look_reads_windows_that_overlap():
    job = SumoRecordingJob(read_input(SumoInput(MERGE, end_s=40.0)), Windows(count=2, seed=1), longer=True)
    slots, _ = run_isolated(record_slots, job)
    assert [slot.begin_s for slot in slots] == pytest.approx([4.0 * index for index in range(len(slots))])
    assert len(slots) > 4
    for one, two in itertools.pairwise(slots):
        common = [(one.ids.index(name), two.ids.index(name)) for name in set(one.ids) & set(two.ids)]
        first, then = np.transpose(common)
        there = one.valid[first, 40:]
        np.testing.assert_array_equal(two.valid[then, :41], there)
        np.testing.assert_array_equal(two.x[then, :41][there], one.x[first, 40:][there])


@pytest.mark.slow
def test_where_few_egos_have_a_conflict_more_of_the_time_is_read():
    source = SumoInput(CROSSING, end_s=60.0)
    chance, looked = (record_sumo(source, Windows(count=40, prefer=prefer)) for prefer in ("none", "conflicts"))
    few, more = (sum(map(bool, map(possible_conflict, found))) for found in (chance, looked))
    assert more > few
    halves = [round(10.0 * one.provenance.begin_s) % 81 for one in looked]
    assert any(halves)  # none of the windows of the first look begins so


@pytest.mark.slow
def test_signals_change_over_time():
    scenarios = record_sumo(SumoInput(NETS / "signals" / "signals.sumocfg", end_s=200.0), Windows(count=4))
    for scenario in scenarios:
        used = {link.signal for link in scenario.road.connections if link.signal}
        assert {signal.id for signal in scenario.signals} == used
        for link in scenario.road.connections:
            if link.signal:
                (signal,) = [s for s in scenario.signals if s.id == link.signal]
                assert signal.letters(0)[link.link] in "rygGusoO"
    assert any(len(signal.changes) > 1 for s in scenarios for signal in s.signals)


@pytest.mark.slow
def test_standing_traffic_waits_at_red():
    for scenario in record_sumo(SumoInput(NETS / "signals" / "signals.sumocfg", end_s=200.0), Windows(count=4)):
        letters = {signal.id: signal.letters(0) for signal in scenario.signals}
        for link in scenario.road.connections:
            if link.signal and letters[link.signal][link.link] == "r":
                line = scenario.road.lane[link.source].centre[-1]
                near = np.hypot(scenario.tracks.x[:, 0] - line[0], scenario.tracks.y[:, 0] - line[1]) < 4.0
                first = scenario.tracks.valid[:, 0] & near
                assert (scenario.tracks.speed[first, 0] < 15.0).all()


@pytest.mark.slow
def test_net_and_routes_without_a_configuration():
    routes = NETS / "merge" / "merge.rou.xml"
    found = record_sumo(SumoInput(net=MERGE_NET, routes=(routes,), end_s=100.0), Windows(count=1, horizon_s=4.0))
    assert found[0].tracks.steps == 41
    assert found[0].id.startswith("merge-")
    assert found[0].provenance.file == "merge.rou.xml"


@pytest.mark.slow
def test_other_traffic_than_that_of_the_configuration_is_said(tmp_path):
    files = '<net-file value="merge.net.xml"/><route-files value="merge.rou.xml"/><step-length value="1"/>'
    files += '<seed value="42"/><threads value="1"/>'
    path, said = config(tmp_path, files), list[str]()
    for name in ("merge.net.xml", "merge.rou.xml"):
        shutil.copy(NETS / "merge" / name, tmp_path)
    (found,) = record_sumo(SumoInput(path, end_s=60.0), Windows(count=1), tell=said.append)
    assert found.dt == 0.1
    assert said == [
        "x.sumocfg: SUMO runs here with time-to-teleport -1 (not SUMO's own 300), step-length 0.1 (not 1), seed 0 "
        "(not 42), so its traffic is not the same"
    ]


SIGN = '<variableSpeedSign id="s" lanes="LANE"><step time="0" speed="5"/></variableSpeedSign>'
CALIBRATOR = '<calibrator id="c" lane="LANE" pos="0"><flow begin="0" end="9" speed="5"/></calibrator>'


@pytest.mark.parametrize("text", [SIGN, slow(CALIBRATOR), slow('<poly id="p" color="red" shape="0,0"/>')])
def test_limits_that_change_while_sumo_runs_are_told(tmp_path, text):
    (lane, *_), said = [lane for lane in read_road_map(MERGE_NET).lanes if not lane.junction], list[str]()
    (tmp_path / "a.add.xml").write_text(f"<additional>{text.replace('LANE', lane.id)}</additional>")
    given = SumoInput(MERGE, additional=(tmp_path / "a.add.xml",), end_s=60.0)
    assert record_sumo(given, Windows(count=1, horizon_s=4.0), tell=said.append)
    assert any("cases have the speed limits of the network" in line for line in said) == ("speed" in text)


@pytest.mark.slow
def test_a_time_to_teleport_that_is_named_stays(tmp_path):
    files = f'<net-file value="{MERGE_NET}"/><route-files value="{MERGE.with_suffix(".rou.xml")}"/>'
    path, said = config(tmp_path, f'{files}<time-to-teleport value="120"/><step-length value="0.10"/>'), list[str]()
    assert record_sumo(SumoInput(path, end_s=60.0), Windows(count=1, horizon_s=4.0), tell=said.append)
    assert not [line for line in said if "traffic" in line]
    command = sumo_command(SumoRecordingJob(read_input(SumoInput(path)), Windows()), tmp_path)
    assert '<time-to-teleport value="120"/>' in Path(command[1]).read_text()


def test_what_is_given_goes_before_the_configuration():
    options = read_input(SumoInput(MERGE, begin_s=50.0, end_s=70.5, net=NETS / "grid" / "grid.net.xml"))
    assert (options.others["begin"], options.others["end"]) == ("50", "70.5")
    assert options.net.name == "grid.net.xml"
    assert [path.name for path in options.routes] == ["merge.rou.xml"]


@pytest.mark.slow
@pytest.mark.parametrize("city", ["bologna_acosta/run", "resco_cologne1/cologne1", "resco_cologne3/cologne3"])
def test_real_cities_work_unchanged(city):
    path = DATA / "sumo" / f"{city}.sumocfg"
    if not path.is_file():
        pytest.skip("no recordings (set REGENTS_DATA to their folder)")
    begin_s = None if "bologna" in city else 25200.0
    source = SumoInput(path, begin_s=begin_s, end_s=(begin_s or 0.0) + 200.0)
    scenarios = record_sumo(source, Windows(count=2), tell=lambda line: None)
    assert len(scenarios) == 2
    assert scenarios[0].signals
    off = [1.0 - s.road.contains(corners(s.boxes)[s.tracks.valid]).mean() for s in scenarios]
    assert np.mean(off) < 0.01


BAD_CONFIGS = {
    "": "no network named",
    '<net-file value="none.net.xml"/>': "network not found",
    f'<net-file value="{MERGE_NET}"/><route-files value="none.rou.xml"/>': "route file not found",
    f'<net-file value="{MERGE_NET}"/><additional-files value="none.add.xml"/>': "additional file not found",
    f'<net-file value="{MERGE_NET}"/><bogus value="1"/>': "SUMO refused: No option with the name 'bogus'",
}
COSTLY_CONFIGS = {  # they start SUMO, too
    f'<net-file value="{MERGE_NET}"/><time-to-teleport value="soon"/>': "SUMO refused: .*soon",
    f'<net-file value="{MERGE_NET}"/>': "no vehicle was on the road",
}


@pytest.mark.parametrize("text", [*BAD_CONFIGS, *map(slow, COSTLY_CONFIGS)])
def test_bad_configurations_give_one_clear_line(tmp_path, text):
    with pytest.raises(RegentsError, match=(BAD_CONFIGS | COSTLY_CONFIGS)[text]) as error:
        record_sumo(SumoInput(config(tmp_path, text)), tell=lambda _: None)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("<configuration><input>", "broken or truncated XML"),
        ("", "broken or truncated XML"),
        ("<net/>", "no network named"),
    ],
)
def test_a_broken_configuration_is_said(tmp_path, content, message):
    path = tmp_path / "x.sumocfg"
    path.write_text(content)
    with pytest.raises(SumoError, match=message):
        record_sumo(SumoInput(path))
    with pytest.raises(RegentsError, match="SUMO configuration not found"):
        record_sumo(SumoInput(tmp_path / "none.sumocfg"))


ROUTE = '<route id="r" edges="{}"/>'
BAD_ROUTES = {
    '<vehicle id="a" type="nope" depart="0"><route edges="main"/></vehicle>': "vehicle type 'nope'",
    '<vehicle id="a" depart="0"><route edges="nowhere"/></vehicle>': "edge 'nowhere'",
    '<vehicle id="a" depart="0"><route edges="exit main"/></vehicle>': "no valid route",  # said while SUMO runs
    "<vehicle": "broken or truncated XML",
}


@pytest.mark.parametrize("text", BAD_ROUTES)
def test_sumo_says_what_is_wrong_with_routes(tmp_path, text):
    path = tmp_path / "x.rou.xml"
    path.write_text(f"<routes>{text}</routes>")
    with pytest.raises(SumoError, match=BAD_ROUTES[text]) as error:
        record_sumo(SumoInput(net=MERGE_NET, routes=(path,)))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"horizon_s": 700.0}, "horizon of 700 s does not fit into the simulation, which lasts 600 s"),
        slow({"begin_s": 700.0}, "The end time should be after the begin time"),
        slow({"extra": ("--step-length", "0.5")}, "recordings are made at 0.1 s only"),
        slow({"extra": ("--nonsense",)}, "SUMO refused: .*nonsense"),
        ({"end_s": 9.0}, "candidate egos in 1 slot"),
        ({"end_s": 20.0, "ego": "nobody"}, "the ego 'nobody' is never on the road"),
    ],
)
def test_requests_that_cannot_be_met(asked, message):
    horizon_s = asked.pop("horizon_s", 8.0)
    with pytest.raises(RegentsError, match=message):
        record_sumo(SumoInput(MERGE, **asked), Windows(horizon_s=horizon_s))


def test_too_little_traffic_is_said(tmp_path):
    path = tmp_path / "x.rou.xml"
    path.write_text('<routes><vehicle id="a" depart="0"><route edges="main"/></vehicle></routes>')
    with pytest.raises(NoWindowError, match=r"of 1 candidate egos .* 1 had fewer than 2 moving vehicles"):
        record_sumo(SumoInput(net=MERGE_NET, routes=(path,), end_s=9.0))
