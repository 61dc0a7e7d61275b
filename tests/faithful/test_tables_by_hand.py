"""Tables of logs against arithmetic by hand: where three road users are, which way they point, how large they are.

Expected are kind, centre [m], heading [degrees] and size [m] at the first and at the last instant of each.
"""

import gzip
from pathlib import Path

import numpy as np
import pytest

from regents_cosim.cases.files import load_case
from regents_cosim.saving import save_unlisted
from regents_cosim.sources.logs.formats import CompanionFiles, format_of, read_log
from regents_cosim.sources.logs.record import record_log
from regents_cosim.sources.windows import Windows

INPUTS = Path(__file__).parent / "inputs"


def write(folder, files):
    """Files by name, and the first of them."""
    for name, lines in files.items():
        (folder / name).write_text("\n".join(lines) + "\n")
    return folder / next(iter(files))


LANELET = "".join(
    f"<node id='{i}' lat='0' lon='0' x='{x}' y='{y}'/>"
    for i, (x, y) in enumerate([(-300, 60), (300, 60), (-300, -60), (300, -60)], start=1)
)
MAP = (
    f"<osm>{LANELET}<way id='11'><nd ref='1'/><nd ref='2'/></way><way id='12'><nd ref='3'/><nd ref='4'/></way>"
    "<relation id='1'><member type='way' role='left' ref='11'/><member type='way' role='right' ref='12'/>"
    "<tag k='type' v='lanelet'/><tag k='subtype' v='road'/></relation></osm>"
)

FILES = {
    # x and y are centres, psi_rad counter-clockwise from +x.
    "interaction": {
        "vehicle_tracks_000.csv": [
            "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width",
            *(f"1,{k},{100 * k},car,{10 + k},5,10,0,0.0,4.6,1.8" for k in range(3)),
            *(f"2,{k},{100 * k},truck,40,{7 - k},0,-10,-1.5708,9.0,2.5" for k in range(3)),
            *(f"3,{k},{100 * k},car,-20,30,0,0,2.0944,4.0,1.7" for k in range(3)),
        ],
        "place.osm": [MAP],
    },
    # yaw_rad is where one points, heading_rad where one moves: 0 of those who stand.
    "sind": {
        "Veh_smoothed_tracks.csv": [
            "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,yaw_rad,heading_rad,length,width,ax,ay,v_lon,v_lat,a_lon,a_lat",
            *(f"1,{k},{100.1001001 * k},car,{10 + k},5,10,0,0.0873,0.0,4.6,1.8,0,0,10,0,0,0" for k in range(3)),
            *(f"2,{k},{100.1001001 * k},bus,-27,40,0,0,-1.5359,0.0,11.0,2.5,0,0,0,0,0,0" for k in range(3)),
            *(f"3,{k},{100.1001001 * k},motorcycle,3,{k},0,10,1.5708,1.5708,2.0,0.8,0,0,10,0,0,0" for k in range(3)),
        ],
        "Ped_smoothed_tracks.csv": [
            "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,ax,ay",
            *(f"P1,{k},{100.1001001 * k},pedestrian,{8 - k},1,-10,0,0,0" for k in range(3)),
        ],
    },
    # Headings in degrees; exiD has columns about lanes, uniD and rounD have not.
    "levelx": {
        "07_tracks.csv": [
            "recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,width,length,xVelocity,yVelocity,"
            "xAcceleration,yAcceleration,lonVelocity,latVelocity,lonAcceleration,latAcceleration,traveledDistance,"
            "latLaneCenterOffset,laneWidth,laneletId,laneChange,lonLaneletPos,laneletLength,leadDHW,leadTHW,leadTTC,"
            "leadId,rearId,leftLeadId,leftRearId,leftAlongsideId,rightLeadId,rightRearId,rightAlongsideId,odrRoadId,"
            "odrSectionNo,odrLaneId",
            *(
                f"7,1,{k},{k},{10 + k},5,350.0,1.8,4.6,25,0,0,0,25,0,0,0,0,0.1,3.5,1499,0,1,90,-1,-1,-1,-1,-1,-1,-1,"
                f"2;3,-1,-1,-1,1,0,-2"
                for k in range(9, 12)
            ),
            *(f"7,2,{k},{k},40,{k},90.0,2.55,16.5,0,25{',0' * 27}" for k in range(9, 12)),
            *(f"7,3,{k},{k},60,{70 - k},270.0,0.0,0.0,0,-25{',0' * 27}" for k in range(9, 12)),
        ],
        "07_tracksMeta.csv": ["recordingId,trackId,class", "7,1,van", "7,2,trailer", "7,3,bicycle"],
        "07_recordingMeta.csv": ["recordingId,locationId,frameRate", "7,5,25.0"],
    },
    # The upper left corner in an image whose y runs down: centre (x + width / 2, -(y + height / 2)).
    "highd": {
        "01_tracks.csv": [
            "frame,id,x,y,width,height,xVelocity,yVelocity,laneId",
            *(f"{k},1,{100 + k},20.0,4.6,1.8,25.0,0.0,5" for k in range(3)),
            *(f"{k},2,{50 + k},24.0,16.0,2.5,25.0,0.0,6" for k in range(3)),
            *(f"{k},3,{300 - k},8.0,5.0,2.0,-25.0,0.0,2" for k in range(3)),
        ],
        "01_tracksMeta.csv": ["id,class,drivingDirection", "1,Car,2", "2,Truck,2", "3,Car,1"],
        "01_recordingMeta.csv": [
            "id,frameRate,speedLimit,upperLaneMarkings,lowerLaneMarkings", "1,25,-1,7.0;11.0,19.0;23.0;27.0",
        ],
    },
    # The centre in that image, and the turn from its x towards its y: 5 degrees to the right is 0.0873.
    "ad4che": {
        "01_tracks.csv": [
            "frame,id,x,y,width,height,xVelocity,yVelocity,laneId,orientation,yaw_rate,ego_offset",
            *(f"{k},1,{60 + k},20.0,4.6,1.8,30.0,0.0,5,0.0873,0.0,0.0" for k in range(3)),
            *(f"{k},2,49.7,20.0,12.0,2.5,0.0,0.0,5,0.0,0.0,0.0" for k in range(3)),
            *(f"{k},3,{160 - k},9.0,9.0,2.5,-30.0,0.0,2,0.0873,0.0,0.3" for k in range(3)),
        ],
        "01_tracksMeta.csv": ["id,class,drivingDirection", "1,car,2", "2,bus,2", "3,truck,1"],
        "01_recordingMeta.csv": [
            "id,frameRate,speedLimit,upperLaneMarkings,lowerLaneMarkings", "1,30,-1,7.0;11.0,18.0;22.0",
        ],
    },
    # Feet, the middle of the front bumper; y along the road. 15 feet are 4.572 m, 40 are 12.192 m, 8 are 2.4384 m.
    "ngsim": {
        "extract.csv": [
            "Vehicle_ID,Frame_ID,Global_Time,Local_X,Local_Y,v_length,v_Width,v_Class",
            *(f"1,{k},{100 * k},10,{100 + 10 * k},15,6,2" for k in range(3)),
            *(f"2,{k},{100 * k},30,200,40,8,3" for k in range(3)),
            *(f"3,{k},{100 * k},{20 + 2 * k},{300 + 10 * k},7,3,1" for k in range(3)),
        ],
    },
    # Feet, front bumpers and compass angles, as the mapping says.
    "table": {
        "mine.csv": [
            "who,at,east,north,compass,long,wide,what",
            *(f"a,{k / 10},{100 + 10 * k},50,90,15,6,car" for k in range(3)),
            *(f"b,{k / 10},30,{200 - 10 * k},180,40,8,truck" for k in range(3)),
            *(f"c,{k / 10},0,0,45,10,5,car" for k in range(3)),
        ],
        "mine.toml": [
            'position = "ft"\nheading = "nav"\nanchor = "front"\n[columns]\nid = "who"\ntime = "at"\nx = "east"\n'
            'y = "north"\nheading = "compass"\nlength = "long"\nwidth = "wide"\nkind = "what"'
        ],
    },
}  # fmt: skip

