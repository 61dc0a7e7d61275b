"""Writes one piece of traffic in every format of logs, as their documentation describes them.

Two lanes along +x, from -20 to 180 m, 8 m wide together. Three cars at 10 m/s, the first one the
recorder's, and a pedestrian who stands beside the road. 9 s.
"""

import csv
import gzip
import json
import pickle
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from regents_cosim.geometry.frames import FOOT_M, from_lat_lon
from regents_cosim.sources.logs.readers.waymo import crc32c, masked

CARS = {"11": (0.0, -2.0), "12": (20.0, -2.0), "13": (10.0, 2.0)}
WALKER = ("14", 60.0, 6.0)
SPEED, LENGTH, WIDTH = 10.0, 4.5, 1.8
WEST, EAST, KERB = -20.0, 180.0, 4.0
SECONDS = 9.0


def motion(dt=0.1):
    """Id, kind, x, y over time."""
    time = np.arange(round(SECONDS / dt) + 1) * dt
    for name, (x, y) in CARS.items():
        yield name, "car", x + SPEED * time, np.full(len(time), y)
    name, x, y = WALKER
    yield name, "pedestrian", np.full(len(time), x), np.full(len(time), y)


# --- Waymo ------------------------------------------------------------------------------------


def varint(value):
    value &= (1 << 64) - 1
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def whole(number, value):
    return varint(number << 3) + varint(value)


def double(number, value):
    return varint(number << 3 | 1) + struct.pack("<d", value)


def single(number, value):
    return varint(number << 3 | 5) + struct.pack("<f", value)


def nested(number, content):
    content = content.encode() if isinstance(content, str) else content
    return varint(number << 3 | 2) + varint(len(content)) + content


def point(x, y, z=1.0):
    return double(1, x) + double(2, y) + double(3, z)


def record(payload):
    head = struct.pack("<Q", len(payload))
    return head + struct.pack("<I", masked(crc32c(head))) + payload + struct.pack("<I", masked(crc32c(payload)))


KERBS = {  # drivable on their left
    101: [(x, -KERB) for x in np.arange(WEST, EAST + 1, 2.0)],
    102: [(x, KERB) for x in np.arange(EAST, WEST - 1, -2.0)],
}
LANES = {1: -2.0, 2: 2.0}


def waymo_scenario(name="abc", dt=0.1, sizes_vary=True):
    times = np.arange(round(SECONDS / dt) + 1) * dt
    out = b"".join(double(1, t + 1e-4 * (i % 3)) for i, t in enumerate(times))
    for number, kind, x, y in motion(dt):
        states = b""
        for i in range(len(x)):
            if number == "13" and i < 5:
                states += nested(3, whole(11, 0))
                continue
            length = LENGTH + (0.2 if sizes_vary and i % 10 == 0 else 0.0)
            size = (length, WIDTH, 1.5) if kind == "car" else (0.8, 0.8, 1.8)
            state = double(2, x[i]) + double(3, y[i]) + double(4, 1.0)
            state += b"".join(single(5 + k, v) for k, v in enumerate((*size, 0.0, 10.0, 0.0))) + whole(11, 1)
            states += nested(3, state)
        out += nested(2, whole(1, int(number)) + whole(2, 1 if kind == "car" else 2) + states)
    out += nested(5, name) + whole(6, 0)
    for step in range(len(times)):
        state = whole(1, 3) + whole(2, 4 if step < 40 else 6) + nested(3, point(80.0, -2.0))
        out += nested(7, nested(1, state))
    for number, y in LANES.items():
        lane = (
            double(1, 30.0)
            + whole(2, 2)
            + b"".join(nested(8, point(x, y)) for x in (WEST, 30.0, 80.0 if number == 1 else EAST))
        )
        out += nested(8, whole(1, number) + nested(3, lane + (whole(10, 3) if number == 1 else b"")))
    ahead = double(1, 30.0) + whole(2, 2) + b"".join(nested(8, point(x, -2.0)) for x in (80.0, EAST)) + whole(9, 1)
    out += nested(8, whole(1, 3) + nested(3, ahead))
    for number, kerb in KERBS.items():
        out += nested(8, whole(1, number) + nested(5, whole(1, 1) + b"".join(nested(2, point(*p)) for p in kerb)))
    return out


