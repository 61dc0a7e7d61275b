"""What observed positions tell about motion: where a track breaks, and how fast it goes."""

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.geometry.frames import wrap

# A jump differs from its neighbours by more than the hardest brake can (9 m/s^2, SUMO's emergency
# deceleration) and 0.4 m. Measured with lane changes of 3 s: 0.013 to 0.032 % of the steps of three
# real cities (25 slots each) are beyond 0.49 m.
_HARDEST = 9.0  # [m/s^2]
_JUMP_M = 0.4


def smooth_pieces(
    x: Float[np.ndarray, "agent time"],
    y: Float[np.ndarray, "agent time"],
    valid: Bool[np.ndarray, "agent time"],
    dt: float,
) -> Bool[np.ndarray, "agent time"]:
    """Of every track the longest piece without gap or jump, the first on a tie; at least 2 steps.

    A step is a jump if its displacement differs from those of the step before and of the step
    after by more than 0.4 m + 9 m/s^2 dt^2 (0.49 m at 0.1 s): the vehicle was moved (teleported,
    put on another lane). Positions decide, not reported speeds: SUMO's differ from the geometry
    in junctions, and logs may hold none.
    """
    links = valid[:, :-1] & valid[:, 1:]
    links &= ~jumps(x, y, links, dt)
    run = np.zeros(len(x), int)
    longest, end = run.copy(), run.copy()
    for step in range(links.shape[1]):
        run = (run + 1) * links[:, step]
        end = np.where(run > longest, step + 1, end)
        longest = np.maximum(longest, run)
    time = np.arange(x.shape[1])
    inside = (time >= (end - longest)[:, None]) & (time <= end[:, None])
    return inside & (longest > 0)[:, None]


def jumps(
    x: Float[np.ndarray, "agent time"],
    y: Float[np.ndarray, "agent time"],
    links: Bool[np.ndarray, "agent time-1"],
    dt: float,
) -> Bool[np.ndarray, "agent time-1"]:
    """Steps between samples that follow each other (`links`) in which one was moved, as `smooth_pieces` has it."""
    change = np.abs(np.diff(np.diff(x + 1j * y)))
    change = np.where(links[:, :-1] & links[:, 1:], change, np.inf)
    border = np.full((len(x), 1), np.inf)
    least = np.minimum(np.hstack([border, change]), np.hstack([change, border]))
    return np.isfinite(least) & (least > _JUMP_M + _HARDEST * dt**2)


def speeds(
    x: Float[np.ndarray, "agent time"],
    y: Float[np.ndarray, "agent time"],
    yaw: Float[np.ndarray, "agent time"],
    valid: Bool[np.ndarray, "agent time"],
    dt: float,
) -> Float[np.ndarray, "agent time"]:
    """Speed of the box centre along its heading [m/s], never negative, 0 where invalid.

    Each displacement is projected on the heading midway; v[k] = (s[k+1] - s[k-1]) / (2 dt) of
    the distance s gone so far, of second order at the ends too: (-3 s[k] + 4 s[k+1] - s[k+2]) / (2 dt).
    So speed and positions agree and a bicycle can follow both; the speed that SUMO reports
    belongs to the next step and to the front bumper.
    """
    links = valid[:, :-1] & valid[:, 1:]
    middle = yaw[:, :-1] + 0.5 * wrap(np.diff(yaw))
    gone = np.where(links, np.diff(x) * np.cos(middle) + np.diff(y) * np.sin(middle), np.nan) / dt
    border = np.full((len(x), 2), np.nan)
    padded = np.hstack([border, gone, border])
    before2, before, after, after2 = padded[:, :-3], padded[:, 1:-2], padded[:, 2:-1], padded[:, 3:]
    found = 0.5 * (before + after)
    for near, far in ((after, after2), (before, before2)):
        for estimate in (1.5 * near - 0.5 * far, near):
            found = np.where(np.isnan(found), estimate, found)
    return np.where(valid & ~np.isnan(found), np.maximum(found, 0.0), 0.0)
