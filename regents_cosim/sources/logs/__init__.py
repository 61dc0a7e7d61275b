"""Logged traffic: one small reader per format, one builder that makes Scenarios of what they read.

    readers (waymo, gpudrive, commonroad, ...) -> LoggedScene -> resample, edges, road -> cut -> Scenarios

A reader hands over tracks of valid samples at the log's own step, the map's lanes and kerbs or
areas, signals, who the recorder was, and notes on what it had to assume. `formats` tells a format
by its content and takes readers of other packages (entry point group `regents_cosim.sources`).

What was measured on the recordings that the tests use (2 windows of at most 8 s per scene;
"on the road": centres of vehicles faster than 1 m/s on the drivable area, of all, and of those
within 10 m of a mapped lane; the rest drives on car parks that the maps leave out, or beyond them;
"smooth": position error of the smooth fit, pedestrians too; read times on two cores with a load of 10):

    regents bench logs womd/json womd/proto scenarionet argoverse2 interaction commonroad --count 2

    format             scenes agents windows on road % on mapped road % smooth mean cm p99 cm read s
    gpudrive               16    693      16     98.24            99.03            2.1   20.1   0.87
    waymo                   3    468       3     99.57            100.0           10.1   73.0  1.784
    scenarionet             5    425       8     97.49            98.97            5.5   93.5  2.021
    argoverse2_motion       2    101       2     89.13            99.63           32.1  467.8   2.79
    argoverse2_sensor       2    235       2     98.15            99.05           10.4  113.3  7.315
    interaction             1     97       2     100.0            100.0           13.4  166.0  0.979
    commonroad              6    125       6      99.8             99.8            7.3  166.1  0.976

Cars without sizes in the log (Argoverse 2 motion) move as noisily as the log has them. Read times are from the
file to its windows, and for Argoverse 2 hold the start of the process that runs polars.
"""
