"""Logged traffic: one small reader per format, one builder that makes Scenarios of what they read.

    readers (waymo, gpudrive, commonroad, ...) -> LoggedScene -> resample, edges, road -> cut -> Scenarios

A reader hands over tracks of valid samples at the log's own step, the map's lanes and kerbs or
areas, signals, who the recorder was, and notes on what it had to assume. `formats` tells a format
by its content and takes readers of other packages (entry point group `regents_cosim.sources`).

What was measured on the recordings that the tests use (2 windows of at most 8 s per scene;
"on the road": centres of vehicles faster than 1 m/s on the drivable area, of all, and of those
within 10 m of a mapped lane; the rest drives on car parks that the maps leave out, or beyond them;
"smooth": position error of the smooth fit, pedestrians too; read times on two cores with a load of 8):

    regents bench logs womd/json womd/proto scenarionet argoverse2 interaction commonroad --count 2

    format             scenes agents windows on road % on mapped road % smooth mean cm p99 cm read s
    gpudrive               16    693      16      98.2             99.0            2.1   20.1   0.49
    waymo                   3    468       3      99.6            100.0           10.1   73.0   1.40
    scenarionet             5    425       8      97.5             99.0            5.5   93.5   0.62
    argoverse2_motion       2    101       2      89.1             99.6           32.1  467.8   1.43
    argoverse2_sensor       2    235       2      98.2             99.0           10.4  113.3   2.60
    interaction             1     97       2     100.0            100.0           13.4  166.0   0.45
    commonroad              6    125       6      99.8             99.8            7.3  166.1   0.26

Cars without sizes in the log (Argoverse 2 motion) move as noisily as the log has them. Read times are from the
file to its windows, and for Argoverse 2 hold the start of the process that runs polars. No recordings
were to be had of levelx, highd, ngsim and table: their readers are tested on files made in their formats.

In three of the 35 scenes less than 98 % of the centres within 10 m of a lane are on the road, and the
maps are why: gpudrive 2af8a17d6cee3f8 (96.3 %) and scenarionet 2a1e44d405a6833f (97.6 %) have cars that
leave a car park without kerbs for the street beside it, scenarionet scene-0553 (97.2 %) cars that drive
along the painted line between two lanes, where nuScenes has no area.

Attacked, at most 4 windows of 8 s of each (made: the 3 cars of the tests' own files):

    regents attack --log PATH --planner idm --count 4 --no-pictures -o suite/

    format             windows collision none found idm collides unattacked
    gpudrive                 4         2          1                       1
    waymo                    3         1          2                       0
    scenarionet              4         3          0                       1
    argoverse2_motion        2         1          1                       0
    argoverse2_sensor        2         0          0                       2
    interaction              4         3          1                       0
    commonroad               4         2          2                       0
    levelx (made)            1         1          0                       0
    highd (made)             1         1          0                       0
    ngsim (made)             1         1          0                       0
    table (made)             1         1          0                       0

Whoever overlaps the ego when both first appear in a log neither attacks nor counts as hit; a planner that collides
unattacked (idm turns left in front of oncoming traffic, or drives on where the recorder waited) is
`already_colliding`, which is no success.
"""
