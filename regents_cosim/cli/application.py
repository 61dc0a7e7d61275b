"""All commands together."""

from regents_cosim.cli.bench import bench
from regents_cosim.cli.commands import app, training
from regents_cosim.cli.shrink import shrink
from regents_cosim.cli.suite import suites

app.command(bench)
app.command(training)
app.command(suites)
app.command(shrink)
