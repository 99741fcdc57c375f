"""The scene, made with the Visualizer and the geometries of meshcat. No other module imports meshcat.

meshcat's server binds every address and waits without a limit, so its ZMQ window is replaced by `Hub`. That keeps the
messages, so that a new browser gets all of them, and server.py sends them.
"""

import base64
import gzip
import threading
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from fasbody.exceptions import MissingPackageError

try:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # zmq.eventloop.ioloop, which we do not use
        import meshcat
        import meshcat.geometry as geometry
        import umsgpack
except ImportError:
    raise MissingPackageError("meshcat", "view") from None

from viz.anatomy.assets import Part, colour
from viz.anatomy.rest import SEGMENTS, TABLE, Frame

Array = np.ndarray

#: The page code of meshcat, in its package.
SCRIPT = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"
#: Scene units a metre: decimetres suit meshcat's clip planes.
SCALE = 10.0
_ORDER = ("set_object", "set_transform", "set_property")


class Hub:
    """Stands where meshcat expects its window: packs commands, remembers the last of each kind, hands them on.

    A reload changes the scene in the simulation's thread while a new page reads it in the server's: hence the lock.
    """

    web_url = ""

    def __init__(self) -> None:
        self.listeners: set[Callable[[bytes], None]] = set()
        self._lock = threading.Lock()
        self._tree: dict[str, dict[tuple[str, str | None], bytes]] = {}

    def send(self, command: Any) -> None:
        """Called by `meshcat.Visualizer`."""
        self.put(command.lower())

    def put(self, message: dict[str, Any]) -> None:
        """Send one message of the protocol and keep it, only the last of each property."""
        data, path, kind = umsgpack.packb(message), message["path"], message["type"]
        with self._lock:
            if kind == "delete":
                for known in [k for k in self._tree if k == path or k.startswith(f"{path}/")]:
                    del self._tree[known]
            else:
                node = self._tree.setdefault(path, {})
                if kind == "set_object":
                    node.clear()
                node[kind, message.get("property")] = data
            for listener in self.listeners:
                listener(data)

    def messages(self) -> list[bytes]:
        """Everything that makes the scene, objects before their properties."""
        with self._lock:
            return self._messages()

    def join(self, listener: Callable[[bytes], None]) -> list[bytes]:
        """The whole scene, and from then on every further message to `listener`, which must not block."""
        with self._lock:
            self.listeners.add(listener)
            return self._messages()

    def leave(self, listener: Callable[[bytes], None]) -> None:
        """No further message to `listener`."""
        with self._lock:
            self.listeners.discard(listener)

    def _messages(self) -> list[bytes]:
        nodes = self._tree.values()
        return [node[key] for node in nodes for key in sorted(node, key=lambda k: _ORDER.index(k[0]))]

    def property(self, path: str, key: str, value: Any) -> None:
        """Like meshcat's set_property, which would write castShadow in lower case."""
        self.put({"type": "set_property", "path": path, "property": key, "value": value})

    def object(self, path: str, plain: dict[str, Any]) -> None:
        """Any object of three.js, such as a light."""
        whole = {"metadata": {"version": 4.5, "type": "Object"}, "geometries": [], "materials": [], "object": plain}
        self.put({"type": "set_object", "path": path, "object": whole})


def embedded(hub: Hub) -> str:
    """All messages of the scene, each behind its length, as base64 of gzip: for a page without a server."""
    whole = b"".join(len(m).to_bytes(4, "little") + m for m in hub.messages())
    return base64.b64encode(gzip.compress(whole, 9)).decode()


class Surface(geometry.Geometry):
    """An indexed mesh with normals, and colours and skinning weights where given."""

    def __init__(self, vertices: Array, faces: Array, normals: Array, **attributes: Array) -> None:
        super().__init__()
        self._faces = faces
        self._attributes = {"position": vertices, "normal": normals, **attributes}

    def lower(self, object_data: Any) -> dict[str, Any]:
        """The form in which meshcat sends a geometry."""

        def packed(values: Array) -> dict[str, Any]:
            return dict(geometry.pack_numpy_array(np.asarray(values, np.float32).T))

        index = geometry.umsgpack.Ext(0x16, np.asarray(self._faces, np.uint32).tobytes())
        data = {
            "attributes": {name: packed(values) for name, values in self._attributes.items()},
            "index": {"itemSize": 1, "type": "Uint32Array", "array": index, "normalized": False},
        }
        return {"uuid": self.uuid, "type": "BufferGeometry", "data": data}


def _material(kind: str, **settings: Any) -> geometry.Material:
    return type(kind, (geometry.GenericMaterial,), {"_type": kind})(**settings)


