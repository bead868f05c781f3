"""WHO EMITS: each source answers which light arrives at a point."""

from torchradiometry.sources.base import (
    AbstractSource,
    Arrival,
    arrive,
    arriving_irradiance,
    irradiance,
    light_first,
)
from torchradiometry.sources.directional import (
    DirectionalSource,
    directional_arrival,
    directional_irradiance,
)
from torchradiometry.sources.dome import AmbientDome, dome_arrival
from torchradiometry.sources.harmonics import (
    HarmonicSource,
    harmonic_arrival,
    harmonic_basis,
    project_harmonics,
)
from torchradiometry.sources.point import PointSource, lamp_radius, point_arrival
from torchradiometry.sources.polygon import (
    PolygonSource,
    SamplePlaces,
    place_samples,
    polygon_arrival,
    polygon_samples,
)
from torchradiometry.sources.sphere import (
    SphereSource,
    fibonacci_directions,
    sphere_arrival,
    sphere_samples,
)
from torchradiometry.sources.sphere_irradiance import sphere_vector_irradiance
from torchradiometry.sources.spot import SpotSource, cone_attenuation, spot_arrival

__all__ = [
    "AbstractSource",
    "AmbientDome",
    "Arrival",
    "DirectionalSource",
    "HarmonicSource",
    "PointSource",
    "PolygonSource",
    "SamplePlaces",
    "SphereSource",
    "SpotSource",
    "arrive",
    "arriving_irradiance",
    "cone_attenuation",
    "directional_arrival",
    "directional_irradiance",
    "dome_arrival",
    "fibonacci_directions",
    "harmonic_arrival",
    "harmonic_basis",
    "irradiance",
    "lamp_radius",
    "light_first",
    "place_samples",
    "point_arrival",
    "polygon_arrival",
    "polygon_samples",
    "project_harmonics",
    "sphere_arrival",
    "sphere_samples",
    "sphere_vector_irradiance",
    "spot_arrival",
]
