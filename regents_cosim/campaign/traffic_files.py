"""A digest of the files that traffic is recorded from, by which changed files count as other traffic."""

import hashlib
import json
from pathlib import Path

from regents_cosim.campaign.planner_files import planner_digest
from regents_cosim.cases.provenance import sha256_of
from regents_cosim.errors import require_file
from regents_cosim.sources.logs.record import digest_of
from regents_cosim.sources.record import LogInput
from regents_cosim.sources.sumo_config import SumoInput, read_input


def traffic_digest(source: SumoInput | LogInput | str, fcd: Path | None = None, policy: str = "") -> str:
    """SHA-256 of all files behind the traffic. Raises RegentsError where one is missing."""
    if isinstance(source, str):
        said = [planner_digest(policy)]
    elif isinstance(source, LogInput):
        said = [digest_of(path) for path in (source.path, source.map, source.columns) if path is not None]
    else:
        said = _sumo(source, fcd)
    return hashlib.sha256(json.dumps(said).encode()).hexdigest()


def _sumo(source: SumoInput, fcd: Path | None) -> list[str]:
    options = read_input(source)
    named = [path for paths in options.read.values() for path in paths if path.is_file()]
    files = [options.file, options.net, *options.files, *named, *([fcd] if fcd else [])]
    for file in files:
        require_file(file, "file of the traffic")
    return [*map(sha256_of, files), json.dumps([options.others, options.typed], sort_keys=True)]