def linear(rgb: Array) -> Array:
    """Linear light of an sRGB colour; three.js r132 does not convert material and vertex colours."""
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def _hex(code: str) -> int:
    return _packed(colour(code))


def _packed(rgb: Any) -> int:
    """An sRGB colour (3,) in 0 to 1 as three.js takes it."""
    r, g, b = (255 * linear(np.asarray(rgb, float))).round().astype(int)
    return int(r) << 16 | int(g) << 8 | int(b)


def stage(hub: Hub, root: str = "foot") -> meshcat.Visualizer:
    """Background and light; returns meshcat's visualizer on the hub. Under `root`, y is meshcat's z: up."""
    visualizer = meshcat.Visualizer(window=hub)
    turned = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    visualizer[root].set_transform(turned)
    for name in ("Grid", "Axes"):
        hub.property(f"/{name}", "visible", False)
    hub.property("/Background", "top_color", [0.010, 0.014, 0.024])
    hub.property("/Background", "bottom_color", [0.055, 0.072, 0.098])
    for name in ("PointLightNegativeX", "PointLightPositiveX", "FillLight", "SpotLight"):
        hub.property(f"/Lights/{name}", "visible", False)
        hub.property(f"/Lights/{name}/<object>", "castShadow", False)
    hub.property("/Lights/AmbientLight/<object>", "intensity", 0.16)
    ground = _hex("#9a7a60")
    sky = {"uuid": "sky", "type": "HemisphereLight", "color": 0xFFFFFF, "groundColor": ground, "intensity": 0.4}
    hub.object("/Lights/Sky", {"uuid": "sky group", "type": "Group", "children": [sky]})
    camera = {"uuid": "key camera", "type": "OrthographicCamera", "left": -2.4, "right": 2.4, "top": 2.4,
              "bottom": -2.4, "near": 0.5, "far": 14}  # fmt: skip
    shadow = {"bias": -4e-4, "normalBias": 0.012, "radius": 4, "mapSize": [2048, 2048], "camera": camera}
    _sun(hub, "Key", "#fff4e4", 1.25, (1.8, -3.4, 4.6), castShadow=True, shadow=shadow)
    _sun(hub, "Rim", "#bcd4ff", 0.85, (-3.5, 2.8, 2.2), castShadow=False)
    _sun(hub, "Front", "#ffe9d2", 0.32, (4.0, 1.5, 1.6), castShadow=False)
    return visualizer


def _sun(hub: Hub, name: str, code: str, intensity: float, at: tuple[float, float, float], **more: Any) -> None:
    matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, *at, 1.0]
    light = {"uuid": name, "type": "DirectionalLight", "color": _hex(code), "intensity": intensity, "matrix": matrix}
    hub.object(f"/Lights/{name}", light | more)


def add_foot(
    hub: Hub, visualizer: meshcat.Visualizer, name: str, parts: list[Part], frames: dict[str, Frame], ghost: bool,
    tints: Mapping[str, Array],
) -> None:  # fmt: skip
    """Put the meshes of one foot into the scene under `name`: one a segment, and the soft parts with their weights.

    Args:
        hub: takes the messages.
        visualizer: on the hub.
        name: of this foot, such as ``a``.
        parts: the meshes.
        frames: bind pose of each segment; the mesh of a segment is sent in that frame.
        ghost: whether it is bluish and translucent, for a comparison.
        tints: segment -> RGB (3,) in place of bone.
    """
    root = visualizer["foot"][name]
    for segment in SEGMENTS[:-1]:
        group = [part for part in parts if part.segment == segment]
        if not group:
            continue
        offset = np.cumsum([0, *(len(part.vertices) for part in group)])
        vertices = np.vstack([part.vertices for part in group]) - frames[segment].position
        faces = np.vstack([part.faces + o for part, o in zip(group, offset, strict=False)])
        normals = np.vstack([part.normals for part in group])
        paint = linear(np.vstack([part.colours for part in group]))
        look: dict[str, Any] = {"vertexColors": True, "color": 0xFFFFFF}
        if segment in tints:
            look = {"color": _packed(tints[segment])}
        if ghost:
            look = {"color": _hex("#5fb4ff"), "transparent": True, "opacity": 0.38, "depthWrite": False,
                    "polygonOffset": True, "polygonOffsetFactor": 2, "polygonOffsetUnits": 2}  # fmt: skip
        material = _material(
            "MeshPhongMaterial", shininess=22, specular=_hex("#2a2620"), side=0, reflectivity=0.3, **look
        )
        root[segment].set_object(Surface(SCALE * vertices, faces, normals, color=paint), material)
        if ghost:
            hub.property(f"/meshcat/foot/{name}/{segment}/<object>", "castShadow", False)
    for part in parts:
        if part.segment is None and not (ghost and part.name == "skin"):
            _add_soft(hub, root, name, part, ghost)
    if not ghost:
        _add_table(hub, root, tints.get("base"))


