"""The package as its users call it: shapes, units, errors, threads."""

import threading

import numpy as np
import pytest

import vbgs_studio
from vbgs_studio import Scene, read

W, H, F = 160, 120, 120.0
CAMERA = dict(intrinsics=(F, F, W / 2, H / 2), size=(W, H), scale=0.03)


def wall(step=0):
    """A textured wall 1.5 in front of a camera that moves to the right."""
    columns, rows = np.meshgrid(np.arange(W), np.arange(H))
    x = (columns + 0.5 - W / 2) / F * 1.5 + 0.05 * step
    y = (rows + 0.5 - H / 2) / F * 1.5
    color = np.stack([128 + 100 * np.sin(8 * x), 128 + 100 * np.sin(9 * y), 0 * x + 90], axis=-1)
    pose = np.eye(4)
    pose[0, 3] = 0.05 * step
    return color.astype(np.uint8), np.full((H, W), 1.5, np.float32), pose


def learned(n=6, **settings):
    scene = Scene(**CAMERA, **settings)
    for step in range(n):
        scene.learn(*wall(step))
    return scene


def test_a_wall_is_learned_where_it_is():
    scene = learned()
    splats, posterior = scene.splats(), scene.posterior()
    n = len(splats["opacity"])
    assert 500 < n <= len(scene) == len(posterior["count"])
    shapes = {name: values.shape for name, values in splats.items()}
    assert shapes == dict(
        mean=(n, 3), scale=(n, 3), rotation=(n, 4), opacity=(n,), color=(n, 3), gradient=(n, 3, 3),
        directional=(n, 3, 3),
    )
    assert np.abs(splats["mean"][:, 2] - 1.5).max() < 0.05
    assert np.allclose(np.linalg.norm(splats["rotation"], axis=1), 1, atol=1e-2)
    assert np.allclose(posterior["mean"][:, 2], 1.5, atol=0.02)
    assert np.allclose(posterior["covariance"], posterior["covariance"].transpose(0, 2, 1))
    sure = posterior["count"] > 50
    assert np.linalg.eigvalsh(posterior["covariance"][sure]).min() > 0
    assert (posterior["normal"][sure, 2] < -0.99).all(), "towards the camera"
    assert posterior["color"][sure, 2].mean() == pytest.approx(90 / 255, abs=0.02)


