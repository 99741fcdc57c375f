"""Physics of the vibrating human foot and ankle: models, shaker, recordings, simulation.

    import fasbody as fb

    foot = fb.load("two_dof")
    motion = fb.simulate(foot.with_values({"k_T": 2e5}), fb.sine(20, 1))

A name is imported on first use, so that `import fasbody` costs nothing.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fasbody.arch.bones import Arch
    from fasbody.exceptions import FasError
    from fasbody.foot.model import Foot, load
    from fasbody.foot.shaker import BaseMotion, harmonics, multisine, random, samples, sine, sweep
    from fasbody.foot.simulate import Simulation, simulate
    from fasbody.recording.condition import Condition
    from fasbody.recording.recording import Recording
    from fasbody.recording.study import Study, bundled
    from fasbody.transmissibility.table import Table as Transmissibility

    __version__: str
else:
    _HOMES = {
        "Arch": "fasbody.arch.bones",
        "BaseMotion": "fasbody.foot.shaker",
        "Condition": "fasbody.recording.condition",
        "FasError": "fasbody.exceptions",
        "Foot": "fasbody.foot.model",
        "Recording": "fasbody.recording.recording",
        "Simulation": "fasbody.foot.simulate",
        "Study": "fasbody.recording.study",
        "Transmissibility": "fasbody.transmissibility.table:Table",
        "bundled": "fasbody.recording.study",
        "harmonics": "fasbody.foot.shaker",
        "load": "fasbody.foot.model",
        "multisine": "fasbody.foot.shaker",
        "random": "fasbody.foot.shaker",
        "samples": "fasbody.foot.shaker",
        "simulate": "fasbody.foot.simulate",
        "sine": "fasbody.foot.shaker",
        "sweep": "fasbody.foot.shaker",
    }

    def __getattr__(name: str) -> object:
        if name == "__version__":
            from importlib.metadata import version

            return version("fasbody")
        from fasbody.lazy import attribute

        return attribute(__name__, _HOMES, name)

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})


__all__ = [
    "Arch",
    "BaseMotion",
    "Condition",
    "FasError",
    "Foot",
    "Recording",
    "Simulation",
    "Study",
    "Transmissibility",
    "__version__",
    "bundled",
    "harmonics",
    "load",
    "multisine",
    "random",
    "samples",
    "simulate",
    "sine",
    "sweep",
]
