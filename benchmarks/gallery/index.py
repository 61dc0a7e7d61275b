"""The page that shows the pictures, with what they show in words and in numbers of the run."""

from collections.abc import Sequence

from benchmarks.gallery.exhibits import METHOD_NAMES, PLANNER, ExhibitRun
from benchmarks.gallery.gradient_field import HELD_S, SPEED_M_S, GradientField
from regents_cosim.reports.drawing.texts.caption import ending
from regents_cosim.system.files.output_files import MARK

FIELD_PICTURE = "gradient_field.png"

_OPENING = f"""\
<!-- {MARK} -->
# What goes wrong with KING, and what ReGentS does about it

Gradients around the ego, and the four failures that the ReGentS paper (Yin et al., ECCV 2024 workshop W-CODA) names,
made again by `python -m benchmarks gallery`. The scenes are cars that drive straight on, built in code. KING, ReGentS
and our own preset `focused` attack them as they are, on the CPU, always with the same result; nothing is staged. The
ego replays its log (`{PLANNER}`). Every attacked scene is a case in `cases/`; watch one from this folder with

    regents replay cases/CASE --in mirror --record crash.gif
"""


def index_page(fields: Sequence[GradientField], runs: Sequence[ExhibitRun]) -> str:
    """README.md of a gallery; links are relative to its folder."""
    return "\n".join([_OPENING, _field_section(fields), *map(_section, runs)])


def _field_section(fields: Sequence[GradientField]) -> str:
    red, away, red_away, behind, converging = (
        sum(int(count.sum()) for count in counts)
        for counts in zip(
            *((f.red, f.leads_away, f.red & f.leads_away, f.behind, f.behind & f.converges) for f in fields),
            strict=True,
        )
    )
    return f"""\
## Gradients around the ego

![Arrows around the ego: behind it they lead to it, in front of it some lead away]({FIELD_PICTURE})

Minus the gradient of one term of C_ego_col (eq. 4), the distance at one moment, by a curvature and an acceleration that
the adversary held for the {HELD_S:g} s before, both at {SPEED_M_S:g} m/s.

Behind the ego the arrows **converge**: at {converging} of {behind} places in the rear sector descent accelerates and
turns to the ego. That makes rear-end crashes, so by rule 2 none that stays there is a candidate.

In front they **diverge**: at {away} places descent turns an agent that is turned away further away. {red_away} of them
lie in the red zone, which has {red} places: there rule 1 cancels the steering. The others lie straight ahead, on its
edge.
"""


def _section(run: ExhibitRun) -> str:
    exhibit = run.exhibit
    head = f"| | how it ended | iterations | distance of {exhibit.watched_name}: mean | least |"
    rows = [f"| before the attack | | | {_distances(run, None)} |"]
    for method, attacked in run.attacked.items():
        record = attacked.attack
        ended = ", ".join(ending(record.outcome, record.collision)) if record else ""
        case = f"[{METHOD_NAMES[method]}](cases/{attacked.id})"
        rows.append(f"| {case} | {ended} | {run.iterations(method)} | {_distances(run, method)} |")
    table = "\n".join([head, "|---|---|---|---|---|", *rows])
    picture = f"![{exhibit.title}: the scene before the attack and after each]({picture_name(run)})"
    return f"## {exhibit.title}\n\n{picture}\n\n{exhibit.failure}\n\n{exhibit.lesson(run)}\n\n{table}\n"


def picture_name(run: ExhibitRun) -> str:
    """File name of an exhibit's picture."""
    return f"{run.exhibit.name}.png"


def _distances(run: ExhibitRun, method: str | None) -> str:
    gap = run.gap(method)
    return f"{gap.mean():.1f} m | {gap.min():.1f} m"
