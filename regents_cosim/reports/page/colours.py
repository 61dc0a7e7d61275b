"""Colours of the report's page in its light and dark mode, equal to those of the pictures where both have them.

Text is darker than bodies of its colour in the light mode and brighter in the dark mode, so that it has the contrast of
4.5 that WCAG 2.1 (1.4.3) requires.
"""

from regents_cosim.reports.drawing.palette import (
    ADVERSARY,
    BURST,
    EGO,
    EVASION,
    FAINT_INK,
    HAIRLINE,
    INK,
    KERB,
    LAND,
    MARKING,
    OTHER,
    PANEL,
    PAVEMENT,
    ROAD,
    SECOND,
    SIGNAL_AMBER,
    SIGNAL_GREEN,
    SIGNAL_OFF,
    SIGNAL_RED,
    Colour,
    mix,
)

_NIGHT: Colour = (17, 20, 25)
_WHITE: Colour = (255, 255, 255)
_LIGHTS = {"burst": BURST, "red": SIGNAL_RED, "amber": SIGNAL_AMBER, "green": SIGNAL_GREEN, "off": SIGNAL_OFF}


def _css(colours: dict[str, Colour]) -> dict[str, str]:
    return {name: "#{:02x}{:02x}{:02x}".format(*colour) for name, colour in colours.items()}


LIGHT = _css(
    {
        "page": (250, 250, 248), "panel": PANEL, "hairline": HAIRLINE, "ink": INK, "faint": FAINT_INK,
        "land": LAND, "road": ROAD, "kerb": KERB, "pavement": PAVEMENT, "marking": MARKING, "other": OTHER,
        "ego": EGO, "adversary": ADVERSARY, "second": SECOND, "evasion": EVASION,
        "ego-ink": mix(EGO, INK, 0.1), "adversary-ink": mix(ADVERSARY, INK, 0.35),
        "second-ink": mix(SECOND, INK, 0.25), "evasion-ink": mix(EVASION, INK, 0.2),
        **_LIGHTS,
    }
)  # fmt: skip
DARK = _css(
    {
        "page": _NIGHT, "panel": (25, 29, 36), "hairline": (48, 54, 64), "ink": (232, 235, 240),
        "faint": (160, 169, 181), "land": (22, 26, 31), "road": (50, 56, 66), "kerb": (78, 86, 98),
        "pavement": (38, 43, 50),
        "marking": (120, 128, 140), "other": (128, 137, 150),
        "ego": mix(EGO, _WHITE, 0.3), "adversary": mix(ADVERSARY, _WHITE, 0.15),
        "second": mix(SECOND, _WHITE, 0.25), "evasion": mix(EVASION, _WHITE, 0.3),
        "ego-ink": mix(EGO, _WHITE, 0.5), "adversary-ink": mix(ADVERSARY, _WHITE, 0.35),
        "second-ink": mix(SECOND, _WHITE, 0.5), "evasion-ink": mix(EVASION, _WHITE, 0.5),
        **_LIGHTS,
    }
)  # fmt: skip
