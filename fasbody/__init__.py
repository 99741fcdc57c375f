"""Physics of the vibrating human foot and ankle: models, shaker, recordings, simulation.

    import fasbody as fb

    foot = fb.load("two_dof")
    motion = fb.simulate(foot.with_values({"k_T": 2e5}), fb.sine(20, 1))

A name is imported on first use, so that `import fasbody` costs nothing.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fasbody.arch.bones import Arch as Arch
    from fasbody.exceptions import FasError as FasError
    from fasbody.foot.model import Foot as Foot
    from fasbody.foot.model import load as load
    from fasbody.foot.shaker import BaseMotion as BaseMotion
    from fasbody.foot.shaker import harmonics as harmonics
    from fasbody.foot.shaker import multisine as multisine
    from fasbody.foot.shaker import random as random
    from fasbody.foot.shaker import samples as samples
    from fasbody.foot.shaker import sine as sine
    from fasbody.foot.shaker import sweep as sweep
    from fasbody.foot.simulate import Simulation as Simulation
    from fasbody.foot.simulate import simulate as simulate
    from fasbody.recording.condition import Condition as Condition
    from fasbody.recording.recording import Recording as Recording
    from fasbody.recording.study import Study as Study
    from fasbody.recording.study import bundled as bundled
    from fasbody.transmissibility.table import Table

    Transmissibility = Table
    __version__: str
else:

    def __getattr__(name: str) -> object:
        if name == "__version__":
            from importlib.metadata import version

            return version("fasbody")
        from fasbody.lazy import attribute

        return attribute(__name__, name)

    def __dir__() -> list[str]:
        return sorted({*globals(), *__getattr__("__all__")})