def write_waymo(folder):
    path = folder / "file.tfrecord-00000-of-00001"
    path.write_bytes(record(waymo_scenario("first")) + record(waymo_scenario("second")))
    return path


def write_waymo_example(folder, stop_signs=(), crosswalk=(), future=True):
    """Agents beyond ours are invalid, as in the 128 rows of the real files."""
    features = {}

    def add(name, values, as_float=True):
        values = np.asarray(values).ravel()
        if as_float:
            content = nested(2, nested(1, values.astype("<f4").tobytes()))
        else:
            content = nested(3, nested(1, b"".join(varint(int(v)) for v in values)))
        features[name] = content

    rows = list(motion())
    full = {key: np.full((128, 91), -1.0) for key in ("x", "y", "z", "bbox_yaw", "length", "width")}
    full["valid"] = np.zeros((128, 91))
    for i, (_, kind, x, y) in enumerate(rows):
        size = (LENGTH, WIDTH) if kind == "car" else (0.8, 0.8)
        for key, value in zip(full, (x, y, 1.0, 0.0, *size, 1.0), strict=True):
            full[key][i] = value if np.isscalar(value) else np.append(value, np.full(91 - len(value), value[-1]))
    spans = {"past": slice(0, 10), "current": slice(10, 11)} | ({"future": slice(11, 91)} if future else {})
    for part, span in spans.items():
        for key, values in full.items():
            add(f"state/{part}/{key}", values[:, span], key != "valid")
    add("state/id", [int(r[0]) for r in rows] + [-1] * 124)
    add("state/type", [1 if r[1] == "car" else 2 for r in rows] + [-1] * 124)
    add("state/is_sdc", [1] + [0] * 127, False)
    points = [(x, y, 1.0, number, 15) for number, kerb in KERBS.items() for x, y in kerb]
    points += [(x, y, 1.0, number, 2) for number, y in LANES.items() for x in np.arange(WEST, EAST + 1, 1.0)]
    points += [(x, y, 1.0, 90 + number, 17) for number, (x, y) in enumerate(stop_signs)]
    points += [(x, y, 1.0, 80, 18) for x, y in crosswalk]
    points = np.array(points + [(-1.0, -1.0, -1.0, -1, -1)] * 50)
    add("roadgraph_samples/xyz", points[:, :3])
    add("roadgraph_samples/id", points[:, 3], False)
    add("roadgraph_samples/type", points[:, 4], False)
    add("roadgraph_samples/valid", points[:, 3] > 0, False)
    for part, steps in (("past", 10), ("current", 1)):
        lit = np.zeros((steps, 16))
        lit[:, 0] = 1
        for key, value in (("id", 1.0), ("state", 4.0), ("valid", 1.0)):
            add(f"traffic_light_state/{part}/{key}", value * lit, False)
        for key in "xy":
            add(f"traffic_light_state/{part}/{key}", lit)
    features["scenario/id"] = nested(1, nested(1, "example"))
    content = b"".join(nested(1, nested(1, name) + nested(2, value)) for name, value in features.items())
    path = folder / "example.tfrecord"
    path.write_bytes(record(nested(1, content)))
    return path


# --- JSON, pickle -----------------------------------------------------------------------------


