"""A cytoskeleton as a tensegrity of 6 struts and 24 cables in the cell (section 5.1, Chapter 6).

Twelve nodes of the expanded octahedron, mapped affinely into the dome so that a triangle of nodes
stands on the base: the focal adhesions. Struts are microtubules, cables microfilaments. Force
densities -3/2 q in the struts and q in the cables balance at every node, also after an affine
map, so prestress adds geometric stiffness and loads nothing.

Bars rather than MuJoCo tendons, because they must pull on the same finite elements. A node is tied
to the mean motion of a small ball of cytoplasm around it: a point would give a stiffness that
vanishes as the mesh is refined. The bars' mass (some 1e-17 kg against 1e-11 kg) is left out.
"""

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from fasbody.cell.assembly import Assembly
from fasbody.cell.mesh import QUADRATURE
from fasbody.exceptions import SettingError


@dataclass(frozen=True)
class Tensegrity:
    """Bars of the cytoskeleton.

    Args:
        strut_E: Young's modulus of a strut [Pa]; Table 5.1.
        cable_E: Young's modulus of a cable [Pa]; Table 5.1.
        strut_area_nm2: cross-section of a strut [nm^2]; 190 is that of one microtubule (McGarry
            and Prendergast 2004, the source of Table 5.1). A cell has bundles: raise it.
        cable_area_nm2: cross-section of a cable [nm^2]; 18 is that of one microfilament.
        bundle: number of such filaments in each bar.
        cable_force_pn: mean tension of a single filament's cable [pN]; 0 leaves prestress out.
        reach: half width of the tensegrity, of the cell's half axes.
        height: height of its uppermost nodes, of the cell's height.
        grip_um: radius of the ball of cytoplasm that a node holds [um].

    Raises:
        SettingError: an invalid value.
    """

    strut_E: float = 1.2e9
    cable_E: float = 2.6e9
    strut_area_nm2: float = 190.0
    cable_area_nm2: float = 18.0
    bundle: float = 1.0
    cable_force_pn: float = 0.0
    reach: float = 0.75
    height: float = 0.75
    grip_um: float = 2.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name in ("reach", "height"):
                valid, need = 0 < value < 1, "lie between 0 and 1, inside the cell"
            elif name == "cable_force_pn":  # cables cannot push
                valid, need = 0 <= value < math.inf, "be 0 or more"
            else:
                valid, need = 0 < value < math.inf, "be a positive number"
            if not valid:
                raise SettingError(f"the cytoskeleton's {name} must {need}, not {value}.", name)


@dataclass(frozen=True)
class Bars:
    """The net in place.

    Args:
        nodes_um: positions (12, 3) [um].
        struts: node numbers (6, 2).
        cables: node numbers (24, 2).
    """

    nodes_um: NDArray[np.float64]
    struts: NDArray[np.int64]
    cables: NDArray[np.int64]


def expanded_octahedron() -> Bars:
    """The free-standing tensegrity, struts of length 4, three nodes below and three above; y up."""
    cyclic = [np.roll((0, a, 2 * b), k) for k in range(3) for a in (-1, 1) for b in (-1, 1)]
    up = np.ones(3) / np.sqrt(3)
    across = np.array([1.0, -1.0, 0.0]) / np.sqrt(2)
    nodes = np.array(cyclic, float) @ np.stack([across, up, np.cross(across, up)], axis=1)
    pairs = np.array(list(combinations(range(12), 2)))
    length2 = (np.diff(nodes[pairs], axis=1) ** 2).sum(axis=(1, 2))
    return Bars(nodes, pairs[np.isclose(length2, 16)], pairs[np.isclose(length2, 6)])


def place(assembly: Assembly, net: Tensegrity) -> Bars:
    """The tensegrity in the cell: lowest triangle on the base, widest nodes at `reach`."""
    unit = expanded_octahedron()
    low, high = assembly.nodes_um.min(axis=0), assembly.nodes_um.max(axis=0)
    x, up, z = unit.nodes_um.T
    level = net.height * (up - up.min()) / np.ptp(up)
    widest = np.hypot(x, z).max()
    shares = np.stack([0.5 + net.reach * x / widest / 2, level, 0.5 + net.reach * z / widest / 2], axis=1)
    return Bars(low + shares * (high - low), unit.struts, unit.cables)


def cytoskeleton_stiffness(assembly: Assembly, net: Tensegrity, metres_per_um: float) -> sp.csr_array:
    """Stiffness [N/m] that the tensegrity adds on the free unknowns.

    Forces scale with the square of `metres_per_um`, as the areas do, so that f ~ 1/L holds.

    Raises:
        SettingError: a node holds no cytoplasm.
    """
    bars = place(assembly, net)
    um2 = (metres_per_um / 1e-6) ** 2
    cable_ends = np.diff(bars.nodes_um[bars.cables], axis=1)[:, 0]
    mean_length = float(np.linalg.norm(cable_ends, axis=1).mean()) * metres_per_um
    density = um2 * net.bundle * net.cable_force_pn * 1e-12 / mean_length
    K = np.zeros((36, 36))
    for kind, E, area_nm2, q in (
        (bars.struts, net.strut_E, net.strut_area_nm2, -1.5 * density),
        (bars.cables, net.cable_E, net.cable_area_nm2, density),
    ):
        for a, b in kind:
            along = bars.nodes_um[b] - bars.nodes_um[a]
            length = float(np.linalg.norm(along))
            nn = np.outer(along, along) / length**2
            stretch = um2 * E * net.bundle * area_nm2 * 1e-18 / (length * metres_per_um)
            # a tense bar also resists sideways motion, with its force over its length
            k = stretch * nn + q * (np.eye(3) - nn)
            ends = np.eye(12)[a] - np.eye(12)[b]
            K += np.kron(np.outer(ends, ends), k)
    tie = _ties(assembly, bars.nodes_um, net.grip_um)
    return sp.csr_array(tie.T @ sp.csr_array(K) @ tie)


def _ties(assembly: Assembly, nodes_um: NDArray[np.float64], grip_um: float) -> sp.csr_array:
    """Mean motion (36, dof) of the cytoplasm around each node, weighted 1 - (r / grip)^2."""
    from skfem import Basis, ElementTetP2, LinearForm

    basis, rows = Basis(assembly.mesh.skfem, ElementTetP2(), intorder=QUADRATURE), []
    for node in nodes_um:

        def near(v, w, node=node):  # type: ignore[no-untyped-def]
            away2 = ((w.x - node[:, None, None]) ** 2).sum(axis=0)
            return np.maximum(0, 1 - away2 / grip_um**2) * v

        weight = LinearForm(near).assemble(basis)
        total = weight.sum()  # the shape functions sum to 1
        if total <= 0.05 * grip_um**3:  # a full ball has 1.68, half a ball on the base 0.84
            raise SettingError(
                f"a node of the cytoskeleton at {np.round(node, 1).tolist()} um holds no "
                "cytoplasm: lower its reach or height, or raise its grip above the element size."
            )
        rows.append(weight[assembly.free] / total)
    return sp.kron(sp.csr_array(np.array(rows)), sp.eye_array(3), format="csr")