EXPECTED = {
    "interaction": {
        "1": ("car", (10.0, 5.0, 0.0), (12.0, 5.0, 0.0), (4.6, 1.8)),
        "2": ("truck", (40.0, 7.0, -90.0), (40.0, 5.0, -90.0), (9.0, 2.5)),
        "3": ("car", (-20.0, 30.0, 120.0), (-20.0, 30.0, 120.0), (4.0, 1.7)),
    },
    "sind": {
        "1": ("car", (10.0, 5.0, 5.0), (12.0, 5.0, 5.0), (4.6, 1.8)),
        "2": ("bus", (-27.0, 40.0, -88.0), (-27.0, 40.0, -88.0), (11.0, 2.5)),
        "3": ("motorcycle", (3.0, 0.0, 90.0), (3.0, 2.0, 90.0), (2.0, 0.8)),
        "P1": ("pedestrian", (8.0, 1.0, 180.0), (6.0, 1.0, 180.0), (0.6, 0.6)),
    },
    "levelx": {
        "1": ("car", (19.0, 5.0, -10.0), (21.0, 5.0, -10.0), (4.6, 1.8)),
        "2": ("truck", (40.0, 9.0, 90.0), (40.0, 11.0, 90.0), (16.5, 2.55)),
        "3": ("bicycle", (60.0, 61.0, -90.0), (60.0, 59.0, -90.0), (1.8, 0.65)),
    },
    "highd": {
        "1": ("car", (102.3, -20.9, 0.0), (104.3, -20.9, 0.0), (4.6, 1.8)),
        "2": ("truck", (58.0, -25.25, 0.0), (60.0, -25.25, 0.0), (16.0, 2.5)),
        "3": ("car", (302.5, -9.0, 180.0), (300.5, -9.0, 180.0), (5.0, 2.0)),
    },
    "ad4che": {
        "1": ("car", (60.0, -20.0, -5.0), (62.0, -20.0, -5.0), (4.6, 1.8)),
        "2": ("bus", (49.7, -20.0, 0.0), (49.7, -20.0, 0.0), (12.0, 2.5)),
        "3": ("truck", (160.0, -9.0, 175.0), (158.0, -9.0, 175.0), (9.0, 2.5)),
    },
    "ngsim": {
        "1": ("car", (3.048, 28.194, 90.0), (3.048, 34.29, 90.0), (4.572, 1.8288)),
        "2": ("truck", (9.144, 54.864, 90.0), (9.144, 54.864, 90.0), (12.192, 2.4384)),
        # atan2(10, 2) is 78.690 degrees, and half its length 1.0668 m: (-0.2092, -1.0461) from its front.
        "3": ("motorcycle", (5.8868, 90.3939, 78.69), (7.1060, 96.4899, 78.69), (2.1336, 0.9144)),
    },
    "table": {
        "a": ("car", (28.194, 15.24, 0.0), (34.29, 15.24, 0.0), (4.572, 1.8288)),
        "b": ("truck", (9.144, 67.056, -90.0), (9.144, 60.96, -90.0), (12.192, 2.4384)),
        "c": ("car", (-1.0776, -1.0776, 45.0), (-1.0776, -1.0776, 45.0), (3.048, 1.524)),
    },
}


