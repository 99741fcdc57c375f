"""Pictures of the models for the READMEs of their folders, by MuJoCo: `MUJOCO_GL=egl python docs/previews.py`."""

import mujoco
import numpy as np
from PIL import Image

import mjcf

#: Size of a picture in pixels, and the way from the camera to what it looks at, x to the toes, y up.
WIDTH, HEIGHT = 480, 400
LOOK = np.array([-0.45, -0.22, -0.86])
#: Height of the middle of the picture and distance of the camera [m]; two legs have a thigh, too.
NEAR, FAR = (0.12, 0.95), (0.26, 1.5)

for name in mjcf.names():
    if mjcf.path(name).parent.name != name:
        continue  # a variant looks like the model of its folder
    spec = mujoco.MjSpec.from_file(str(mjcf.scene(name)))
    middle, distance = NEAR if spec.body("thigh") is None else FAR
    right = np.cross(LOOK, [0, 1, 0])
    axes = np.stack([right, np.cross(right, LOOK), -LOOK])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    turned = np.zeros(4)
    mujoco.mju_mat2Quat(turned, axes.T.ravel())
    at = np.array([0, middle, 0]) - distance * LOOK
    spec.worldbody.add_camera(name="preview", pos=at, quat=turned, fovy=40)
    model = spec.compile()
    data, options = mujoco.MjData(model), mujoco.MjvOption()
    mujoco.mj_forward(model, data)
    options.flags[mujoco.mjtVisFlag.mjVIS_TENDON] = False  # pads end a kilometre below
    with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
        renderer.update_scene(data, "preview", options)
        Image.fromarray(renderer.render()).quantize(128).save(mjcf.path(name).with_suffix(".png"), optimize=True)