_SOFT_LOOKS: dict[str, dict[str, Any]] = {
    "skin": {"code": "#d8a58a", "opacity": 0.55, "depthWrite": False, "shininess": 8, "specular": "#332a22"},
    "aponeurosis": {"code": "#ffffff", "opacity": 1.0, "depthWrite": True, "shininess": 45, "specular": "#44484c"},
    "heel_pad": {"code": "#ffffff", "opacity": 0.62, "depthWrite": True, "shininess": 60, "specular": "#554422"},
    "forefoot_pad": {"code": "#ffffff", "opacity": 0.62, "depthWrite": True, "shininess": 60, "specular": "#554422"},
}


def _add_soft(hub: Hub, root: meshcat.Visualizer, foot: str, part: Part, ghost: bool) -> None:
    look = _SOFT_LOOKS[part.name]
    opacity = 0.3 * look["opacity"] if ghost else look["opacity"]
    material = _material(
        "MeshPhongMaterial", color=_hex("#5fb4ff" if ghost else look["code"]), side=0, transparent=opacity < 1,
        opacity=opacity, depthWrite=look["depthWrite"] and not ghost, shininess=look["shininess"],
        specular=_hex(look["specular"]), polygonOffset=ghost, polygonOffsetFactor=2, polygonOffsetUnits=2,
    )  # fmt: skip
    surface = Surface(SCALE * part.vertices, part.faces, part.normals, weights=part.weights)
    root[part.name].set_object(surface, material)
    path = f"/meshcat/foot/{foot}/{part.name}/<object>"
    hub.property(path, "renderOrder", 3 if part.name == "skin" else 1)
    hub.property(path, "frustumCulled", False)
    if opacity < 1:
        hub.property(path, "castShadow", False)


def _add_table(hub: Hub, root: meshcat.Visualizer, tint: Array | None) -> None:
    """The shaker's table, in the colour `tint` (3,) if the model gives it one, and the shaker under it."""
    top = 1e-3 * TABLE * SCALE
    path = "/".join(("", "meshcat", "foot", root.path.entries[-1]))
    for name, size, at, code in (
        ("base", (3.3, 0.12, 1.5), (0.30, top - 0.06, -0.02), "#434d59"),
        ("shaker", (1.5, 0.34, 0.9), (0.30, top - 0.30, -0.02), "#20262d"),
    ):
        paint = _hex(code) if tint is None or name != "base" else _packed(tint)
        material = _material("MeshPhongMaterial", color=paint, shininess=70, specular=_hex("#39424c"), side=0)
        root[name].set_object(geometry.Box(size), material)
        move = np.eye(4)
        move[:3, 3] = at
        root[name].set_transform(move)
        hub.property(f"{path}/{name}/<object>", "castShadow", False)


def add_geoms(visualizer: meshcat.Visualizer, name: str, model: mujoco.MjModel, geoms: Mapping[int, str]) -> None:
    """Put geoms of an MJCF into the scene as they are, each into the node of its body.

    Args:
        visualizer: on the hub.
        name: of the foot.
        model: compiled.
        geoms: number of a geom -> node.
    """
    kinds = mujoco.mjtGeom
    for i, node in geoms.items():
        size, kind = SCALE * model.geom_size[i], int(model.geom_type[i])
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[i])
        lying = kind in (kinds.mjGEOM_CAPSULE, kinds.mjGEOM_CYLINDER)
        along = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]])  # meshcat's cylinder stands along y, MuJoCo's along z
        frame = np.eye(4)
        frame[:3, :3] = rotation.reshape(3, 3) @ (along if lying else np.eye(3))
        frame[:3, 3] = SCALE * model.geom_pos[i]
        shape: geometry.Geometry
        if kind == kinds.mjGEOM_BOX:
            shape = geometry.Box(2 * size)
        elif kind == kinds.mjGEOM_SPHERE:
            shape = geometry.Sphere(size[0])
        elif kind == kinds.mjGEOM_ELLIPSOID:
            shape = geometry.Ellipsoid(size)
        elif kind == kinds.mjGEOM_MESH:
            shape = _mesh_of(model, int(model.geom_dataid[i]))
        elif kind == kinds.mjGEOM_PLANE:
            shape = geometry.Box([*(2 * np.where(size[:2] > 0, size[:2], SCALE)), 0.01])
        elif lying:
            shape = geometry.Cylinder(2 * size[1], size[0])
        else:  # a height field has no counterpart
            continue
        *rgb, alpha = model.geom_rgba[i]
        look = {"transparent": True, "opacity": float(alpha)} if alpha < 1 else {}
        root = visualizer["foot"][name][node]
        root[f"geom{i}"].set_object(shape, _material("MeshPhongMaterial", color=_packed(rgb), shininess=30, **look))
        root[f"geom{i}"].set_transform(frame)
        if kind == kinds.mjGEOM_CAPSULE:
            for end in (-1, 1):
                cap = frame.copy()
                cap[:3, 3] += end * size[1] * frame[:3, 1]
                ball = root[f"geom{i} end{end}"]
                ball.set_object(geometry.Sphere(size[0]), _material("MeshPhongMaterial", color=_packed(rgb), **look))
                ball.set_transform(cap)