@pytest.mark.parametrize("name", FILES)
def test_three_road_users_of_a_table(name, tmp_path):
    path = write(tmp_path, FILES[name])
    reader = format_of(path)
    assert reader.name == name
    (scene,) = read_log(path, reader, CompanionFiles())
    tracks = {track.agent.id: track for track in scene.tracks}
    assert tracks.keys() == EXPECTED[name].keys()
    for who, (kind, first, last, size) in EXPECTED[name].items():
        track = tracks[who]
        assert (track.agent.kind, not track.guessed) == (kind, True)
        assert (track.agent.length, track.agent.width) == pytest.approx(size)
        for at, (x, y, degrees) in ((0, first), (-1, last)):
            assert (track.x[at], track.y[at]) == pytest.approx((x, y), abs=1e-3), who
            turned = np.rad2deg(track.yaw[at]) - degrees
            assert abs((turned + 180.0) % 360.0 - 180.0) < 0.01, who


def unpacked(name, folder):
    for file in (INPUTS / name).iterdir():
        (folder / file.stem).write_bytes(gzip.decompress(file.read_bytes()))
    return folder


def states(case):
    t = case.tracks
    return {
        agent.id: (agent.kind, agent.length, agent.width, t.x[i, 0], t.y[i, 0], np.rad2deg(t.yaw[i, 0]) % 360.0)
        for i, agent in enumerate(case.agents)
    }


def test_those_who_wait_in_sind_point_where_it_says_and_its_pedestrians_are_there(tmp_path):
    folder = unpacked("12-sind", tmp_path)
    (folder / "TrafficLight_1.csv").write_text("RawFrameID,timestamp(ms),Traffic light 1\n0,0,1\n")
    said = []
    (case,) = record_log(
        folder / "Veh_smoothed_tracks.csv", Windows(horizon_s=4.0, count=1, radius_m=300.0), ego="6", tell=said.append
    )
    found = states(load_case(save_unlisted(case, tmp_path)))
    assert found["3"] == pytest.approx(("car", 4.5, 1.8, -18.2, 40.0, np.rad2deg(1.62)))
    assert found["4"] == pytest.approx(("bus", 11.0, 2.5, -27.0, 40.0, 360.0 - np.rad2deg(1.54)))
    assert found["P0"][0] == "pedestrian"
    assert any("TrafficLight_1.csv are left out" in line for line in said)


def test_vehicles_of_ad4che_are_as_far_apart_as_it_says(tmp_path):
    folder = unpacked("13-ad4che", tmp_path)
    write(folder, {
        "01_tracksMeta.csv": [
            "id,class,drivingDirection", "1,car,2", "2,bus,2", "3,car,2", "4,car,1", "5,truck,1",
        ],
        "01_recordingMeta.csv": [
            "id,frameRate,speedLimit,upperLaneMarkings,lowerLaneMarkings",
            "1,30,-1,3.6;7.2;10.8;14.4,18.0;21.8;25.4",
        ],
    })  # fmt: skip
    (case,) = record_log(folder, Windows(horizon_s=4.0, count=1, radius_m=300.0), tell=lambda _: None)
    found = states(case)
    assert found["2"][:3] == ("bus", 12.0, 2.5)
    front, behind = found["1"], found["2"]
    assert front[3] - front[1] / 2 - (behind[3] + behind[1] / 2) == pytest.approx(2.0, abs=1e-3)
    assert (front[4], found["5"][4]) == pytest.approx((-20.0, -9.0))
