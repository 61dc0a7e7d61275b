"""Logged traffic: one small reader per format, and one builder that makes Scenarios of what they read.

    readers (waymo, gpudrive, commonroad, ...) -> LoggedScene -> resample, edges, road -> cut -> Scenarios

A reader returns tracks of valid samples at the log's own step, the map's lanes and kerbs or areas, signals, the
recorder's vehicle, and notes on what it had to assume. `formats` recognises a format by its content and loads readers
of other packages (entry point group `regents_cosim.sources`).

A road user whose box overlaps the ego's when both first appear neither attacks nor counts as hit. A window in which the
planner collides without an attack (idm turns left in front of oncoming traffic, or drives on where the recorder waited)
is `already_colliding`, which is not a success.
"""
