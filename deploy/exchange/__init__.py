"""Maps and worlds as files of other programs."""

from collections.abc import Mapping

from deploy.exchange import map_server, vector
from deploy.exchange.maps import Form

FORMS: Mapping[str, Mapping[str, Form]] = {
    "map_server": {"pgm": map_server.pgm, "yaml": map_server.description},
    "geojson": {"geojson": vector.geojson},
    "dxf": {"dxf": vector.dxf},
    "svg": {"svg": vector.svg},
}
"""By name, what makes each file of a map in that form, by its suffix."""
