"""Describe a camera: where it is, where it looks, and what it takes in."""

from dataclasses import dataclass

from karma.contracts import Vec3


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """One camera; angles as Unity gives them: pitch (down positive), yaw (0 = +z), roll."""

    position_m: Vec3
    rotation_deg: Vec3 = (0.0, 0.0, 0.0)
    fov_deg: float = 90.0  # vertical; of a perspective camera
    orthographic: bool = False
    orthographic_size_m: float = 0.0  # half the height of what an orthographic camera takes in
    near_m: float = 0.01
    far_m: float = 20.0
    sky: str = ""  # colour of what is not there, e.g. "white" or "#8080ff"; "" = the default sky