def gpudrive(generation):
    """1: no ids, degrees; 2: with a scenario_id, degrees; 3: with metadata, radians."""
    objects = []
    for number, kind, x, y in motion():
        valid = [not (number == "13" and i < 5) for i in range(len(x))]
        one = {
            "position": [{"x": a, "y": b} if v else {"x": -10000, "y": -10000}
                         for a, b, v in zip(x, y, valid, strict=True)],
            "width": WIDTH if kind == "car" else 0.8, "length": LENGTH if kind == "car" else 0.8,
            "heading": [(0.0 if generation == 3 else 360.0) if v else -10000.0 for v in valid],
            "velocity": [{"x": 10.0, "y": 0.0}] * len(x), "valid": valid,
            "goalPosition": {"x": x[-1], "y": y[-1]}, "type": "vehicle" if kind == "car" else "pedestrian",
        }  # fmt: skip
        objects.append(one | ({"id": int(number), "mark_as_expert": False} if generation == 3 else {}))
    roads = [{"geometry": [{"x": x, "y": y} for x, y in kerb], "type": "road_edge"} for kerb in KERBS.values()]
    roads += [{"geometry": [{"x": x, "y": y} for x in (WEST, EAST)], "type": "lane"} for y in LANES.values()]
    roads += [{"geometry": [{"x": 1.0, "y": 2.0}], "type": "stop_sign"}]
    content = {"name": "tfrecord-1.json", "objects": objects, "roads": roads, "tl_states": {}}
    if generation > 1:
        content["scenario_id"] = "abc"
    if generation > 2:
        content["metadata"] = {"sdc_track_index": 0, "objects_of_interest": [], "tracks_to_predict": []}
    return content


def write_gpudrive(folder, generation=3):
    path = folder / "scene.json.gz"
    path.write_bytes(gzip.compress(json.dumps(gpudrive(generation)).encode()))
    return path


def scenarionet():
    tracks = {}
    for number, kind, x, y in motion():
        size = (LENGTH, WIDTH) if kind == "car" else (0.8, 0.8)
        if number == "11":
            size = size[::-1]  # as nuScenes' ego
        shape = (len(x), 1)
        state = {
            "position": np.stack([x, y, 0 * x], axis=-1), "heading": 0.0 * x, "velocity": np.zeros((len(x), 2)),
            "valid": np.ones(len(x)), "length": np.full(shape, size[0]), "width": np.full(shape, size[1]),
        }  # fmt: skip
        tracks[number] = {"type": "VEHICLE" if kind == "car" else "PEDESTRIAN", "state": state, "metadata": {}}
    features = {f"e{number}": {"type": "ROAD_EDGE_BOUNDARY", "polyline": np.array(k)} for number, k in KERBS.items()}
    for number, y in LANES.items():
        line = np.array([(WEST, y, 0.0), (EAST, y, 0.0)], np.float32)
        features[str(number)] = {"type": "LANE_SURFACE_STREET", "polyline": line, "exit_lanes": [], "entry_lanes": []}
    steps = round(SECONDS / 0.1) + 1
    light = {"type": "TRAFFIC_LIGHT", "lane": "1", "state": {"object_state": ["LANE_STATE_STOP"] * steps}}
    return {
        "id": "sn", "version": "test", "length": steps, "tracks": tracks, "map_features": features,
        "dynamic_map_states": {"1": light},
        "metadata": {"ts": np.arange(steps) * 0.1, "sdc_id": "11", "dataset": "test", "scenario_id": "sn",
                     "set": {1, 2}},
    }  # fmt: skip


def write_scenarionet(folder):
    path = folder / "sd_scene.pkl"
    path.write_bytes(pickle.dumps(scenarionet(), protocol=4))
    return path


# --- CommonRoad -------------------------------------------------------------------------------


