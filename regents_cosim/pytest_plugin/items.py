"""A suite as pytest collects it: a file, with an item for each case."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

    import pluggy

    from regents_cosim.evaluation.regression.comparison import RegressionVerdict
    from regents_cosim.pytest_plugin.session import SuiteSession


class SuiteFile(pytest.File):
    """The file suite.json, whose items are the cases."""

    def __init__(self, *, run: SuiteSession, **rest: Any) -> None:
        super().__init__(**rest)
        self.run = run

    @property
    def ihook(self) -> pluggy.HookRelay:
        """Hooks, including those of the user's `conftest.py` files, although pytest did not walk through the suite's
        folders.
        """
        return self.session.gethookproxy(self.run.near(self.path.parent))

    def collect(self) -> Iterator[pytest.Item]:
        """The cases in the order of the manifest."""
        suite = self.path.parent
        for case in self.run.chosen.get(suite, self.run.cases[suite]):
            yield CaseItem.from_parent(self, name=case, run=self.run, suite=suite)


class CaseItem(pytest.Item):
    """One case, which passes unless the planner got worse in it."""

    def __init__(self, *, run: SuiteSession, suite: Path, **rest: Any) -> None:
        super().__init__(**rest)
        self.run, self.suite, self.folder = run, suite, suite / self.name
        self.verdict: RegressionVerdict | None = None
        self.adversary = ""
        self.properties: list[tuple[str, str]] = []
        self._mark()

    @property
    def ihook(self) -> pluggy.HookRelay:
        """The hooks of the suite."""
        assert self.parent is not None
        return self.parent.ihook

    def _mark(self) -> None:
        from regents_cosim.errors import CaseError
        from regents_cosim.evaluation.suites.cards import card_of

        try:
            card = card_of(self.folder)
        except CaseError:
            return  # running the case reports the error
        self.adversary, self.properties = card.adversary_in_words, card.properties
        tags = card.tags.split(", ") if card.tags else []
        said = {
            "suite": self.suite.name, "collision_type": card.collision_type,
            "network": card.network, "planner": card.planner,
        }  # fmt: skip
        self.add_marker(pytest.mark.regents(**said, **dict.fromkeys(tags, True)))
        self.extra_keyword_matches |= {card.collision_type, card.network, *tags}

    def runtest(self) -> None:
        """Drive the case and judge the drive."""
        self.verdict = self.run.judge(self.suite, self.name)
        now = self.verdict.now
        accepted, reasons = self.run.accepts(self.verdict), "; ".join(self.verdict.reasons)
        self.user_properties += [("verdict", self.verdict.status), ("gate", "passed" if accepted else "failed")]
        self.user_properties += [("reasons", reasons)] if reasons else []
        self.user_properties += [*now.properties, *self.properties]
        self.user_properties += [("in_words", self.verdict.words)] if self.verdict.words else []
        if not accepted:
            raise _RegressionError(self.verdict)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Describe the case, the adversary, the outcome, the baseline, and how to watch it; without our traceback."""
        from regents_cosim.errors import RegentsError
        from regents_cosim.evaluation.regression.comparison import explain

        if isinstance(excinfo.value, _RegressionError):
            folder = _relative(self.folder, self.config.invocation_params.dir)
            of, (planner, where) = excinfo.value.verdict, (self.run.planner, self.run.where)
            return explain(of, folder, planner, where, self.adversary)
        if isinstance(excinfo.value, RegentsError):
            return f"{self.name}: {excinfo.value}"
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """The heading of a failure."""
        return self.path, None, f"{self.suite.name}::{self.name}"


class _RegressionError(Exception):
    """A verdict that does not pass."""

    def __init__(self, verdict: RegressionVerdict) -> None:
        super().__init__("; ".join(verdict.reasons))
        self.verdict = verdict


def _relative(folder: Path, start: Path) -> Path:
    return folder.relative_to(start) if folder.is_relative_to(start) else folder
