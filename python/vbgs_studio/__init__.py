"""Gaussian-splat scenes from posed RGB-D frames, learned in closed form, one frame at a time.

>>> import numpy as np, vbgs_studio
>>> scene = vbgs_studio.Scene(intrinsics=(120, 120, 80, 60), size=(160, 120), scale=0.03)
>>> report = scene.learn(np.full((120, 160, 3), 128, np.uint8), np.full((120, 160), 1.5, np.float32), np.eye(4))
>>> report["components"] > 100
True
"""

from ._engine import Frame, Recording, Scene, read

__all__ = ["Frame", "Recording", "Scene", "read"]
