"""Records Record3D's USB stream (iPhone, iPad with lidar) to a folder for `train --follow`.

Not tested with the device: written from the documentation of the package record3d.

    pip install record3d numpy pillow
    vbgs-studio train room --follow --out run &     # or the switch Follow in the window
    python record3d_stream.py room                  # Ctrl-C ends the recording

Turn on USB streaming in the app's settings first. Layout: Stray Scanner with images in rgb/. The line
of the odometry is written last, because it completes the frame.
"""

import sys
import time
from pathlib import Path
from threading import Event

import numpy as np
from PIL import Image
from record3d import Record3DStream

LIDAR = 1  # Record3DStream's device type; 0 is the front camera
HEAD = "timestamp, frame, x, y, z, qx, qy, qz, qw\n"


def to_opencv(q):
    """Converts a rotation from the app's camera axes (-z forward, y up) to the layout's (z forward,
    y down) by half a turn about x: q * (1, 0, 0, 0), order (x, y, z, w)."""
    x, y, z, w = q
    return w, z, -y, -x


def main(out):
    for folder in ("rgb", "depth", "confidence"):
        (out / folder).mkdir(parents=True)
    devices = Record3DStream.get_connected_devices()
    if not devices:
        sys.exit("expected a phone on USB with the stream turned on in the app, found none")
    stream, is_new, is_over = Record3DStream(), Event(), Event()
    stream.on_new_frame = is_new.set
    stream.on_stream_stopped = is_over.set
    stream.connect(devices[0])
    odometry, i = (out / "odometry.csv").open("w", buffering=1), 0
    odometry.write(HEAD)
    try:
        while not is_over.is_set():
            if not is_new.wait(timeout=1.0):
                continue
            is_new.clear()
            if stream.get_device_type() != LIDAR:
                sys.exit("expected the lidar, found the front camera; switch in the app")
            color, depth = stream.get_rgb_frame(), stream.get_depth_frame()
            sure, k, p = (stream.get_confidence_frame(), stream.get_intrinsic_mat(),
                          stream.get_camera_pose())
            if i == 0:
                (out / "camera_matrix.csv").write_text(
                    f"{k.fx},0,{k.tx}\n0,{k.fy},{k.ty}\n0,0,1\n")
            depth = np.nan_to_num(depth, nan=0.0, posinf=0.0, neginf=0.0)
            depth = (1000.0 * depth).round().clip(0, 65535).astype(np.uint16)
            # Without a confidence map every pixel gets the highest confidence.
            sure = sure if sure.shape == depth.shape else np.full(depth.shape, 2, np.uint8)
            Image.fromarray(depth).save(out / f"depth/{i:06d}.png", compress_level=1)
            Image.fromarray(sure.astype(np.uint8)).save(out / f"confidence/{i:06d}.png")
            Image.fromarray(color).save(out / f"rgb/{i:06d}.jpg", quality=92)
            q = to_opencv((p.qx, p.qy, p.qz, p.qw))
            numbers = ", ".join(f"{v:.9g}" for v in (p.tx, p.ty, p.tz, *q))
            odometry.write(f"{time.time():.6f}, {i:06d}, {numbers}\n")
            i += 1
    except KeyboardInterrupt:
        pass
    finally:
        odometry.close()
        (out / "recording.done").touch()
        print(f"{i} frames recorded")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