def commonroad(version="2020a", dt=0.2):
    def xy(x, y):
        return f"<point><x>{x}</x><y>{y}</y></point>"

    def state(tag, step, x, y, speed=SPEED):
        where = f"<position>{xy(x, y)}</position><orientation><exact>0.0</exact></orientation>"
        return f"<{tag}><time><exact>{step}</exact></time>{where}<velocity><exact>{speed}</exact></velocity></{tag}>"

    lanelets = "".join(
        f'<lanelet id="{n}"><leftBound>{xy(WEST, y + 2)}{xy(EAST, y + 2)}</leftBound>'
        f"<rightBound>{xy(WEST, y - 2)}{xy(EAST, y - 2)}</rightBound>"
        f'<{"adjacentLeft" if n == 1 else "adjacentRight"} ref="{3 - n}" drivingDir="same"/></lanelet>'
        for n, y in LANES.items()
    )
    obstacles = ""
    for number, kind, x, y in motion(dt):
        if number == "11":
            continue
        old = version == "2018b"
        size = (LENGTH, WIDTH) if kind == "car" else (0.8, 0.8)
        shape = f"<rectangle><length>{size[0]}</length><width>{size[1]}</width></rectangle>"
        later = "".join(state("state", i, a, b) for i, (a, b) in enumerate(zip(x, y, strict=True)) if i)
        tag = "obstacle" if old else "dynamicObstacle"
        obstacles += f'<{tag} id="{number}">{"<role>dynamic</role>" * old}<type>{kind}</type><shape>{shape}</shape>'
        obstacles += f"{state('initialState', 0, x[0], y[0])}<trajectory>{later}</trajectory></{tag}>"
    x, y = CARS["11"]
    goal = (
        "<goalState><time><intervalStart>40</intervalStart><intervalEnd>50</intervalEnd></time><position><rectangle>"
        f"<length>4</length><width>3</width><center><x>{x + 85}</x><y>{y}</y></center></rectangle></position>"
        "</goalState>"
    )
    problem = f'<planningProblem id="99">{state("initialState", 0, x, y)}{goal}</planningProblem>'
    return (
        f'<?xml version="1.0"?><commonRoad timeStepSize="{dt}" commonRoadVersion="{version}" benchmarkID="X-1">'
        f"{lanelets}{obstacles}{problem}</commonRoad>"
    )


def write_commonroad(folder, version="2020a"):
    path = folder / "X-1.xml"
    path.write_text(commonroad(version))
    return path


# --- CSV --------------------------------------------------------------------------------------


def write_rows(path, header, rows):
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


def degrees_of(x, y):
    """Latitude and longitude that INTERACTION's maps would give a point: Newton on the projection."""
    origin = np.array(from_lat_lon(0.0, 0.0, 31))
    found = np.zeros(2)
    for _ in range(20):
        miss = np.array(from_lat_lon(*found, 31)) - origin - [x, y]
        found -= miss[::-1] / 111_000.0
    return found


def osm(to_degrees=degrees_of):
    ways = {1: -4.0, 2: 0.0, 3: 4.0}
    out, number = "", 0
    for way, y in ways.items():
        refs = ""
        for x in (WEST, 80.0, EAST)[:: -1 if way == 2 else 1]:  # the middle one runs backwards
            number += 1
            lat, lon = to_degrees(x, y)
            out += f"<node id='{number}' lat='{lat:.12f}' lon='{lon:.12f}'/>"
            refs += f"<nd ref='{number}'/>"
        out += f"<way id='{100 + way}'>{refs}<tag k='type' v='line_thin'/></way>"
    for lane, (left, right) in {1: (102, 101), 2: (103, 102)}.items():
        members = f"<member type='way' role='left' ref='{left}'/><member type='way' role='right' ref='{right}'/>"
        tags = "<tag k='type' v='lanelet'/><tag k='subtype' v='road'/>"
        out += f"<relation id='{lane}'>{members}{tags}</relation>"
    return f"<?xml version='1.0' encoding='UTF-8'?><osm version='0.6'>{out}</osm>"


def write_interaction(folder):
    folder = folder / "DR_TEST"
    folder.mkdir()
    (folder / "DR_TEST.osm").write_text(osm())
    walkers = []
    rows = []
    for number, kind, x, y in motion():
        for i, (a, b) in enumerate(zip(x, y, strict=True)):
            start = (number, i + 1, 100 * (i + 1))
            if kind == "car":
                rows.append((*start, "car", a, b, SPEED, 0.0, 0.0, LENGTH, WIDTH))
            else:
                walkers.append((f"P{number}", *start[1:], "pedestrian/bicycle", a, b, 0.0, 0.0))
    write_rows(folder / "pedestrian_tracks_000.csv", "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy", walkers)
    header = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"
    return write_rows(folder / "vehicle_tracks_000.csv", header, rows)


