"""Traffic for the tables: windows of SUMO networks and of logs."""

from collections.abc import Sequence
from pathlib import Path

from regents_cosim.cases.shipped import NETWORKS, network
from regents_cosim.scenario import Scenario
from regents_cosim.sources.record import LogInput, record
from regents_cosim.sources.windows import Prefer
from regents_cosim.system.progress import SILENT, Progress


def traffic_of(
    nets: Sequence[str],
    logs: Sequence[Path],
    count: int,
    seed: int,
    prefer: Prefer = "conflicts",
    progress: Progress = SILENT,
) -> list[list[Scenario]]:
    """Windows of networks and of logs, place by place: of the six shipped networks where neither is named."""
    networks = network_traffic(nets, count, seed, prefer, progress) if nets or not logs else {}
    recordings = logged_traffic(logs, count, seed, prefer, progress) if logs else {}
    return [found for found in (*networks.values(), *recordings.values()) if found] or [[]]


def network_traffic(
    nets: Sequence[str], count: int, seed: int, prefer: Prefer = "conflicts", progress: Progress = SILENT
) -> dict[str, list[Scenario]]:
    """Windows of SUMO networks, by network: of the six shipped ones of vehicles where none is named."""
    configs = {net: network(net) for net in nets or NETWORKS}
    return {
        net: record(config, count=count, seed=seed, prefer=prefer, progress=False)
        for net, config in progress.each(configs.items(), "recording traffic", len(configs))
    }


def logged_traffic(
    logs: Sequence[Path], count: int, seed: int, prefer: Prefer = "conflicts", progress: Progress = SILENT
) -> dict[Path, list[Scenario]]:
    """Windows of logs, by log."""
    return {
        log: record(LogInput(log), count=count, seed=seed, prefer=prefer, tell=progress.say, progress=False)
        for log in progress.each(logs, "reading logs", len(logs))
    }
