"""Gaussian-splat scenes from posed RGB-D frames, learned in closed form, one frame at a time.

Poses are camera-to-world matrices in OpenCV axes: x right, y down, z forward. Lengths are in world units, the unit of
the poses. Rotations are quaternions (w, x, y, z). Colours are sRGB-encoded. H and W are height and width in pixels.
"""

from os import PathLike
from typing import Any, Iterator, Literal, Sequence, TypedDict, final, overload

import numpy as np
from numpy.typing import NDArray

class Learned(TypedDict):
    """Result of a frame."""

    points: int
    """Number of points learned; 0 if the frame contradicts the scene."""
    elbo: float
    """Mean evidence lower bound of the points before they were learned, nats."""
    new_components: int
    components: int
    """Number of components in use after the frame."""
    is_lost: bool
    """True if the pose was to be tracked (`track`) and was not found; the frame is then not learned."""
    train_ms: float
    """Time of training, without preparing the frame, milliseconds."""

class Splats(TypedDict):
    """Splats as drawn; n is their number."""

    mean: NDArray[np.float32]
    """Centres, shape (n, 3)."""
    scale: NDArray[np.float32]
    """Standard deviations along the axes of the splat, shape (n, 3)."""
    rotation: NDArray[np.float32]
    """Unit quaternions, shape (n, 4)."""
    opacity: NDArray[np.float32]
    """Peak opacities, shape (n,); above 1 the top is flat."""
    color: NDArray[np.float32]
    """Shape (n, 3), about 0 to 1."""
    gradient: NDArray[np.float32]
    """Change of colour per world unit from the centre, shape (n, 3 channels, 3 axes)."""
    directional: NDArray[np.float32]
    """Change of colour with the unit direction from camera to centre, shape (n, 3 channels, 3 axes)."""

class Posterior(TypedDict):
    """Posterior of the components with points; n is their number."""

    count: NDArray[np.float64]
    """Number of points, shape (n,)."""
    mean: NDArray[np.float64]
    """Expected positions, shape (n, 3)."""
    covariance: NDArray[np.float64]
    """Expected covariances of position, shape (n, 3, 3), world units squared."""
    color: NDArray[np.float64]
    """Expected colours, shape (n, 3)."""
    normal: NDArray[np.float64]
    """Unit normals towards the cameras, shape (n, 3); NaN where unknown."""

class Picture(TypedDict):
    color: NDArray[np.float32]
    """Shape (H, W, 3), 0 to 1."""
    depth: NDArray[np.float32]
    """Shape (H, W); 0 where nothing is drawn. Along the optical axis, or along the ray of the exact renderer."""
    coverage: NDArray[np.float32]
    """Shape (H, W), 0 to 1."""

@final
class Frame:
    """Frame of a recording."""

    @property
    def name(self) -> str: ...
    @property
    def color(self) -> NDArray[np.uint8]:
        """Photograph, shape (height, width, 4); it may be larger than the depth image."""
    @property
    def depth(self) -> NDArray[np.float32] | None:
        """Depth along the optical axis, shape (H, W); 0 where unknown."""
    @property
    def pose(self) -> NDArray[np.float64]:
        """Camera-to-world matrix of the depth camera, shape (4, 4)."""
    @property
    def intrinsics(self) -> tuple[float, float, float, float]:
        """(fx, fy, cx, cy) of the depth camera, pixels."""
    @property
    def size(self) -> tuple[int, int]:
        """(W, H) of the depth image."""

@final
class Recording:
    """Frames of one split of a recording, decoded when they are indexed."""

    @property
    def splits(self) -> list[str]: ...
    def __len__(self) -> int: ...
    def __getitem__(self, index: int) -> Frame:
        """Decodes a frame. Raises `IndexError` beyond the last frame, `ValueError` for unreadable files."""
    def __iter__(self) -> Iterator[Frame]: ...
    def scene(self, **settings: Any) -> Scene:
        """Creates an empty scene with the settings that the program chooses for this recording.

        `settings` are those of `vbgs-studio train --set NAME=VALUE`.
        """

def read(path: str | PathLike[str], split: str | None = None) -> Recording:
    """Opens a recording in any layout that the program opens; `demo` is the built-in synthetic room.

    Raises `ValueError` with what was expected and found.
    """

@final
class Scene:
    """Scene that learns frame by frame. It may be shared by threads: calls take turns, without the interpreter's lock."""

    def __init__(
        self,
        intrinsics: Sequence[float] | Sequence[Sequence[float]] | NDArray[np.float64],
        size: tuple[int, int],
        scale: float,
        *,
        sensor: Literal["lidar", "kinect", "exact", "inverse8-ray"] = "lidar",
        depth_kind: Literal["z", "ray"] = "z",
        depth_range: tuple[float, float] = (0.0, float("inf")),
        origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
        **settings: Any,
    ) -> None:
        """Creates an empty scene for frames given as arrays.

        `intrinsics`: (fx, fy, cx, cy) or a 3x3 matrix, pixels. `size`: (W, H). `scale`: structural scale, the size of the
        components in world units; about 2.5 pixels at the usual distance are a good choice. `sensor` chooses the noise
        of depth. `depth_kind`: depth along the optical axis or along each pixel's ray. `depth_range`: depths outside are
        ignored. `origin`: a position near the scene if it is far from zero. `settings` are those of
        `vbgs-studio train --set NAME=VALUE`, such as `photometric="off"`, `textures=0` or `budget=20000`.

        Raises `ValueError` for values out of range, `TypeError` for unknown settings.
        """
    @overload
    def learn(self, color: Frame) -> Learned: ...
    @overload
    def learn(
        self, color: NDArray[np.uint8], depth: NDArray[np.float32], pose: NDArray[np.float64]
    ) -> Learned:
        """Learns a frame completely or, if it raises, not at all.

        `color`: shape (H, W, 3) or (H, W, 4), registered to depth; pixels that are not opaque are ignored. `depth`: shape
        (H, W), world units; NaN, infinity, 0 and negative values are holes. `pose`: shape (4, 4). Arrays in row-major
        order are read in place, others are copied.

        Raises `TypeError` for another element type or number of axes, `ValueError` for another size or a matrix that is no
        rigid pose.
        """
    def __len__(self) -> int:
        """Number of components in use."""
    def splats(self) -> Splats: ...
    def posterior(self) -> Posterior: ...
    def save(self, path: str | PathLike[str]) -> tuple[int, int]:
        """Writes the splats by the file's ending: `.ply`, `.glb` or `.spz`. Returns the numbers of splats and bytes.

        Raises `ValueError` if nothing was learned, the ending is unknown, or the file cannot be written.
        """
    def render(
        self,
        pose: NDArray[np.float64],
        intrinsics: Sequence[float] | NDArray[np.float64] | None = None,
        size: tuple[int, int] | None = None,
        *,
        renderer: Literal["projected", "exact"] = "projected",
        background: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> Picture:
        """Renders the scene on the CPU; by default with the camera of the scene's frames."""