def write_sind(folder):
    folder = folder / "9_1"
    folder.mkdir()
    (folder / "map.osm").write_text(osm())
    walkers, rows = [], []
    for number, kind, x, y in motion(0.1001):
        for i, (a, b) in enumerate(zip(x, y, strict=True)):
            start = (number, i, 100.1 * i)
            if kind == "car":
                rows.append((*start, "car", a, b, SPEED, 0.0, 0.0, 0.1, LENGTH, WIDTH, 0, 0, SPEED, 0, 0, 0))
            else:
                walkers.append((f"P{number}", *start[1:], "pedestrian", a, b, 0.0, 0.0, 0, 0))
    start = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy"
    write_rows(folder / "Ped_smoothed_tracks.csv", f"{start},ax,ay", walkers)
    header = f"{start},yaw_rad,heading_rad,length,width,ax,ay,v_lon,v_lat,a_lon,a_lat"
    return write_rows(folder / "Veh_smoothed_tracks.csv", header, rows)


def write_levelx(folder):
    rows, about = [], []
    for number, kind, x, y in motion(0.04):
        size = (WIDTH, LENGTH) if kind == "car" else (0.0, 0.0)
        about.append((0, number, 25, 25 + len(x) - 1, len(x), *size, kind))
        for i, (a, b) in enumerate(zip(x, y, strict=True)):
            rows.append((0, number, 25 + i, i, a, b, 360.0, *size, SPEED, 0.0))
    header = "recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,width,length,xVelocity,yVelocity"
    path = write_rows(folder / "00_tracks.csv", header, rows)
    header = "recordingId,trackId,initialFrame,finalFrame,numFrames,width,length,class"
    write_rows(folder / "00_tracksMeta.csv", header, about)
    header = "recordingId,locationId,frameRate,speedLimit,latLocation,lonLocation,xUtmOrigin,yUtmOrigin"
    write_rows(folder / "00_recordingMeta.csv", header, [(0, 1, 25.0, 13.89, 50.78, 6.16, 300000.0, 5629000.0)])
    return path


def write_ad4che(folder):
    """Centres in an image whose y runs down."""
    return write_highd(folder, centres=True)


def write_highd(folder, centres=False):
    """Upper left corners in an image whose y runs down; the cars drive to the right, on the lower carriageway."""
    rows, about = [], []
    for number, kind, x, y in motion(0.04):
        if kind == "car":
            about.append((number, LENGTH, WIDTH, 1, len(x), len(x), "Car", 2))
            for i, (a, b) in enumerate(zip(x, y, strict=True)):
                corner = (a, 20.0 - b) if centres else (a - LENGTH / 2, (20.0 - b) - WIDTH / 2)
                rows.append((i + 1, number, *corner, LENGTH, WIDTH, SPEED, 0.0, *((0.0, 0.0, 0.0) if centres else ())))
    more = ",orientation,yaw_rate,ego_offset" if centres else ""
    path = write_rows(folder / "01_tracks.csv", f"frame,id,x,y,width,height,xVelocity,yVelocity{more}", rows)
    header = "id,width,height,initialFrame,finalFrame,numFrames,class,drivingDirection"
    write_rows(folder / "01_tracksMeta.csv", header, about)
    header = "id,frameRate,locationId,speedLimit,upperLaneMarkings,lowerLaneMarkings"
    write_rows(folder / "01_recordingMeta.csv", header, [(1, 25, 2, -1.0, "4.0;8.0;12.0", "16.0;20.0;24.0")])
    return path


