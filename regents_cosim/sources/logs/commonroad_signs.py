"""Signs of CommonRoad that limit the speed, by country. Their value is in m/s in every country.

Source: `TrafficSignID...` of commonroad-io 2024.3, MAX_SPEED and MAX_SPEED_ZONE_START. As in that library, an unknown
country counts as Zamunda, and 274 is a limit in every country. The library writes Greece's letter as a Greek rho; files
also write it as a P.
"""

import xml.etree.ElementTree as ET

from regents_cosim.sources.logs.xml_files import real

_EVERYWHERE = "274"
_ZONES = ("274.1",)
_LIMITS: dict[str, tuple[str, ...]] = {
    "ZAM": _ZONES, "DEU": _ZONES, "CHN": (), "ITA": (), "USA": ("R2-1",), "PRI": ("R2-1",), "ESP": ("r301",),
    "RUS": ("3.24",), "ARG": ("R15",), "BEL": ("C43",), "FRA": ("B14",),
    "GRC": ("\N{GREEK CAPITAL LETTER RHO}-32", "P-32"),
    "HRV": ("B31",), "AUS": (),
}  # fmt: skip


def country_of(benchmark: str) -> str:
    """The country in a benchmark's id: three letters, after `C-` for cooperative problems."""
    return benchmark.removeprefix("C-")[:3]


def limit_of(sign: ET.Element, country: str) -> float | None:
    """The speed limit of a sign of a country [m/s], the lowest where it has several; None where it limits none."""
    known = (_EVERYWHERE, *_LIMITS.get(country, _ZONES))
    parts = [
        part for part in sign.iter("trafficSignElement") if (part.findtext("trafficSignID") or "").strip() in known
    ]
    values = [real(value.text) for part in parts for value in part.findall("additionalValue")[:1]]
    return min((value for value in values if 0 < value < 100), default=None)
