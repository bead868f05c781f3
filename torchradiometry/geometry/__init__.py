"""WHERE: points, directions, solid angles, polygons, and integrals over the hemisphere."""

from torchradiometry.geometry.cameras import (
    AbstractCamera,
    OrthographicCamera,
    PinholeCamera,
    Rays,
    look_at,
    rigid,
)
from torchradiometry.geometry.clipping import clip_polygon
from torchradiometry.geometry.depth import (
    DepthToNormals,
    DepthToPoints,
    depth_to_normals,
    depth_to_points,
    points_to_normals,
)
from torchradiometry.geometry.depth_mesh import depth_to_mesh
from torchradiometry.geometry.directions import local_frame, reflect, spherical_direction
from torchradiometry.geometry.heights import Heights, normals_to_heights
from torchradiometry.geometry.meshes import (
    corner_angles,
    face_areas,
    face_corners,
    face_normals,
    vertex_normals,
)
from torchradiometry.geometry.patches import Patches, subdivide, vector_area
from torchradiometry.geometry.polygon_irradiance import (
    polygon_irradiance,
    polygon_vector_irradiance,
)
from torchradiometry.geometry.quadrature import (
    HemisphereQuadrature,
    hemisphere_quadrature,
    integrate_hemisphere,
)
from torchradiometry.geometry.solid_angle import (
    solid_angle_cone,
    solid_angle_patch,
    solid_angle_polygon,
    solid_angle_sphere,
    solid_angle_triangle,
)
from torchradiometry.geometry.triangulation import triangulate_polygon

__all__ = [
    "AbstractCamera",
    "DepthToNormals",
    "DepthToPoints",
    "Heights",
    "HemisphereQuadrature",
    "OrthographicCamera",
    "Patches",
    "PinholeCamera",
    "Rays",
    "clip_polygon",
    "corner_angles",
    "depth_to_mesh",
    "depth_to_normals",
    "depth_to_points",
    "face_areas",
    "face_corners",
    "face_normals",
    "hemisphere_quadrature",
    "integrate_hemisphere",
    "local_frame",
    "look_at",
    "normals_to_heights",
    "points_to_normals",
    "polygon_irradiance",
    "polygon_vector_irradiance",
    "reflect",
    "rigid",
    "solid_angle_cone",
    "solid_angle_patch",
    "solid_angle_polygon",
    "solid_angle_sphere",
    "solid_angle_triangle",
    "spherical_direction",
    "subdivide",
    "triangulate_polygon",
    "vector_area",
    "vertex_normals",
]
