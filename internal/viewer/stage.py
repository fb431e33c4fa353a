# SPDX-License-Identifier: Apache-2.0
"""Cameras between our frame and viser's, and the photos' cameras on one's stage.

Our poses are OpenGL camera-to-world ``[3, 4]``; viser's cameras are OpenCV (x right,
y down, z forwards). World coordinates of the page are those of the model.
"""

import numpy as np
import viser
from jaxtyping import Float
from scipy.spatial.transform import Rotation
from viser import _messages

from internal.viewer.free_camera import FreeCamera
from internal.viewer.studio import Studio

TURN_PER_DRAG = 0.25  # of a whole turn, for a drag over the window's height
GENTLE = """
const wait = setInterval(() => {{
  const controls = window.__viserMutable?.cameraControl;
  if (!controls) return;
  controls.azimuthRotateSpeed = controls.polarRotateSpeed = {share};
  clearInterval(wait);
}}, 100);
"""
REACH = """
const controls = window.__viserMutable?.cameraControl;
if (controls && !controls.currentAction) {{
  const eye = controls.getPosition(controls.camera.position.clone());
  const middle = controls.getTarget(eye.clone()).sub(eye).setLength({ahead}).add(eye);
  controls.setTarget(middle.x, middle.y, middle.z, false);
}}
"""
NEAR_ENOUGH = 0.01  # of the distance to what is turned about
OPENCV_AXES = np.diag([1.0, -1.0, -1.0])
FRUSTUM_SIZE = 0.1  # of the spread of the photos
FRUSTUM_COLOR = (255, 170, 60)
# A camera seen from so near hides the scene from who stands there.
TOO_NEAR = 3.0  # frustum sizes


def camera_of(handle: viser.CameraHandle) -> FreeCamera:
    """Where a browser's camera is."""
    rotation = Rotation.from_quat(handle.wxyz, scalar_first=True).as_matrix()
    pose = np.column_stack([rotation @ OPENCV_AXES, handle.position])
    return FreeCamera(pose, handle.fov, handle.aspect)


def move(
    client: viser.ClientHandle, camtoworld: Float[np.ndarray, "3 4"], fov: float
) -> None:
    """Moves a browser's camera; what it turns about stays as far ahead of it."""
    with client.atomic():
        client.camera.position = camtoworld[:, 3]
        client.camera.wxyz = orientation(camtoworld)
        client.camera.fov = fov


def look_at(client: viser.ClientHandle, point: Float[np.ndarray, " 3"]) -> None:
    """Turns a browser's camera where it stands, towards a point."""
    client.camera.look_at = point


def turn_about(client: viser.ClientHandle, point: Float[np.ndarray, " 3"]) -> None:
    """Makes a drag turn about a point on the axis of a browser's camera, unless it
    turns about one near it.

    The browser is told how far ahead that is, not where: its camera may have moved
    meanwhile, and would turn towards a point. A drag ends about what it began about.
    """
    camera = camera_of(client.camera)
    ahead = (camera.camtoworld[:, 3] - point) @ camera.camtoworld[:, 2]
    apart = np.linalg.norm(client.camera.look_at - point)
    if ahead > 2.0 * client.camera.near and apart > NEAR_ENOUGH * ahead:
        run_on_page(client, REACH.format(ahead=ahead))


def make_gentle(client: viser.ClientHandle) -> None:
    """Turns a browser's camera less far for a drag; viser has no setting for it.

    A drag over the height of the window is a whole turn otherwise. viser offers its
    controls to scripts on the page as ``__viserMutable``; without it all else works.
    """
    run_on_page(client, GENTLE.format(share=TURN_PER_DRAG))


def run_on_page(client: viser.ClientHandle, script: str) -> None:
    """Runs a script in a browser."""
    message = _messages.RunJavascriptMessage(script)
    client.gui._websock_interface.queue_message(message)


def orientation(camtoworld: Float[np.ndarray, "3 4"]) -> Float[np.ndarray, " 4"]:
    """viser's quaternion (w, x, y, z) of a camera of ours."""
    rotation = Rotation.from_matrix(camtoworld[:, :3] @ OPENCV_AXES)
    return rotation.as_quat(scalar_first=True)


class Frustums:
    """The photos' cameras as one browser shows them."""

    def __init__(self, client: viser.ClientHandle, studio: Studio) -> None:
        self._client, self._studio = client, studio
        self.size = FRUSTUM_SIZE * studio.spread()  # model units
        self.shown = True
        self.handles: list[viser.CameraFrustumHandle] = []

    def add(self) -> None:
        """Sends them to the browser."""
        studio = self._studio
        for view, name in enumerate(studio.scene.view_names):
            camera = studio.view_camera(view)
            self.handles.append(
                self._client.scene.add_camera_frustum(
                    f"/cameras/{view:04d} {name}",
                    fov=camera.fov,
                    aspect=camera.aspect,
                    scale=self.size,
                    thickness=0.02 * self.size,
                    color=FRUSTUM_COLOR,
                    image=studio.thumbnails[view],
                    wxyz=orientation(camera.camtoworld),
                    position=camera.camtoworld[:, 3],
                    visible=False,
                )
            )

    def update(self, camera: FreeCamera) -> None:
        """Hides what is too near to the camera, and all where they are not wanted."""
        for handle in self.handles:
            apart = np.linalg.norm(handle.position - camera.camtoworld[:, 3])
            visible = self.shown and bool(apart > TOO_NEAR * self.size)
            if handle.visible != visible:
                handle.visible = visible
