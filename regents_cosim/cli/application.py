"""All commands together."""

from regents_cosim.cli.bench import bench
from regents_cosim.cli.commands import app, training
from regents_cosim.cli.shrink import shrink
from regents_cosim.cli.suite import suites

app.help_epilogue = (
    "Exit codes: 0 all is well; 1 a negative verdict (a crash that did not transfer, a regression, a suite that fails "
    "its check); 2 wrong usage or input; 3 an optional package or a library of the system is missing; 4 a planner "
    "failed in at least one case, the others are done; 130 interrupted, 143 terminated."
)

app.command(bench)
app.command(training)
app.command(suites)
app.command(shrink)
