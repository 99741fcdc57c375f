"""The scene as messages of meshcat's protocol, kept so that a new browser gets all of it."""

import base64
import gzip
import threading
from collections.abc import Callable
from typing import Any

from fasbody.exceptions import SettingError

try:
    import umsgpack
except ImportError:
    raise SettingError("the viewer needs meshcat: pip install 'fasbody[view]'.") from None

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
