"""The modes of any body in a file: a bone, an insole block, a shoe sole; free or held somewhere.

Elements, matrices and solver are those of the cell. `fasbody cell modes`; docs/cell.md.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

import mjcf
from fasbody.cell.analysis import ModalAnalysis
from fasbody.cell.assembly import FREE, assemble
from fasbody.cell.companion import pair, richardson, surface_meshes
from fasbody.cell.materials import Material
from fasbody.cell.mesh import FACES, MeshSize, TetMesh
from fasbody.cell.mesher import LIMIT, filled, largest
from fasbody.cell.meshfile import (
    TETRAHEDRA,
    TRIANGLES,
    Group,
    mesh_format,
    naming,
    read_surface,
    read_tetrahedra,
)
from fasbody.cell.modal import CellModel, solve
from fasbody.cell.surface import rounded, volume
from fasbody.cell.viscoelastic import (
    BaseResponse,
    DampedModes,
    ForceResponse,
    ReducedCell,
    StandardLinearSolid,
    base_response,
    damped_modes,
    force_response,
)
from fasbody.exceptions import InputFileError, MeshError, SettingError, required, unknown
from fasbody.presentation import Tabled, readable
from fasbody.progress import Advance, silent

T = TypeVar("T")
#: Meshing, and the modes of either mesh.
STEPS = 3
#: Length units of files [um].
UNITS = {"nm": 1e-3, "um": 1.0, "mm": 1e3, "cm": 1e4, "m": 1e6}
SUPPORTS = ("free", "base", "region")
SURFACES, VOLUMES = (".stl", ".obj"), (".vtu", ".msh")
#: The error of a body falls as h^ORDER or faster: held ends and inner corners are singular, and
#: the limit of a cantilever lay outside what 2 gives.
ORDER = 1.0
#: The unit in which the bundled bones are stored (`viz.anatomy.assets`) [um].
GRAIN_UM = 10.0
#: Share of an error from which it is worth a sentence.
ROUND = 1e-4
#: Error from which a finer mesh is advised, and what share of a size is worth it.
LARGE, WORTH = 0.05, 0.95
#: Share of the kinetic energy from which a direction is named.
NAMED = 0.05
#: Mass below which the length unit of a file in millimetres is doubtful [kg].
LEAST_KG = 1e-6


@dataclass(frozen=True)
class Body(Tabled):
    """Tetrahedra with the names that their file gives to parts of them.

    Args:
        name: of the file or the bone.
        mesh: its regions are numbered in the order of the groups of tetrahedra.
        rough: the same body in larger elements, for the error.
        groups: of triangles and tetrahedra in the file; a surface has one, 0.
        unit: of the file, one of `UNITS`.
        changed: share of the volume that the mesh loses or gains of its surface, or that flat
            triangles leave out of a round one; it is added to the error.
        size_um: of the elements in a surface [um], None for tetrahedra of a file.

    Example:
        >>> body_modes(read_body("calcaneus"), {None: Material(7.3e9, 0.3, 1500.0)})
    """

    name: str
    mesh: TetMesh
    rough: TetMesh
    groups: tuple[Group, ...] = (Group(0),)
    unit: str = "mm"
    changed: float = 0.0
    size_um: float | None = None

    @property
    def tags(self) -> tuple[int, ...]:
        """Number (r,) of each region in the file."""
        return tuple(group.number for group in self.groups if group.kind == TETRAHEDRA)

    def group(self, text: str, option: str, kinds: tuple[str, ...] = (TRIANGLES, TETRAHEDRA)) -> Group:
        """The group that a number or a name means.

        Args:
            text: of the user; `triangles:` or `tetrahedra:` before it states which.
            option: that has it, without its dashes.
            kinds: that will do.

        Raises:
            SettingError: there is none, or there are two.
        """
        groups = [group for group in self.groups if group.kind in kinds]
        meant = [group for group in groups if text in group.labels]
        if len(meant) == 1:
            return meant[0]
        if meant:
            ways = " or ".join(f"{group.kind}:{group.number}" for group in meant)
            raise SettingError(f"{text!r} may be {ways} in {self.name}: say which.", option)
        have = ", ".join(map(str, groups)) or "none"
        raise SettingError(f"{self.name} has no region {text!r}; it has: {have}.", option)

    def holding(self, support: str, part: str | None = None) -> tuple[NDArray[np.int64], Group | None]:
        """Corners (f, 3) of the faces that a support holds still, and of a region what that is.

        Args:
            support: "free"; "base", every face flat on the lowest plane; or "region".
            part: of "region", the number or name of triangles or of tetrahedra in the file; those
                are held whole.

        Raises:
            SettingError: no such support or region, or a number of both triangles and tetrahedra.
            InputFileError: the body has no flat base.
        """
        if support not in SUPPORTS:
            raise SettingError(unknown("support", support, SUPPORTS) + ".", "support")
        if (part is None) == (support == "region"):
            have = ", ".join(map(str, self.groups))
            raise SettingError(
                f"--support region needs --held, one of the regions of {self.name}: {have}."
                if part is None
                else f"{part!r} goes with --support region, and the support is {support}.",
                "held",
            )
        if support == "free":
            return FREE, None
        if part is None:
            try:
                return self.mesh.base, None
            except MeshError as error:
                raise InputFileError(
                    Path(self.name), str(error).rstrip("."),
                    "hold it by --support region, or leave it free by --support free; --up says "
                    "which axis points up",
                ) from error  # fmt: skip
        group = self.group(part, "held")
        if group.kind == TRIANGLES:
            return self.mesh.faces[group.number], group
        if len(self.tags) == 1:
            text = f"all of {self.name} is region {group.number}: nothing of it could move."
            raise SettingError(text, "held")
        tets = self.mesh.tets[self.mesh.region == self.tags.index(group.number)]
        return np.asarray(tets[:, :4][:, np.array(FACES)].reshape(-1, 3)), group

    def by_region(self, option: str, values: Mapping[str | None, T]) -> tuple[T, ...]:
        """The value of each region.

        Args:
            option: that gives it, without its dashes.
            values: by number or name of a region; None is for all others.

        Raises:
            SettingError: a region has no value or two, or a value no region.
        """
        chosen: dict[int, T] = {}
        for name, value in values.items():
            if name is None:
                continue
            tag = self.group(name, option, (TETRAHEDRA,)).number
            if tag in chosen:
                raise SettingError(f"region {tag} of {self.name} has one already.", option)
            chosen[tag] = value
        bare = [tag for tag in self.tags if tag not in chosen]
        if bare and None not in values:
            text = f"region {bare[0]} of {self.name} has none: give --{option} {bare[0]}=VALUES."
            raise SettingError(text, option)
        return tuple(chosen[tag] if tag in chosen else values[None] for tag in self.tags)


def bones() -> list[str]:
    """Names of the bundled bones and soft parts, modelled after atlases and not scanned."""
    with np.load(mjcf.asset("anatomy.npz"), allow_pickle=False) as stored:
        return [str(name) for name in stored["names"]]


def read_body(source: str | Path, *, unit: str = "mm", up: str = "y", size: float | None = None) -> Body:
    """A body from a file, or one of the bundled `bones`.

    Args:
        source: .vtu or .msh with tetrahedra of 4 or 10 nodes, closed .stl or .obj surface, or the
            name of a bone.
        unit: length unit of the file, one of `UNITS`; bones bring theirs.
        up: axis that points up from the base, "x", "y" or "z".
        size: element size in a surface, in its unit, millimetres for bones; None is two through
            its thickness.

    Raises:
        SettingError: no such unit or axis, or the size asks for too many unknowns.
        InputFileError: the file cannot be read or is not one sound body.
    """
    for name, value, valid in (("unit", unit, tuple(UNITS)), ("up", up, ("x", "y", "z"))):
        if value not in valid:
            raise SettingError(unknown(name, value, valid) + ".", name)
    file, axis = Path(source), "xyz".index(up)
    bone = not file.suffix and str(source) in bones()
    word = not file.suffix and file.name == str(source)
    otherwise = f"or name a bone: {', '.join(bones())}" if word else "name a .vtu, .msh, .stl or .obj file"
    kind = ".stl" if bone else mesh_format(file, (*VOLUMES, *SURFACES), otherwise)
    if kind in VOLUMES and size is not None:
        text = f"an element size serves a surface; {file} brings its own tetrahedra: leave it out."
        raise SettingError(text, "size")
    with naming(file):
        if kind in VOLUMES:
            mesh, groups = read_tetrahedra(file, UNITS[unit])
            mesh = replace(mesh, up=axis).check()
            changed = 0.0 if mesh.curved else rounded(mesh.surface)
            return Body(str(source), *pair(mesh), groups, unit, changed)
        surface = _bone(str(source)) if bone else read_surface(file, UNITS[unit])
        unit = "mm" if bone else unit
        sizes = None if size is None else MeshSize.of(size * UNITS[unit])
        fine, rough, used = surface_meshes(surface, sizes, (unit, UNITS[unit]))
        changed = abs(fine.volume_um3 / volume(surface) - 1) + rounded(surface)
        fine, rough = replace(fine, up=axis), replace(rough, up=axis)
        return Body(str(source), fine, rough, unit=unit, changed=changed, size_um=used)


def _bone(name: str) -> Any:
    with required("trimesh", "cell"):
        import trimesh
    with np.load(mjcf.asset("anatomy.npz"), allow_pickle=False) as stored:
        vertices, faces = stored[f"{name}.vertices"], stored[f"{name}.faces"]
    return trimesh.Trimesh(GRAIN_UM * vertices.astype(np.float64), faces.astype(np.int64))


@dataclass(frozen=True)
class BodyMode:
    """How one mode moves.

    Args:
        energy: share (3,) of the kinetic energy in motion along x, y, z.
        parts: share of the kinetic energy in each region, by its number in the file.
    """

    energy: tuple[float, ...]
    parts: Mapping[int, float]

    @property
    def label(self) -> str:
        """The directions that matter, the strongest first: such as "z 93%, x 6%"."""
        order = sorted(zip(self.energy, "xyz", strict=True), reverse=True)
        return ", ".join(f"{axis} {share:.0%}" for share, axis in order if share >= NAMED)

    @property
    def cells(self) -> tuple[str, ...]:
        """Directions, and shares of several regions, for a table."""
        shares = " ".join(f"{tag}: {share:.0%}" for tag, share in self.parts.items())
        return (self.label, shares)[: len(self.parts)]

    def document(self) -> dict[str, Any]:
        """Ready for JSON."""
        parts = list(self.parts.values())
        return {"label": self.label, "energy_xyz": self.energy, "energy_of_regions": parts}


@dataclass(frozen=True, repr=False)
class BodyModes(ModalAnalysis):
    """What ``fasbody cell modes`` reports.

    Args:
        body: mesh and names.
        support: "free", "base" or "region".
        held: the region that is, None for another support.
    """

    body: Body
    support: str
    held: Group | None = None

    columns: ClassVar[tuple[str, ...]] = ("moves along", "kinetic energy of region")
    digits: ClassVar[int] = 5

    def heading(self) -> tuple[str, list[str]]:
        """Body, support and size, with what is to be said of all modes."""
        remarks = [self.remark] if self.remark else []
        if (share := self.body.changed) > ROUND:
            remarks += [f"{share:.2%} of each error is due to the flat triangles of the surface"]
        dof = self.model.assembly.dof
        side_mm = 1e-3 * float(np.ptp(self.model.assembly.nodes_um, axis=0).max())
        if self.body.unit in ("mm", "cm") and (side_mm < 1 or self.model.mass_kg < LEAST_KG):
            text = f"the body is only {side_mm:.2g} mm long and weighs {readable(1e6 * self.model.mass_kg)} mg"
            remarks.append(f"{text}: if its file is in metres, use --unit m")
        if advice := self._advice():
            remarks.append(advice)
        cm3, grams = self.model.assembly.volume_um3 * 1e-12, 1e3 * self.model.mass_kg
        size = f"{cm3:.4g} cm^3, {grams:.4g} g, {dof} unknowns"
        return f"{self.title}: {size}", [f"{remark}." for remark in remarks]

    def _advice(self) -> str:
        """What makes errors smaller that are large by their mesh; empty where none are."""
        if self.errors is None:
            return ""
        error, shape, size = float(self.errors.max()), self.body.changed, self.body.size_um
        if error <= LARGE or shape > LARGE / 2:
            return ""
        head, surface = "for errors below 5 %", self.body.mesh.surface
        if size is None:
            return f"{head} use a mesh of smaller elements"
        name, um = self.unit
        needed = size * (LARGE - shape) / (error - shape) / um
        fits = largest(lambda h: filled(surface, h * um), needed, LIMIT)
        digit = 10 ** (np.floor(np.log10(fits)) - 1)
        finer = float(np.ceil(fits / digit) * digit)
        if finer > WORTH * size / um:
            return f"{head} a smaller --size would be needed, which does not fit into 4 GB of memory"
        many = round(filled(surface, finer * um), -4)
        return f"{head} use --size {finer:.2g} ({name}; about {many:.0f} unknowns)"

    def document(self) -> dict[str, Any]:
        """Everything but the shapes, ready for JSON."""
        assembly = self.model.assembly
        regions = zip(self.body.tags, self.model.materials, assembly.regions, strict=False)
        return super().document() | {
            "body": self.body.name,
            "support": self.support,
            "held": None if self.held is None else asdict(self.held),
            "size_m": np.ptp(assembly.nodes_um, axis=0) * 1e-6,
            "volume_m3": assembly.volume_um3 * 1e-18,
            "mass_kg": self.model.mass_kg,
            "regions": [
                {"tag": tag, "E_pa": m.E, "nu": m.nu, "rho_kg_m3": m.rho,
                 "volume_m3": region.volume_um3 * 1e-18}
                for tag, m, region in regions
            ],
            "rigid_hz": self.modes.rigid_hz,
            "shape_error": self.body.changed,
        }  # fmt: skip


def body_modes(
    body: Body, materials: Mapping[str | None, Material], support: str = "free", *,
    part: str | None = None, count: int = 10, way: str | None = None,
    advance: Advance = silent,
) -> BodyModes:  # fmt: skip
    """The lowest modes of a body.

    Args:
        body: of `read_body`.
        materials: by number or name of a region, None for the others.
        support: "free", "base" or "region".
        part: the region that is held.
        count: number of modes, rigid motions not counted.
        way: solver, None is the fastest.
        advance: is told of `STEPS`, of `fasbody.console.stages`.
    """
    chosen = body.by_region("material", materials)

    def model_of(mesh: TetMesh) -> tuple[CellModel, Group | None]:
        faces, held = replace(body, mesh=mesh).holding(support, part)
        return CellModel(assemble(mesh, held=faces), chosen), held

    with naming(body.name):
        (model, held), (rough, _) = model_of(body.mesh), model_of(body.rough)
    advance("modes of the finer mesh", 1, STEPS)
    modes = solve(model, count, way=way)
    advance("modes of the coarser mesh, for the errors", 2, STEPS)
    coarse_hz = solve(rough, count).frequencies_hz
    errors = body.changed + richardson(coarse_hz, modes.frequencies_hz, rough.assembly.dof, model.assembly.dof, ORDER)
    phi, moving = modes.vectors, model.M @ modes.vectors
    along = [(phi[axis::3] * moving[axis::3]).sum(axis=0) for axis in range(3)]
    parts = [(phi * (model.mass(r) @ phi)).sum(axis=0) for r in range(len(body.tags))]
    descriptions = tuple(
        BodyMode(tuple(energy.tolist()), dict(zip(body.tags, shares.tolist(), strict=True)))
        for energy, shares in zip(np.array(along).T, np.array(parts).T, strict=True)
    )
    unit, rigid = (body.unit, UNITS[body.unit]), modes.rigid_hz
    size = " x ".join(f"{side / unit[1]:.4g}" for side in np.ptp(model.assembly.nodes_um, axis=0))
    where = {"free": "free", "base": "held at its base"}.get(support, f"held at {held}")
    title = f"{Path(body.name).name}, {size} {body.unit}, {where}"
    motions = f"the six rigid motions of the free body (at most {rigid.max(initial=0.0):.1g} Hz) are not listed"
    remark = motions if len(rigid) else ""
    return BodyModes(model, modes, descriptions, errors, title, remark, unit, body, support, held)


@dataclass(frozen=True)
class ShakenBody(Tabled):
    """What ``fasbody cell response`` reports.

    Args:
        elastic: modes and their errors without damping.
        damped: modes of the viscoelastic body.
        response: to the motion of its support, or to a force on a free body.
    """

    elastic: BodyModes
    damped: DampedModes
    response: BaseResponse | ForceResponse

    def document(self) -> dict[str, Any]:
        """Ready for JSON."""
        kind = "base_response" if isinstance(self.response, BaseResponse) else "force_response"
        parts = {"damped_modes": self.damped.document(), kind: self.response.document()}
        return self.elastic.document() | parts

    def __str__(self) -> str:
        assert self.elastic.errors is not None
        error = float(self.elastic.errors.max())
        head = f"{self.elastic.title}: elastic frequencies within {error:.2%}"
        return f"{head}\n{self.damped}\n{self.response}"


def shaken_body(
    body: Body, materials: Mapping[str | None, Material],
    solids: Mapping[str | None, StandardLinearSolid], support: str = "base", *,
    part: str | None = None, count: int = 20, advance: Advance = silent,
) -> ShakenBody:  # fmt: skip
    """Damping and response from a hundredth of the first frequency to the last; see `body_modes`.

    Args:
        body: of `read_body`.
        materials: by number or name of a region, None for the others.
        solids: relaxation, likewise.
        support: what is shaken; "free" is driven by a force.
        part: the region that is held.
        count: modes in the basis.
        advance: see `body_modes`.
    """
    relaxing = body.by_region("relaxation", solids)
    elastic = body_modes(body, materials, support, part=part, count=count, advance=advance)
    reduced = ReducedCell.of(elastic.model, count, elastic.modes)
    damped = damped_modes(reduced, relaxing)
    grid = damped.grid(elastic.frequencies_hz[0] / 100, reduced.reach_hz)
    if elastic.model.assembly.flies:
        return ShakenBody(elastic, damped, force_response(reduced, relaxing, grid))
    return ShakenBody(elastic, damped, base_response(reduced, relaxing, grid, inner=None))