def write_ngsim(folder):
    header = (
        "Vehicle_ID,Frame_ID,Total_Frames,Global_Time,Local_X,Local_Y,Global_X,Global_Y,"
        "v_length,v_Width,v_Class,v_Vel,v_Acc,Lane_ID,Preceding,Following,Space_Headway,Time_Headway,Location"
    )
    rows = []
    for number, kind, x, y in motion():
        for i, (a, b) in enumerate(zip(x, y, strict=True)):
            if kind == "car":
                front = ((a + LENGTH / 2) / FOOT_M, b / FOOT_M)
                time = 1118846979700 + 100 * i
                size = (LENGTH / FOOT_M, WIDTH / FOOT_M)
                rows.append((number, i + 1, len(x), f'"{time:,}"', *front, 0, 0, *size, 2, *[0] * 7, "us-101"))
    return write_rows(folder / "ngsim.csv", header, rows)


def write_ngsim_text(folder, columns):
    """Without a header, between white space: 18 columns of a motorway, or 24 of a street."""
    lines = []
    for number, kind, x, y in motion():
        for i, (a, b) in enumerate(zip(x, y, strict=True)):
            if kind == "car":
                first = (number, i + 1, len(x), 1118846979700 + 100 * i)
                place = f"{(a + LENGTH / 2) / FOOT_M:12.5f} {b / FOOT_M:12.5f} 6451137.641 1873344.962"
                street = [0, 0, 0, 1, 2, 1] if columns == 24 else []
                size = (LENGTH / FOOT_M, WIDTH / FOOT_M, 2)
                lines.append(" ".join(f"{value:>9}" for value in (*first, place, *size, 32.8, 0, 1, *street, *[0] * 4)))
    path = folder / f"trajectories-{columns}.txt"
    path.write_text("\n".join(lines) + "\n")
    return path


MAPPING = """
time = "ms"
position = "ft"
heading = "nav"
anchor = "front"
ego = "11"
[columns]
id = "name"
time = "stamp"
x = "east"
y = "north"
heading = "course"
length = "long"
width = "wide"
kind = "what"
[kinds]
"1" = "car"
"""


def write_table(folder):
    rows = []
    for number, kind, x, y in motion(0.05):
        for i, (a, b) in enumerate(zip(x, y, strict=True)):
            length, width = (LENGTH, WIDTH) if kind == "car" else (0.8, 0.8)
            place = ((a + length / 2) / FOOT_M, b / FOOT_M)
            what = 1 if kind == "car" else kind
            rows.append((number, 50 * i, *place, 90.0, length / FOOT_M, width / FOOT_M, what))
    (folder / "mine.toml").write_text(MAPPING)
    return write_rows(folder / "mine.csv", "name,stamp,east,north,course,long,wide,what", rows)


# --- Argoverse 2 ------------------------------------------------------------------------------


def argoverse2_map(folder):
    def line(x0, x1, y):
        return [{"x": x, "y": y, "z": 1.0} for x in (x0, x1)]

    lanes = {
        str(n): {
            "id": n, "lane_type": "VEHICLE", "is_intersection": False, "successors": [], "predecessors": [],
            "left_lane_boundary": line(WEST, EAST, y + 2), "right_lane_boundary": line(WEST, EAST, y - 2),
            "left_neighbor_id": 2 if n == 1 else None, "right_neighbor_id": 1 if n == 2 else None,
        }
        for n, y in LANES.items()
    }  # fmt: skip
    area = {"area_boundary": line(WEST, EAST, -KERB) + line(EAST, WEST, KERB), "id": 7}
    content = {"lane_segments": lanes, "drivable_areas": {"7": area}, "pedestrian_crossings": {}}
    (folder / "log_map_archive_x.json").write_text(json.dumps(content))