def test_a_rendering_shows_what_was_learned():
    scene = learned()
    color, _, pose = wall(3)
    for renderer in ("projected", "exact"):
        picture = scene.render(pose, renderer=renderer)
        assert picture["color"].shape == (H, W, 3) and picture["depth"].shape == (H, W)
        middle = np.s_[20:-20, 20:-20]
        assert picture["coverage"][middle].min() > 0.9
        assert np.abs(picture["color"] - color / 255)[middle].mean() < 0.02
        if renderer == "projected":
            assert np.abs(picture["depth"][middle] - 1.5).max() < 0.05
    small = scene.render(pose, (F / 2, F / 2, W / 4, H / 4), (W // 2, H // 2), background=(1, 1, 1))
    assert small["color"].shape == (H // 2, W // 2, 3)
    with pytest.raises(ValueError, match="intrinsics and size"):
        scene.render(pose, size=(10, 10))
    with pytest.raises(ValueError, match="renderer: expected"):
        scene.render(pose, renderer="best")


def test_arrays_in_any_order_give_the_same_bits():
    plain, strided = Scene(**CAMERA), Scene(**CAMERA)
    for step in range(2):
        color, depth, pose = wall(step)
        plain.learn(color, depth, pose)
        wide = np.zeros((H, W, 4), np.uint8)
        wide[..., :3] = color
        strided.learn(wide[..., :3], np.asfortranarray(depth), np.asfortranarray(pose))
    assert all(np.array_equal(a, b) for a, b in zip(plain.splats().values(), strided.splats().values()))


def test_transparent_pixels_and_holes_give_no_points():
    color, depth, pose = wall()
    opaque = np.concatenate([color, np.full((H, W, 1), 255, np.uint8)], axis=-1)
    opaque[: H // 2, :, 3] = 0
    depth[:, : W // 2] = np.nan
    depth[0, W - 1] = np.inf
    scene = Scene(**CAMERA)
    assert 0 < scene.learn(opaque, depth, pose)["points"] <= H // 2 * W // 2
    mean = scene.posterior()["mean"]
    assert mean[:, :2].min() > -0.1


@pytest.mark.parametrize(
    "change, error, message",
    [
        (lambda c, d, p: (c.astype(np.float32), d, p), TypeError, "color: expected an array of uint8"),
        (lambda c, d, p: (c[..., :2], d, p), TypeError, r"shape \[120, 160, 2\]"),
        (lambda c, d, p: (c[:-1], d, p), ValueError, "color: expected 120 rows and 160 columns"),
        (lambda c, d, p: (c, d.astype(np.float64), p), TypeError, "depth: expected an array of float32"),
        (lambda c, d, p: (c, d[:, :-1], p), ValueError, "depth: expected 120 rows"),
        (lambda c, d, p: (c, d[0], p), TypeError, "depth: expected"),
        (lambda c, d, p: (c, np.zeros_like(d), p), ValueError, "depth"),
        (lambda c, d, p: (c, d, p[:3]), TypeError, "pose: expected"),
        (lambda c, d, p: (c, d, p * np.nan), ValueError, "pose|matrix|finite"),
        (lambda c, d, p: (c, d, np.diag([2.0, 2, 2, 1])), ValueError, "pose|rotation|scale"),
        (lambda c, d, p: (c, d, "pose"), TypeError, "found a value of type str"),
        (lambda c, d, p: (c, d, None), TypeError, "learn: expected color, depth and pose"),
    ],
)
def test_wrong_arrays_are_refused_and_change_nothing(change, error, message):
    scene = learned(2)
    before = scene.posterior()["count"]
    with pytest.raises(error, match=message):
        scene.learn(*change(*wall(2)))
    assert np.array_equal(before, scene.posterior()["count"])


def test_settings_out_of_range_are_refused():
    for settings, error, message in [
        (dict(scale=-1.0), ValueError, "scale"),
        (dict(scale=np.nan), ValueError, "scale"),
        (dict(sensor="eyes"), ValueError, "sensor: expected lidar"),
        (dict(depth_kind="x"), ValueError, "depth_kind: expected"),
        (dict(budget=0), ValueError, "budget"),
        (dict(photometric="some"), ValueError, "photometric"),
        (dict(colour=1), TypeError, "colour: expected one of the settings seed, scale"),
    ]:
        with pytest.raises(error, match=message):
            Scene(**{**CAMERA, **settings})
    with pytest.raises(ValueError):
        Scene((0, F, 1, 1), (W, H), 0.03).learn(*wall())


def test_settings_have_an_effect():
    assert len(learned(2, budget=100)) <= 100
    assert learned(2, photometric="off", align=False).splats()["mean"].shape[0] > 500
    matrix = np.array([[F, 0, W / 2], [0, F, H / 2], [0, 0, 1]])
    scene = Scene(matrix, (W, H), 0.03)
    scene.learn(*wall())
    assert np.array_equal(scene.posterior()["mean"], learned(1).posterior()["mean"])
    near = Scene(**CAMERA, depth_range=(0.1, 1.0))
    assert near.learn(*wall())["points"] == 0


def test_a_scene_is_shared_by_threads():
    scene, failures = Scene(**CAMERA), []

    def work(first):
        try:
            for step in range(first, 12, 2):
                scene.learn(*wall(step))
                assert len(scene.splats()["opacity"]) > 0
        except Exception as failure:
            failures.append(failure)

    threads = [threading.Thread(target=work, args=(first,)) for first in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=120)
        assert not thread.is_alive(), "deadlock"
    assert not failures
    assert repr(scene) == f"<Scene: {len(scene)} components, 12 frames>"
    ordered = Scene(**CAMERA, photometric="off", align=False)
    for step in range(12):
        ordered.learn(*wall(step))
    assert scene.posterior()["count"].sum() == pytest.approx(ordered.posterior()["count"].sum(), rel=0.01)


def test_files_are_written_by_their_ending(tmp_path):
    scene = learned(2)
    for ending, start in [("ply", b"ply\n"), ("glb", b"glTF"), ("spz", b"\x1f\x8b")]:
        path = tmp_path / f"scene.{ending}"
        n, size = scene.save(path)
        assert n > 500 and path.stat().st_size == size and path.read_bytes().startswith(start)
    with pytest.raises(ValueError, match="scene.txt"):
        scene.save(tmp_path / "scene.txt")
    with pytest.raises(ValueError, match="none"):
        scene.save(tmp_path / "none" / "scene.ply")
    with pytest.raises(ValueError):
        Scene(**CAMERA).save(tmp_path / "empty.ply")


def test_a_recording_is_read_and_learned():
    room = read("demo")
    frame = room[0]
    width, height = frame.size
    assert frame.color.shape == (height, width, 4) and frame.depth.shape == (height, width)
    assert frame.depth.dtype == np.float32 and frame.pose.shape == (4, 4)
    assert len(frame.intrinsics) == 4 and frame.name and "frames" in repr(room)
    scene = room.scene()
    for index in range(2):
        assert scene.learn(room[index])["points"] > 1000
    assert room[-1].name == room[len(room) - 1].name
    with pytest.raises(IndexError):
        room[len(room)]
    with pytest.raises(TypeError, match="recording"):
        scene.learn(frame.color, frame.depth, frame.pose)
    with pytest.raises(ValueError, match="split: expected one of"):
        read("demo", split="none")
    with pytest.raises(ValueError, match="/nowhere"):
        read("/nowhere")


def test_every_name_is_typed():
    stubs = (vbgs_studio.__file__).replace("__init__.py", "__init__.pyi")
    text = open(stubs).read()
    for kind in (vbgs_studio.Scene, vbgs_studio.Recording, vbgs_studio.Frame):
        for name in vars(kind):
            if not name.startswith("_"):
                assert f"def {name}(" in text, name
