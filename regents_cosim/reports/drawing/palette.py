"""Colours of all pictures, and the fixed palette of the animations.

Ego and adversary are the blue and the vermilion that people with any colour vision can tell apart; the rest is grey.
Source: Okabe and Ito 2008, Color Universal Design, slightly brighter.
"""

import functools
import itertools

from PIL import Image

Colour = tuple[int, int, int]

LAND: Colour = (246, 245, 240)
ROAD: Colour = (216, 220, 226)
KERB: Colour = (176, 183, 193)
PAVEMENT: Colour = (231, 230, 225)  # walkways
MARKING: Colour = (255, 255, 255)
PANEL: Colour = (255, 255, 255)
HAIRLINE: Colour = (225, 228, 232)
INK: Colour = (27, 31, 36)
FAINT_INK: Colour = (90, 99, 110)
EGO: Colour = (8, 104, 201)
ADVERSARY: Colour = (226, 84, 10)
OTHER: Colour = (146, 154, 165)
BURST: Colour = (255, 200, 0)
SECOND: Colour = (170, 68, 142)  # another planner's ego; what a planner thought
SIGNAL_RED: Colour = (206, 17, 55)
SIGNAL_AMBER: Colour = (245, 170, 0)
SIGNAL_GREEN: Colour = (0, 158, 115)
SIGNAL_OFF: Colour = (120, 128, 138)
EVASION: Colour = (0, 128, 94)  # a darker bluish green of the same set

_RAMP = 6  # steps between two colours that meet at an antialiased edge
_APART = 7  # shades closer than this in every channel are merged
_MOST = 255  # a GIF holds 256; the last one means "unchanged"


def mix(a: Colour, b: Colour, share: float) -> Colour:
    """A mixture with the share `share` of b, and the rest of a."""
    red, green, blue = (round(x + share * (y - x)) for x, y in zip(a, b, strict=True))
    return red, green, blue


def shade(colour: Colour) -> Colour:
    """A darker tone for outlines and glass."""
    return mix(colour, INK, 0.45)


@functools.cache
def gif_palette() -> Image.Image:
    """The colours of all frames: those above, and the shades between them.

    A common palette is stored once, and pixels that do not change keep their value, so that only motion takes space.
    """
    bodies = (EGO, ADVERSARY, OTHER)
    lights = (SIGNAL_RED, SIGNAL_AMBER, SIGNAL_GREEN, SIGNAL_OFF)
    grounds = (PANEL, LAND, ROAD)
    inks = (*bodies, *map(shade, bodies), *lights, EVASION, SECOND, BURST, INK, FAINT_INK, KERB)
    pairs = [
        *itertools.product(grounds, inks),
        *((body, shade(body)) for body in bodies),
        *((BURST, INK), (BURST, ADVERSARY), (ROAD, MARKING), (PANEL, HAIRLINE)),
    ]
    colours: list[Colour] = []
    shades = (mix(a, b, k / _RAMP) for a, b in pairs for k in range(1, _RAMP))
    for colour in (*grounds, *inks, HAIRLINE, PAVEMENT, *shades):
        if all(max(abs(x - y) for x, y in zip(colour, kept, strict=True)) >= _APART for kept in colours):
            colours.append(colour)
    image = Image.new("P", (1, 1))
    image.putpalette([channel for colour in colours[:_MOST] for channel in colour])
    return image
