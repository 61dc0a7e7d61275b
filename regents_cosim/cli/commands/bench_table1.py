"""`regents bench table1`: the results table of the ReGentS paper, on any traffic."""

from pathlib import Path
from typing import Literal

from regents_cosim.cli.options import Count, Networks, OutputIfAny, OutputOptions, SearchRules, Seed
from regents_cosim.cli.shared import open_terminal

Method = Literal[
    "king", "regents", "king-code", "regents-code", "focused", "random", "cma-es", "starts", "sumo-aggressive"
]


def table1(
    *,
    count: Count = 34,
    seed: Seed = 0,
    nets: Networks = (),
    logs: tuple[Path, ...] = (),
    prefer: Literal["conflicts", "none"] = "conflicts",
    planners: tuple[str, ...] = ("idm",),
    methods: tuple[Method, ...] = (),
    equal_protocol: bool = False,
    tuned_on: tuple[str, ...] = (),
    rules: SearchRules = SearchRules(),
    output: OutputIfAny = None,
    talk: OutputOptions = OutputOptions(),
) -> int:
    """Make the results table of the ReGentS paper on your own traffic, with additional measures.

    Every crash is judged and verified in SUMO, and every pair of methods is compared on the same windows.

    Parameters
    ----------
    count
        windows per network
    logs
        logged traffic (files, or folders of them), with `count` windows of each; replaces the networks, or is added to
        those that `nets` names
    prefer
        which egos come first: those whose path another vehicle can cross or join within the window, or none
    planners
        systems under test; log_replay is the open loop, in which the ego replays its track
    methods
        king and regents as in the papers, focused (the default: these three); king-code and regents-code as in the
        public code; for comparison random, cma-es, starts (only the initial drives of focused, without a search) and
        sumo-aggressive
    equal_protocol
        also run king, regents, focused, random, cma-es and starts by the rules of focused (per candidate, with the same
        candidates, attempts, roll-outs, accepted crashes and reactions), so that only the methods differ; king and
        regents as in their papers stay in the table
    tuned_on
        places (names of networks or files, * stands for any letters) that a method was tuned on; the others were held
        out, and are shown separately
    output
        folder for table1.md, table1.json, table1.png and usual.png (telling crashes by how usual the adversary is), and
        for the runs. Finished runs are not repeated, so that an interrupted table can be continued, and a table of more
        places reuses the runs of a smaller one
    """
    from regents_cosim.benchmarks.runs import columns, tables
    from regents_cosim.benchmarks.table1 import as_json, require_places
    from regents_cosim.benchmarks.table1 import table1 as make_table
    from regents_cosim.benchmarks.table1_sections import markdown, sections
    from regents_cosim.benchmarks.traffic import traffic_of

    wanted = columns(methods, equal_protocol, vars(rules))
    terminal = open_terminal(talk)
    places = traffic_of(nets, logs, count, seed, prefer, terminal)
    require_places([window for found in places for window in found], tuned_on)
    grown = tables(places, planners, wanted, tuned_on=tuned_on, output=output, progress=terminal)
    *_, found = make_table([]), *grown
    grids = [(part.title.lstrip("# "), part.rows()) for part in sections(found)]
    terminal.publish(markdown(found), as_json(found), grids)
    return 0
