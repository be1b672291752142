"""Open3D's TSDF integration of frames, for the example `peers`."""

import json
import os
import sys
import time


def say(answer):
    print(json.dumps(answer), flush=True)


def main(folder):
    with open(os.path.join(folder, "frames.json")) as file:
        described = json.load(file)
    threads = described["told"]["threads"]
    # OpenMP reads this when it is loaded.
    os.environ.setdefault("OMP_NUM_THREADS", str(threads))
    try:
        import numpy as np
        import open3d as o3d
    except ImportError as missing:
        say({"error": f"{missing}; choose a Python that has Open3D with --python, or omit --open3d"})
        return

    def array(name, number):
        return np.load(os.path.join(folder, f"{name}-{number}.npy"))

    core = o3d.core
    frames = []
    for number, frame in enumerate(described["frames"]):
        fx, fy, cx, cy = frame["intrinsics"]
        pose = np.eye(4)
        pose[:3, :3] = np.array(frame["axes"]).T
        pose[:3, 3] = frame["centre"]
        frames.append(
            (
                o3d.t.geometry.Image(core.Tensor(array("depth", number))),
                # Integration requires colour and depth of the same type.
                o3d.t.geometry.Image(core.Tensor(array("color", number).astype(np.float32) / 255)),
                core.Tensor(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], dtype=np.float64)),
                core.Tensor(np.linalg.inv(pose)),
            )
        )
    depths = np.concatenate([array("depth", i).ravel() for i in range(len(frames))])
    depths = depths[depths > 0]
    # Voxels are two pixels wide at the median depth. The range covers all depth.
    voxel = 2 * float(np.median(depths)) / described["frames"][0]["intrinsics"][0]
    farthest = float(depths.max()) * 1.01
    grid = o3d.t.geometry.VoxelBlockGrid(
        attr_names=("tsdf", "weight", "color"),
        attr_dtypes=(core.float32, core.float32, core.float32),
        attr_channels=((1), (1), (3)),
        voxel_size=voxel,
        block_resolution=16,
        block_count=50000,
        device=core.Device("CPU:0"),
    )
    say("ready")
    for line in sys.stdin:
        depth, color, intrinsic, extrinsic = frames[int(line)]
        begun = time.perf_counter()
        blocks = grid.compute_unique_block_coordinates(depth, intrinsic, extrinsic, 1.0, farthest)
        grid.integrate(blocks, depth, color, intrinsic, intrinsic, extrinsic, 1.0, farthest)
        say({"ms": 1e3 * (time.perf_counter() - begun)})


main(sys.argv[1])
