"""Readers of logs, one a format."""

from regents_cosim.sources.logs.readers import (
    argoverse2,
    commonroad,
    gpudrive,
    highd,
    interaction,
    levelx,
    ngsim,
    scenarionet,
    sind,
    table,
    waymo,
)

# Each stands before those that would take its files for theirs.
OWN = (
    waymo.FORMAT, gpudrive.FORMAT, scenarionet.FORMAT, commonroad.FORMAT, argoverse2.SENSOR,
    argoverse2.MOTION, sind.FORMAT, interaction.FORMAT, levelx.FORMAT, highd.AD4CHE, highd.FORMAT, ngsim.FORMAT,
    table.FORMAT,
)  # fmt: skip
