"""The ROS 2 node on messages made by hand: no robot and no ROS are needed."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace as Message

import numpy as np
import pytest

W, H, F = 160, 120, 120.0
NODE = Path(__file__).resolve().parents[2] / "examples" / "ros2_node.py"


class Node:
    def __init__(self, name):
        self.log, self.services = [], {}

    def declare_parameter(self, name, value):
        return Message(value=value)

    def create_service(self, kind, name, answer):
        self.services[name] = answer

    def get_logger(self):
        return Message(info=self.log.append, warning=self.log.append)


class Buffer:
    """A camera that moves to the right by the seconds of the stamp; nothing is known of a second 9."""

    def lookup_transform(self, world, frame, stamp):
        assert (world, frame) == ("map", "camera_optical")
        if stamp == 9:
            raise TransformException("no transform at 9")
        at, turn = Message(x=0.05 * stamp, y=0.0, z=0.0), Message(x=0.0, y=0.0, z=0.0, w=1.0)
        return Message(transform=Message(translation=at, rotation=turn))


class TransformException(Exception):
    pass


class Synchronizer:
    def __init__(self, topics, queue, slop):
        assert topics == ["color", "depth", "camera_info"]

    def registerCallback(self, learn):
        self.learn = learn


@pytest.fixture
def ros2(monkeypatch):
    """The node's module, with stubs of what it imports from ROS."""
    response = type("Response", (), {"success": False, "message": ""})
    stubs = {
        "rclpy": {},
        "rclpy.node": dict(Node=Node),
        "sensor_msgs": {},
        "sensor_msgs.msg": dict(Image=Message, CameraInfo=Message),
        "std_srvs": {},
        "std_srvs.srv": dict(Trigger=Message(Response=response)),
        "message_filters": dict(
            Subscriber=lambda node, kind, name: name, ApproximateTimeSynchronizer=Synchronizer
        ),
        "tf2_ros": dict(
            Buffer=Buffer, TransformListener=lambda tf, node: None, TransformException=TransformException
        ),
    }
    for name, content in stubs.items():
        module = ModuleType(name)
        module.__dict__.update(content)
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("ros2_node", NODE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def image(array, encoding, padding=0):
    rows = array.reshape(len(array), -1).view(np.uint8)
    rows = np.pad(rows, ((0, 0), (0, padding)))
    return Message(
        height=array.shape[0], width=array.shape[1], step=rows.shape[1], encoding=encoding,
        is_bigendian=0, data=rows.tobytes(),
    )


def messages(second, depth_encoding="16UC1"):
    """A wall 1.5 m in front of the camera."""
    columns, lines = np.meshgrid(np.arange(W), np.arange(H))
    red = 128 + 100 * np.sin(8 * ((columns + 0.5 - W / 2) / F * 1.5 + 0.05 * second))
    color = np.stack([red, 0 * red + 90, lines + 20.0], axis=-1).astype(np.uint8)
    depth = np.full((H, W), 1500, np.uint16)
    if depth_encoding == "32FC1":
        depth = (depth / 1000).astype(np.float32)
    color = image(np.ascontiguousarray(color[..., ::-1]), "bgr8", padding=5)
    color.header = Message(frame_id="camera_optical", stamp=second)
    info = Message(k=[F, 0, W / 2, 0, F, H / 2, 0, 0, 1], width=W, height=H)
    return color, image(depth, depth_encoding, padding=2), info


def test_frames_are_learned_and_saved(ros2, tmp_path):
    node = ros2.SceneNode()
    node.output = str(tmp_path / "scene.ply")
    answer = node.services["~/save"](None, ros2.Trigger.Response())
    assert not answer.success and "found none yet" in answer.message
    for second in range(6):
        node.together.learn(*messages(second, "32FC1" if second % 2 else "16UC1"))
    assert "components" in node.log[-1], node.log
    splats = node.scene.splats()
    assert np.abs(splats["mean"][:, 2] - 1.5).max() < 0.05
    # Blue grows downwards, so its order is right, and padding was left out.
    assert np.corrcoef(splats["mean"][:, 1], splats["color"][:, 2])[0, 1] > 0.9
    assert splats["color"][:, 1].mean() == pytest.approx(90 / 255, abs=0.02)
    answer = node.services["~/save"](None, ros2.Trigger.Response())
    assert answer.success and Path(node.output).stat().st_size > 10_000


def test_frames_that_cannot_be_learned_are_left_out(ros2):
    node = ros2.SceneNode()
    node.together.learn(*messages(9))
    assert "no transform at 9" in node.log[-1]
    for at, encoding, what in [(0, "yuv422", "colour: expected"), (1, "8UC1", "depth: expected")]:
        frame = messages(0)
        frame[at].encoding = encoding
        node.together.learn(*frame)
        assert what in node.log[-1] and encoding in node.log[-1]
    frame = messages(0)
    frame[1].data = frame[1].data[:-400]
    node.together.learn(*frame)
    assert "rows of" in node.log[-1]
    node.together.learn(*messages(0))
    assert "components" in node.log[-1]


def test_poses_are_rotations(ros2):
    half = 0.5**0.5
    turn = Message(x=0.0, y=0.0, z=2 * half, w=2 * half)
    pose = ros2.pose_of(Message(rotation=turn, translation=Message(x=1.0, y=2.0, z=3.0)))
    assert np.allclose(pose, [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
