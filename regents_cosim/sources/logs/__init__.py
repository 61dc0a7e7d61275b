"""Logged traffic: one small reader per format, one builder that makes Scenarios of what they read.

    readers (waymo, gpudrive, commonroad, ...) -> LoggedScene -> resample, edges, road -> cut -> Scenarios

A reader hands over tracks of valid samples at the log's own step, the map's lanes and kerbs or
areas, signals, who the recorder was, and notes on what it had to assume. `formats` tells a format
by its content and takes readers of other packages (entry point group `regents_cosim.sources`).

Who overlaps the ego when both first appear in a log neither attacks nor counts as hit. A planner that collides
unattacked (idm turns left in front of oncoming traffic, or drives on where the recorder waited) is
`already_colliding`, which is no success.
"""