def write_argoverse2_motion(folder):
    import polars as pl

    columns = {key: [] for key in ("track_id", "object_type", "timestep", "position_x", "position_y", "heading")}
    for number, kind, x, y in motion():
        for i, (a, b) in enumerate(zip(x, y, strict=True)):
            name = "AV" if number == "11" else number
            what = "vehicle" if kind == "car" else kind
            for key, value in zip(columns, (name, what, i, a, b, 0.0), strict=True):
                columns[key].append(value)
    pl.DataFrame(columns).write_parquet(folder / "scenario_abc.parquet")
    argoverse2_map(folder)
    return folder


def write_argoverse2_sensor(folder):
    """Boxes are in the frame of the recorder's rear axle."""
    import polars as pl

    others, poses = [], []
    rows = list(motion())
    for i in range(len(rows[0][2])):
        time = 315_966_070_000_000_000 + 100_000_000 * i
        ego = np.array([rows[0][2][i] - 1.4, rows[0][3][i], 5.0])  # rear axle
        poses += [
            (time + shift, 1.0, 0.0, 0.0, 0.0, ego[0] + 1e-9 * SPEED * shift, *ego[1:]) for shift in (0, 50_000_000)
        ]
        for number, kind, x, y in rows[1:]:
            size = (LENGTH, WIDTH, 1.5) if kind == "car" else (0.8, 0.8, 1.8)
            what = "REGULAR_VEHICLE" if kind == "car" else "PEDESTRIAN"
            others.append((time, number, what, *size, 1.0, 0.0, 0.0, 0.0, x[i] - ego[0], y[i] - ego[1], 0.0))
    pose = ("qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m")
    names = ("timestamp_ns", "track_uuid", "category", "length_m", "width_m", "height_m", *pose)
    pl.DataFrame(others, schema=names, orient="row").write_ipc(folder / "annotations.feather")
    pl.DataFrame(poses, schema=("timestamp_ns", *pose), orient="row").write_ipc(folder / "city_SE3_egovehicle.feather")
    (folder / "map").mkdir()
    argoverse2_map(folder / "map")
    return folder


@dataclass(frozen=True)
class Written:
    """How a format tells the traffic of `motion()`."""

    write: Callable[[Path], Path]
    ego: bool = False  # it says who the recorder is
    walkers: bool = True  # it has pedestrians
    road: bool = True  # it has a map
    down_m: float = 0.0  # how far below the log's y = 0 the traffic's is: images begin above the road
    time: tuple[str, float] | None = None  # of one CSV with commas: the column that decides, and its units in 1 s


FORMATS = {
    "waymo": Written(write_waymo, ego=True),
    "gpudrive": Written(write_gpudrive, ego=True),
    "scenarionet": Written(write_scenarionet, ego=True),
    "commonroad": Written(write_commonroad, ego=True),
    "interaction": Written(write_interaction, time=("timestamp_ms", 1e3)),
    "levelx": Written(write_levelx, road=False, time=("frame", 25)),
    "highd": Written(write_highd, walkers=False, down_m=20.0, time=("frame", 25)),
    "sind": Written(write_sind),
    "ad4che": Written(write_ad4che, walkers=False, down_m=20.0, time=("frame", 25)),
    "ngsim": Written(write_ngsim, walkers=False, road=False, time=("Global_Time", 1e3)),
    "table": Written(write_table, ego=True, road=False, time=("stamp", 1e3)),
    "argoverse2_motion": Written(write_argoverse2_motion, ego=True),
    "argoverse2_sensor": Written(write_argoverse2_sensor, ego=True),
}


def write(format: str, folder: Path) -> Path:
    """A log of that format."""
    return FORMATS[format].write(folder)


def add_late_row(path, format, later_s):
    """Append the last row of a table of that format once more, much later [s], and return it."""
    column, per_s = FORMATS[format].time
    lines = path.read_text().splitlines()
    names, last = csv.reader([lines[0], lines[-1]])
    at = names.index(column)
    last[at] = f"{float(last[at].replace(',', '')) + later_s * per_s:.0f}"
    path.write_text("\n".join([*lines, ",".join(last)]) + "\n")
    return ",".join(last)
