"""The files that a mesh names: material files (`.mtl`) and textures, only those in its own folder.

trimesh goes on in silence without a file that it cannot find or read, and the mesh would come out
grey. So what is wrong with one of them is kept in `fault`.
"""

from __future__ import annotations

import io
import warnings
from pathlib import Path

from trimesh.resolvers import Resolver

from torchradiometry.errors import (
    FileFormatError,
    InputFileError,
    RadiometryError,
    ResourceLimitError,
)
from torchradiometry.files import MAX_BYTES, MAX_TEXT, check_readable, pillow
from torchradiometry.scene.gltf_container import confined
from torchradiometry.scene.wavefront import tidied_materials

__all__ = ["Beside"]


class Beside(Resolver):
    """What trimesh asks for the files that a mesh names.

    Args:
        mesh: the file of the mesh.
        room: bytes that all of them may have together.
    """

    def __init__(self, mesh: Path, room: int = MAX_BYTES) -> None:
        self.mesh, self.room = mesh, room
        self.fault: RadiometryError | None = None
        self.materials: set[str] | None = None  # names in the material file, if one was read

    def get(self, name: str) -> bytes:
        """The bytes of a file, whose name may be written as on Windows (`textures\\wood.png`)."""
        try:
            return self._read(str(name).strip().replace("\\", "/"))
        except RadiometryError as error:
            self.fault = self.fault or error
            raise
        except OSError as error:
            got = f"a name that the system refuses ({error})"[:300]
            self.fault = self.fault or InputFileError(str(self.mesh), got, "give the file another")
            raise

    def _read(self, name: str) -> bytes:
        path = confined(self.mesh.parent, name)
        if path is None:
            mend = "only files inside the folder of the mesh are opened"
            raise FileFormatError(str(self.mesh), f"the address {name[:80]!r}", mend)
        if not path.exists():
            mend = "put it beside the mesh, or take the line out that names it"
            raise InputFileError(str(self.mesh), f"the name of a missing file, {name[:80]!r}", mend)
        text = path.suffix.lower() == ".mtl"
        most = min(self.room, MAX_TEXT) if text else self.room
        data = check_readable(path, "material file or texture", most).read_bytes()
        self.room -= len(data)
        if text:
            data, self.materials = tidied_materials(path, data)
        else:
            _require_picture(path, data)
        return data

    def write(self, name: str, data: object) -> None:
        """Refused."""
        raise InputFileError(name, "a request to write it", "meshes are only read here")

    def namespaced(self, namespace: str) -> Beside:
        """The same in a folder below."""
        return Beside(self.mesh.parent / namespace / self.mesh.name, self.room)

    def keys(self) -> list[str]:
        """What lies beside the mesh."""
        return [child.name for child in self.mesh.parent.iterdir() if child.is_file()]


def _require_picture(path: Path, data: bytes) -> None:
    """A picture that Pillow opens; its pixels are decoded later."""
    library = pillow()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", library.DecompressionBombWarning)
            library.open(io.BytesIO(data)).close()
    except (library.DecompressionBombError, library.DecompressionBombWarning) as error:
        mend = f"shrink it to {library.MAX_IMAGE_PIXELS} pixels"
        raise ResourceLimitError(str(path), "more pixels than Pillow decodes", mend) from error
    except Exception as error:
        got = f"no picture that can be read ({type(error).__name__})"
        mend = "name a PNG or JPEG file; a file of materials ends in .mtl"
        raise FileFormatError(str(path), got, mend) from error
