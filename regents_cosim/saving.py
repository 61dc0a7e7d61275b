"""Save cases with their tags and behaviour: into a suite that lists them, or unlisted."""

import logging
from dataclasses import replace
from pathlib import Path

from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.files import load_header, write_case
from regents_cosim.cases.header import HEADER
from regents_cosim.cases.manifest import MANIFEST, Suite, SuiteEntry, listed_in, load_manifest, save_suite
from regents_cosim.cases.provenance import made_by, versions
from regents_cosim.cases.shipped import require_own
from regents_cosim.checks.arguments import require_a
from regents_cosim.checks.names import file_name
from regents_cosim.errors import CaseError
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.files.atomic import explain_write, require_writable
from regents_cosim.system.files.locks import writing
from regents_cosim.system.files.swap import restore
from regents_cosim.system.interruption import announce_kept, uninterrupted
from regents_cosim.tags.table import tags_of
from regents_cosim.verdicts.behaviour import behaviour_of

_log = logging.getLogger(__name__)
_HASH = 8  # digits of the hash behind a name that is taken


class SuiteWriter:
    """Add cases to a folder, beside those that it holds already; a case of the same name is replaced."""

    def __init__(self, folder: Path, seed: int | None = None) -> None:
        """`seed` is noted in the manifest; by default the seed that is noted there already, or 0.

        Raises RegentsError where `folder` cannot be written, is a case, or its manifest cannot be read.
        """
        require_own(folder, "--output")
        require_writable(folder)
        if (folder / HEADER).exists():
            raise CaseError(f"{folder} is a case, expected a folder for cases (choose another with -o)")
        known = load_manifest(folder).seed if (folder / MANIFEST).exists() else 0
        self.folder = folder
        self.seed = known if seed is None else seed
        self._added = 0

    def add(self, scenario: Scenario) -> Path:
        """Save a case and list it beside those that others have added meanwhile; return the case's folder."""
        with uninterrupted():
            saved = add_case(scenario, self.folder, Suite((), made_by(), self.seed, versions()))
            self._added += 1
        announce_kept(
            f"finished cases saved in {self.folder}: {self._added}; for the others run the same command again"
        )
        _log.info("saved %s", saved)
        return saved


def make_suite(folder: Path, seed: int) -> None:
    """Make a folder a suite without cases, unless it is a suite already. Raises RegentsError where it cannot be one."""
    restore(folder)
    SuiteWriter(folder, seed)
    if not (folder / MANIFEST).exists():
        with explain_write(folder):
            folder.mkdir(parents=True, exist_ok=True)
        save_suite(folder, Suite((), made_by(), seed, versions()))


def save_case(scenario: Scenario, suite: Path | str) -> Path:
    """Write `scenario` to `suite/<id>` and list it in the suite's manifest; return its folder.

    A new folder becomes a suite. A case of the same name is replaced, and all others stay. Raises RegentsError where
    the folder cannot be written, is a case, or its manifest cannot be read.
    """
    return SuiteWriter(Path(suite)).add(require_a(Scenario, scenario, "save_case takes one case"))


def add_case(scenario: Scenario, suite: Path, notes: Suite, *, beside: bool = False) -> Path:
    """Write `scenario` to `suite/<id>` and list it in the manifest beside the cases already listed; return its folder.

    With `beside` another case of that name stays, and this one gets its hash behind its name. The other fields of the
    manifest are taken from `notes`. Raises RegentsError where the folder cannot be written.
    """
    entry, computed = SuiteEntry(scenario.id, content_hash(scenario)), (tags_of(scenario), behaviour_of(scenario))
    with explain_write(suite):
        suite.mkdir(parents=True, exist_ok=True)
        with writing(suite):
            there = suite / entry.case
            if beside and (there / HEADER).is_file() and load_header(there).hash != entry.hash:
                scenario = replace(scenario, id=file_name(entry.case, entry.hash[:_HASH]))
                entry = SuiteEntry(scenario.id, entry.hash)
            known = listed_in(suite)
            manifest = replace(notes, cases=known, pending=entry)
            listed = any(one.case == entry.case for one in known)
            saved = write_case(scenario, *computed, suite, entry.hash, lambda: save_suite(suite, manifest), listed)
            save_suite(suite, manifest.having(entry))
    return saved


def save_unlisted(scenario: Scenario, folder: Path) -> Path:
    """Write `scenario` to `folder/<id>`, in the place of a case of that name, without listing it; return its folder.

    Raises RegentsError where the folder cannot be written.
    """
    computed = tags_of(scenario), behaviour_of(scenario)
    with explain_write(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with writing(folder):
            return write_case(scenario, *computed, folder, content_hash(scenario))
