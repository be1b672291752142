#!/usr/bin/env python3
"""ROS 2 node that learns a scene from the topics of a depth camera while the robot moves.

    pip install ./python
    python3 examples/ros2_node.py --ros-args -r color:=/camera/color/image_raw \
        -r depth:=/camera/aligned_depth_to_color/image_raw -r camera_info:=/camera/color/camera_info \
        -p world:=map -p scale:=0.02 -p output:=scene.ply

Depth has to be registered to colour and undistorted. Poses come from tf: the world frame must be that of a localisation
that does not jump. The service `~/save` (std_srvs/Trigger) writes the splats, and so does the end of the node.

Tried without a robot: `python/tests/test_ros2_node.py` runs it on messages made by hand.
"""

import message_filters
import numpy as np
import rclpy
import tf2_ros
import vbgs_studio
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

QUEUE = 10  # messages of a topic that wait for those of the others
SLOP = 0.02  # largest difference between the times of colour and depth, seconds
# Element type, number of channels and order of red, green and blue of the encodings of colour.
COLORS = {"rgb8": (3, [0, 1, 2]), "bgr8": (3, [2, 1, 0]), "rgba8": (4, [0, 1, 2]), "bgra8": (4, [2, 1, 0])}
# Element type and metres per unit of the encodings of depth.
DEPTHS = {"16UC1": (np.uint16, 0.001), "mono16": (np.uint16, 0.001), "32FC1": (np.float32, 1.0)}


def rows(message, dtype, channels):
    """Returns the pixels of an image message, shape (height, width, channels), without the padding of its rows."""
    dtype = np.dtype(dtype).newbyteorder(">" if message.is_bigendian else "<")
    used = message.width * channels * dtype.itemsize
    data = np.frombuffer(message.data, np.uint8)
    if message.step < used or data.size < message.step * message.height:
        raise ValueError(f"expected {message.height} rows of {used} bytes, found {data.size} bytes")
    data = data[: message.step * message.height].reshape(message.height, message.step)[:, :used]
    return np.ascontiguousarray(data).view(dtype).reshape(message.height, message.width, channels)


def color_of(message):
    """Returns the colours of an image message, shape (H, W, 3), `uint8`."""
    if message.encoding not in COLORS:
        raise ValueError(f"colour: expected one of {', '.join(COLORS)}, found {message.encoding}")
    channels, order = COLORS[message.encoding]
    return np.ascontiguousarray(rows(message, np.uint8, channels)[..., order])


def depth_of(message):
    """Returns the depth of an image message in metres, shape (H, W), `float32`; 0 where unknown."""
    if message.encoding not in DEPTHS:
        raise ValueError(f"depth: expected one of {', '.join(DEPTHS)}, found {message.encoding}")
    dtype, metres = DEPTHS[message.encoding]
    return (rows(message, dtype, 1)[..., 0] * np.float32(metres)).astype(np.float32)


def pose_of(transform):
    """Returns the camera-to-world matrix of a tf transform whose child is an optical frame (x right, z forward)."""
    q, t = transform.rotation, transform.translation
    x, y, z, w = np.array([q.x, q.y, q.z, q.w]) / np.linalg.norm([q.x, q.y, q.z, q.w])
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = t.x, t.y, t.z
    return pose


class SceneNode(Node):
    def __init__(self):
        super().__init__("vbgs_studio")
        self.world = self.declare_parameter("world", "map").value
        self.scale = self.declare_parameter("scale", 0.02).value
        self.sensor = self.declare_parameter("sensor", "kinect").value
        self.output = self.declare_parameter("output", "scene.ply").value
        self.scene = None
        self.tf = tf2_ros.Buffer()
        self.listener = tf2_ros.TransformListener(self.tf, self)
        topics = [(Image, "color"), (Image, "depth"), (CameraInfo, "camera_info")]
        topics = [message_filters.Subscriber(self, kind, name) for kind, name in topics]
        self.together = message_filters.ApproximateTimeSynchronizer(topics, QUEUE, SLOP)
        self.together.registerCallback(self.learn)
        self.create_service(Trigger, "~/save", self.save)

    def learn(self, color, depth, info):
        """Learns a frame, or logs why not: a robot goes on without it."""
        try:
            # Without waiting: a frame that is older than its pose would hold up those behind it.
            found = self.tf.lookup_transform(self.world, color.header.frame_id, color.header.stamp)
            if self.scene is None:
                k = info.k
                self.scene = vbgs_studio.Scene(
                    (k[0], k[4], k[2], k[5]), (info.width, info.height), self.scale, sensor=self.sensor
                )
            report = self.scene.learn(color_of(color), depth_of(depth), pose_of(found.transform))
        except (tf2_ros.TransformException, ValueError, TypeError) as error:
            self.get_logger().warning(f"frame left out: {error}")
            return
        self.get_logger().info(f"{report['points']} points, {report['components']} components")

    def save(self, _request=None, response=None):
        """Writes the splats; answers a service call if there is one."""
        response = Trigger.Response() if response is None else response
        try:
            if self.scene is None:
                raise ValueError("expected a frame, found none yet")
            self.scene.save(self.output)
            response.success, response.message = True, f"wrote {self.output}"
        except (OSError, ValueError) as error:
            response.success, response.message = False, str(error)
        self.get_logger().info(response.message)
        return response


def main():
    rclpy.init()
    node = SceneNode()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.save()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
