"""Records a RealSense depth camera (D400 series) to a folder for `train --follow`.

Not tested with the device: written from the documentation of pyrealsense2 and Open3D.

    pip install pyrealsense2 open3d numpy pillow
    vbgs-studio train room --follow --out run &     # or the switch Follow in the window
    python realsense.py room                        # Ctrl-C ends the recording

The camera has no tracking: poses come from Open3D's RGB-D odometry from frame to frame, which drifts.
Move slowly. Layout: 7-Scenes in one folder. The pose is written last, because it completes the frame.
"""

import sys
from pathlib import Path

import numpy as np
import open3d as o3d
import pyrealsense2 as rs
from PIL import Image

WIDTH, HEIGHT, FPS = 640, 480, 30
MAX_DEPTH = 4.0  # metres


def rgbd(color, depth):
    """RGB-D image for the odometry: grey values, depth in metres."""
    return o3d.geometry.RGBDImage.create_from_color_and_depth(
        o3d.geometry.Image(color), o3d.geometry.Image(depth), depth_scale=1000.0,
        depth_trunc=MAX_DEPTH, convert_rgb_to_intensity=True)


def main(out):
    out.mkdir(parents=True)
    pipeline, config = rs.pipeline(), rs.config()
    config.enable_stream(rs.stream.color, WIDTH, HEIGHT, rs.format.rgb8, FPS)
    config.enable_stream(rs.stream.depth, WIDTH, HEIGHT, rs.format.z16, FPS)
    profile = pipeline.start(config)
    # Aligns depth to the colour camera, so that both share its intrinsics.
    align = rs.align(rs.stream.color)
    k = profile.get_stream(rs.stream.color).as_video_stream_profile().get_intrinsics()
    (out / "camera-intrinsics.txt").write_text(
        f"{k.fx} 0 {k.ppx}\n0 {k.fy} {k.ppy}\n0 0 1\n")
    camera = o3d.camera.PinholeCameraIntrinsic(k.width, k.height, k.fx, k.fy, k.ppx, k.ppy)
    to_mm = 1000.0 * profile.get_device().first_depth_sensor().get_depth_scale()
    pose, before, lost, i = np.eye(4), None, 0, 0
    try:
        while True:
            frames = align.process(pipeline.wait_for_frames())
            if not frames.get_color_frame() or not frames.get_depth_frame():
                continue
            color = np.asanyarray(frames.get_color_frame().get_data()).copy()
            depth = np.asanyarray(frames.get_depth_frame().get_data()) * to_mm
            depth = depth.round().astype(np.uint16)
            now = rgbd(color, depth)
            if before is not None:
                # `motion` maps points of this frame to the previous one.
                found, motion, _ = o3d.pipelines.odometry.compute_rgbd_odometry(
                    now, before, camera, np.eye(4),
                    o3d.pipelines.odometry.RGBDOdometryJacobianFromHybridTerm())
                if not found:
                    lost += 1  # Frames without a pose are skipped: return to a place seen before.
                    continue
                pose = pose @ motion
            before, stem = now, out / f"frame-{i:06d}"
            Image.fromarray(color).save(f"{stem}.color.jpg", quality=92)
            Image.fromarray(depth).save(f"{stem}.depth.png", compress_level=1)
            Path(f"{stem}.pose.txt").write_text(
                "\n".join(" ".join(f"{v:.9g}" for v in row) for row in pose) + "\n")
            i += 1
    except KeyboardInterrupt:
        pass
    finally:
        pipeline.stop()
        (out / "recording.done").touch()
        print(f"{i} frames recorded, {lost} without a pose skipped")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
