#!/usr/bin/env python3
"""Logs a training run to the viewer of rerun (https://rerun.io): frames, camera path and splats while they grow.

    pip install ./python rerun-sdk
    python3 examples/log_to_rerun.py room [--save run.rrd]

Rerun draws points, not splats: each splat is logged as an ellipsoid of its standard deviations.
"""

import argparse

import rerun as rr
import vbgs_studio

EVERY = 5  # frames between logs of the whole scene
MOST = 20_000  # ellipsoids in a log


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("recording", help="folder or archive; `demo` is the built-in room")
    arguments.add_argument("--save", metavar="FILE.rrd", help="write a file instead of opening the viewer")
    arguments.add_argument("--frames", type=int, help="learn the first frames only")
    asked = arguments.parse_args()
    rr.init("vbgs-studio", spawn=asked.save is None)
    if asked.save:
        rr.save(asked.save)
    recording = vbgs_studio.read(asked.recording)
    scene = recording.scene()
    path = []
    for number in range(len(recording))[: asked.frames]:
        frame = recording[number]
        report = scene.learn(frame)
        rr.set_time("frame", sequence=number)
        path.append(frame.pose[:3, 3])
        log_camera(frame)
        rr.log("world/path", rr.LineStrips3D([path]))
        rr.log("components", rr.Scalars(report["components"]))
        rr.log("train_ms", rr.Scalars(report["train_ms"]))
        if number % EVERY == 0 or number + 1 == len(recording):
            log_splats(scene)


def log_camera(frame):
    fx, fy, cx, cy = frame.intrinsics
    width, height = frame.size
    rr.log("world/camera", rr.Transform3D(translation=frame.pose[:3, 3], mat3x3=frame.pose[:3, :3]))
    camera = rr.Pinhole(
        focal_length=(fx, fy), principal_point=(cx, cy), width=width, height=height,
        camera_xyz=rr.ViewCoordinates.RDF,
    )
    rr.log("world/camera/depth", camera)
    rr.log("world/camera/depth/image", rr.DepthImage(frame.depth, meter=1.0))
    rr.log("photograph", rr.Image(frame.color[..., :3]).compress(jpeg_quality=80))


def log_splats(scene):
    splats = scene.splats()
    # The most opaque ones, in order, so that the picture stays the same from log to log.
    chosen = (-splats["opacity"]).argsort(kind="stable")[:MOST]
    w, x, y, z = splats["rotation"][chosen].T
    ellipsoids = rr.Ellipsoids3D(
        centers=splats["mean"][chosen],
        half_sizes=splats["scale"][chosen],
        quaternions=[rr.Quaternion(xyzw=each) for each in zip(x, y, z, w)],
        colors=splats["color"][chosen].clip(0, 1),
        fill_mode="solid",
    )
    rr.log("world/splats", ellipsoids)


if __name__ == "__main__":
    main()
