"""A described world: surfaces, sources and cameras; glTF and meshes in, triangles out."""

from torchradiometry.scene.build import box, cornell_like_room, quad, room, sphere
from torchradiometry.scene.defaults import default_camera, default_light, with_default_view
from torchradiometry.scene.from_trimesh import surface_from_trimesh
from torchradiometry.scene.load import SCENE_ENDINGS, load_scene
from torchradiometry.scene.scene import Scene, Triangles
from torchradiometry.scene.standard import STANDARD_SCENES
from torchradiometry.scene.surface import Surface, Texture
from torchradiometry.scene.validate import Fault
from torchradiometry.scene.write import save_scene

__all__ = [
    "SCENE_ENDINGS",
    "STANDARD_SCENES",
    "Fault",
    "Scene",
    "Surface",
    "Texture",
    "Triangles",
    "box",
    "cornell_like_room",
    "default_camera",
    "default_light",
    "load_scene",
    "quad",
    "room",
    "save_scene",
    "sphere",
    "surface_from_trimesh",
    "with_default_view",
]