def _mesh_of(model: mujoco.MjModel, number: int) -> "Surface":
    first, count = model.mesh_vertadr[number], model.mesh_vertnum[number]
    start, faces = model.mesh_faceadr[number], model.mesh_facenum[number]
    return _with_normals(SCALE * model.mesh_vert[first : first + count], model.mesh_face[start : start + faces])


def _with_normals(vertices: Array, faces: Array) -> "Surface":
    """A surface whose normals are the mean of those of the triangles (m, 3) at each vertex (n, 3)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, faces[:, k], np.cross(b - a, c - a))
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return Surface(vertices, faces, normals / np.where(length > 0, length, 1))


def add_ring(visualizer: meshcat.Visualizer, name: str, centre: Array, radius: float, code: str, thick: float) -> None:
    """A ring about the vertical through `centre` (3,) [m], in the frame of its node ``ring``: where a malleolus is.

    Args:
        visualizer: on the hub.
        name: of the foot.
        centre, radius: of the ring [m].
        code: its colour.
        thick: [m].
    """
    around, over = 48, 12
    u, v = np.meshgrid(np.arange(around) * 2 * np.pi / around, np.arange(over) * 2 * np.pi / over, indexing="ij")
    distance = radius + thick * np.cos(v)
    vertices = np.stack([distance * np.cos(u), thick * np.sin(v), distance * np.sin(u)], -1).reshape(-1, 3) + centre
    index = np.arange(around * over).reshape(around, over)
    right, up = np.roll(index, -1, 0), np.roll(index, -1, 1)
    across = np.roll(right, -1, 1)
    faces = np.vstack(
        [np.stack([index, up, right], -1).reshape(-1, 3), np.stack([right, up, across], -1).reshape(-1, 3)]
    )
    material = _material("MeshPhongMaterial", color=_hex(code), emissive=_hex(code), emissiveIntensity=0.5, side=2)
    visualizer["foot"][name]["ring"].set_object(_with_normals(SCALE * vertices, faces), material)


#: Matt, so that the dish is even behind the translucent cell.
_DISH_LOOK = _material("MeshLambertMaterial", color=_hex("#20282f"), reflectivity=0, side=2)
_CELL_LOOKS: dict[str, dict[str, Any]] = {
    "wall": {"color": 0xFFFFFF, "vertexColors": True, "transparent": True, "opacity": 0.55, "shininess": 40},
    "nucleus": {"color": _hex("#e0245e"), "shininess": 60},
}


def add_cell(
    hub: Hub, visualizer: meshcat.Visualizer, parts: dict[str, tuple[Array, Array, Array]], dish: bool = True
) -> None:
    """Put a cell or a body into the scene, each part with its mode shapes as attributes `mode1`, `mode2`, ...

    Args:
        hub: takes the messages.
        visualizer: on the hub.
        parts: vertices (p, 3), triangles and modes (c, p, 3) by name; the page computes normals and
            colours, which change with mode and time.
        dish: it stands on one.
    """
    root = visualizer["cell"]
    for name, (vertices, faces, modes) in parts.items():
        attributes = {f"mode{i}": mode for i, mode in enumerate(modes, start=1)}
        surface = Surface(vertices, faces, np.zeros_like(vertices), color=np.ones_like(vertices), **attributes)
        look = {"side": 0, "specular": _hex("#3a3a40"), "reflectivity": 0.15} | _CELL_LOOKS.get(name, {})
        root[name].set_object(surface, _material("MeshPhongMaterial", **look) if name in _CELL_LOOKS else _DISH_LOOK)
        hub.property(f"/meshcat/cell/{name}/<object>", "frustumCulled", False)
    if not dish:
        return
    root["dish"].set_object(geometry.Cylinder(0.05, 1.6), _DISH_LOOK)
    hub.property("/meshcat/cell/dish/<object>", "castShadow", False)
    move = np.eye(4)
    move[1, 3] = -0.03
    root["dish"].set_transform(move)
