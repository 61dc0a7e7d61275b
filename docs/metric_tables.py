"""The tables of the metrics and of their columns, made from their declarations when the site is built."""

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import Files
from mkdocs.structure.pages import Page

from regents_cosim.evaluation.drives.driving import COUNTS
from regents_cosim.evaluation.drives.metrics import METRICS

MARKER = "<!-- the tables of the metrics -->"


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """The page with the tables in place of the marker."""
    return markdown.replace(MARKER, metric_tables()) if MARKER in markdown else markdown


def metric_tables() -> str:
    """A row for each metric of a drive, then one for each number that is counted over drives."""
    lines = ["| metric | in `--fail-on` | better | meaning | over drives |", "|---|---|---|---|---|"]
    for one in METRICS:
        known_as = "" if one.name is None else f"`{one.name or one.field}`"
        meaning = f"{one.meaning} [{one.unit}]" if one.unit else one.meaning
        columns = ", ".join(f"`{column.name}`" for column in one.columns)
        lines.append(f"| `{one.field}` | {known_as} | {one.better} | {meaning} | {columns} |")
    lines += ["", "| over drives | meaning |", "|---|---|", *(f"| `{one.name}` | {one.meaning} |" for one in COUNTS)]
    return "\n".join(lines)
