"""The modes of any body in a file: a bone, an insole block, a shoe sole; free, on its base, or held somewhere.

Elements, matrices and solver are those of the cell. `python -m fasbody.cell modes`; docs/cell.md.
"""

from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

import mjcf
from fasbody.cell.assembly import FREE, assemble
from fasbody.cell.companion import pair, richardson, surface_meshes
from fasbody.cell.materials import Material
from fasbody.cell.mesh import FACES, MeshSize, TetMesh, rounded, volume
from fasbody.cell.meshfile import AMBIGUOUS, SURFACE, VOLUME, read_surface, read_tagged
from fasbody.cell.modal import CellModel, Modes, solve
from fasbody.cell.viscoelastic import (
    BaseResponse,
    DampedModes,
    ForceResponse,
    ReducedCell,
    StandardLinearSolid,
    base_response,
    damped_modes,
    force_response,
)  # fmt: skip
from fasbody.exceptions import InputFileError, MeshError, MissingPackageError, SettingError, unknown
from fasbody.presentation import Presented, Sheet, Tabled

T = TypeVar("T")
#: Length units of files [um].
UNITS = {"nm": 1e-3, "um": 1.0, "mm": 1e3, "cm": 1e4, "m": 1e6}
SUPPORTS = ("free", "base", "region")
SURFACES, VOLUMES = (".stl", ".obj"), (".vtu", ".msh")
#: The error of a body falls as h^ORDER or faster: held ends and inner corners are singular, and the limit of a
#: cantilever lay outside what 2 gives.
ORDER = 1.0
#: What a user calls groups of either dimension, and what messages call them.
KINDS = {"triangles": SURFACE, "tetrahedra": VOLUME}
_CALLED = {kind: word for word, kind in KINDS.items()}
#: The unit in which the bundled bones are stored (`viz.anatomy.assets`) [um].
GRAIN_UM = 10.0
#: Share of an error from which it is worth a sentence.
ROUND = 1e-4
#: Share of the kinetic energy from which a direction is named.
NAMED = 0.05


@dataclass(frozen=True)
class Held:
    """A region that is held: its number, its name in the file (empty without), and whether triangles or tetrahedra."""

    number: int
    name: str
    kind: str

    def __str__(self) -> str:
        return f"{self.kind} {self.number}" + (f" ({self.name})" if self.name else "")


@dataclass(frozen=True)
class Body(Tabled):
    """Tetrahedra with the names that their file gives to parts of them.

    Args:
        name: of the file or the bone.
        mesh: regions are numbered in the order of `tags`.
        rough: the same body in larger elements, for the error.
        changed: share of the volume that the mesh loses or gains of its surface, or that flat triangles leave out of a
            round one; it is added to the error.
        tags: number (r,) of each region in the file; a surface has one region, 0.
        names: number and dimension (2 triangles, 3 tetrahedra) by the names that a .msh file gives to its groups; the
            same number may stand for a group of either.
        unit: of the file, one of `UNITS`.
    """

    name: str
    mesh: TetMesh
    rough: TetMesh
    tags: tuple[int, ...] = (0,)
    names: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    unit: str = "mm"
    changed: float = 0.0

    @property
    def faces(self) -> Mapping[int, NDArray[np.int64]]:
        """Corners (f, 3) of the file's triangles, by their number."""
        return self.mesh.faces

    def number(self, text: str, kinds: Collection[int] = (SURFACE, VOLUME)) -> tuple[int, tuple[int, ...]]:
        """The number that a name or a number in words means, and the dimensions of which it may be.

        Args:
            text: of the user; `triangles:` or `tetrahedra:` before it states which.
            kinds: dimensions that will do.

        Raises:
            SettingError: neither number nor name, or of another dimension.
        """
        word, _, rest = text.partition(":")
        if word in KINDS and text not in self.names:
            kinds, text = tuple({KINDS[word]} & set(kinds)), rest
            if rest.isdigit() and int(rest) in (self.faces if word == _CALLED[SURFACE] else self.tags):
                return int(rest), tuple(kinds)  # a number that is also a name
        if text in self.names:
            number, kind = self.names[text]
            if text.isdigit() and int(text) != number and int(text) in {*self.faces, *self.tags}:
                raise SettingError(
                    f"{text} in {self.name} is the name of group {number} and the number of another: say "
                    f"{' or '.join(f'{word}:{group}' for group in (number, text) for word in self._kinds(int(group)))}."
                )
            if kind == AMBIGUOUS:
                either = " or ".join(f"{word}:NUMBER" for word in KINDS)
                raise SettingError(
                    f"{text!r} in {self.name} is a group of triangles and one of tetrahedra: say {either}."
                )
            if kind not in kinds:
                raise SettingError(f"{text!r} in {self.name} is a group of {_CALLED[kind]}, which will not do here.")
            return number, (kind,)
        try:
            return int(text), tuple(kinds)
        except ValueError:
            have = ", ".join(name for name, (_, kind) in self.names.items() if kind in kinds) or "none"
            raise SettingError(f"{text!r} is no number and no name in {self.name}, whose names are: {have}.") from None

    def _kinds(self, number: int) -> list[str]:
        """What of the file has a number: triangles, tetrahedra or both."""
        present = {SURFACE: number in self.faces, VOLUME: number in self.tags}
        return [_CALLED[kind] for kind, has in present.items() if has]

    def held(self, support: str, part: str | None = None) -> NDArray[np.int64]:
        """Corners (f, 3) of the faces that a support holds still; see `holding`."""
        return self.holding(support, part)[0]

    def holding(self, support: str, part: str | None = None) -> "tuple[NDArray[np.int64], Held | None]":
        """Corners (f, 3) of the faces that a support holds still, and of a region what that is.

        Args:
            support: "free"; "base", every face flat on the lowest plane; or "region".
            part: of "region", the number or name of triangles or of tetrahedra in the file; those are held whole.

        Raises:
            SettingError: no such support or region, or a number of both triangles and tetrahedra.
            InputFileError: the body has no flat base.
        """
        if support not in SUPPORTS:
            raise SettingError(unknown("support", support, SUPPORTS) + ".")
        if support == "free":
            return FREE, None
        if support == "base":
            try:
                return self.mesh.base, None
            except MeshError as error:
                hint = "hold it by --support region, or leave it free by --support free; --up says which axis points up"
                raise InputFileError(Path(self.name), str(error).rstrip("."), hint) from error
        have = ", ".join(map(str, sorted({*self.faces, *self.tags})))
        if part is None:
            raise SettingError(f"--support region needs --held, one of the regions of {self.name}: {have}.")
        tag, kinds = self.number(part)
        matches = [kind for kind, tags in ((SURFACE, self.faces), (VOLUME, self.tags)) if kind in kinds and tag in tags]
        if len(matches) == 2:
            either = " or ".join(f"{word}:{tag}" for word in KINDS)
            raise SettingError(f"{tag} in {self.name} is a group of triangles and one of tetrahedra: --held {either}.")
        if not matches:
            raise SettingError(f"{self.name} has no region {tag} to hold; it has {have}.")
        name = next((name for name, group in self.names.items() if group == (tag, matches[0])), "")
        what = Held(tag, name, _CALLED[matches[0]])
        if matches == [SURFACE]:
            return self.faces[tag], what
        if len(self.tags) == 1:
            raise SettingError(f"all of {self.name} is region {tag}: held, nothing of it could move.")
        tets = self.mesh.tets[self.mesh.region == self.tags.index(tag)]
        return np.asarray(tets[:, :4][:, np.array(FACES)].reshape(-1, 3)), what

    def materials(self, by_name: Mapping[str | None, Material]) -> tuple[Material, ...]:
        """One material for each region.

        Args:
            by_name: by number or name of a region; None is for all others.

        Raises:
            SettingError: a region has no material or two, or a material no region.
        """
        return self.by_region("--material", by_name)

    def by_region(self, option: str, by_name: Mapping[str | None, T]) -> tuple[T, ...]:
        """What an option gives to each region; see `materials`."""
        by_tag: dict[int | None, T] = {}
        for name, value in by_name.items():
            tag = None if name is None else self.number(name, (VOLUME,))[0]
            if tag in by_tag:
                raise SettingError(f"{option} {name}: region {tag} of {self.name} has one already.")
            by_tag[tag] = value
        have = ", ".join(map(str, self.tags))
        for tag in set(by_tag) - {None, *self.tags}:
            raise SettingError(f"{option} {tag}: {self.name} has no such region; it has {have}.")
        bare = [tag for tag in self.tags if tag not in by_tag]
        if bare and None not in by_tag:
            what = option.lstrip("-")
            raise SettingError(f"region {bare[0]} of {self.name} has no {what}: give {option} {bare[0]}=VALUES.")
        return tuple(by_tag[tag if tag in by_tag else None] for tag in self.tags)


def bones() -> list[str]:
    """Names of the bundled bones and soft parts. Their shapes are modelled after atlases, not scanned."""
    with np.load(mjcf.asset("anatomy.npz"), allow_pickle=False) as stored:
        return [str(name) for name in stored["names"]]


def read_body(source: str | Path, *, unit: str = "mm", up: str = "y", size: float | None = None) -> Body:
    """A body from a file, or one of the bundled `bones`.

    Args:
        source: .vtu or .msh with tetrahedra of 4 or 10 nodes, closed .stl or .obj surface, or the name of a bone.
        unit: length unit of the file, one of `UNITS`; bones bring theirs.
        up: axis that points up from the base, "x", "y" or "z".
        size: element size in a surface, in its unit, millimetres for bones; None is two through its thickness.

    Raises:
        SettingError: no such unit or axis, or the size asks for too many unknowns.
        InputFileError: the file cannot be read or is not one sound body.
    """
    if unit not in UNITS:
        raise SettingError(unknown("unit", unit, tuple(UNITS)) + ".")
    if up not in ("x", "y", "z"):
        raise SettingError(unknown("axis", up, ("x", "y", "z")) + ".")
    file, axis = Path(source), "xyz".index(up)
    bone = not file.suffix and str(source) in bones()
    if not bone and not file.is_file():
        raise InputFileError(file, "there is no such file", f"or name a bone: {', '.join(bones())}")
    kind = file.suffix.lower()
    if not bone and kind not in (*SURFACES, *VOLUMES):
        raise InputFileError(file, "is not a mesh format known here", f"valid: {', '.join((*VOLUMES, *SURFACES))}")
    try:
        if bone or kind in SURFACES:
            surface = _bone(str(source)) if bone else read_surface(file, UNITS[unit])
            unit = "mm" if bone else unit
            sizes = None if size is None else MeshSize.of(size * UNITS[unit])
            fine, rough = (replace(mesh, up=axis) for mesh in surface_meshes(surface, sizes))
            changed = abs(fine.volume_um3 / volume(surface) - 1) + rounded(surface)
            return Body(str(source), fine, rough, unit=unit, changed=changed)
        if size is not None:
            raise SettingError(f"--size serves a surface; {file} brings its own tetrahedra: leave it out.")
        tagged = read_tagged(file, UNITS[unit])
        tags, region = np.unique(tagged.tags, return_inverse=True)
        mesh = TetMesh(tagged.points_um, tagged.tets, region.astype(np.int64), axis, tagged.faces).check()
        changed = 0.0 if mesh.curved else rounded(mesh.surface)
        return Body(str(source), *pair(mesh), tuple(map(int, tags)), tagged.names, unit, changed)
    except MeshError as error:
        raise InputFileError(file, str(error).rstrip(".")) from error


def _bone(name: str) -> Any:
    try:
        import trimesh
    except ImportError as error:
        raise MissingPackageError("trimesh", "cell") from error
    with np.load(mjcf.asset("anatomy.npz"), allow_pickle=False) as stored:
        vertices, faces = stored[f"{name}.vertices"], stored[f"{name}.faces"]
    return trimesh.Trimesh(GRAIN_UM * vertices.astype(np.float64), faces.astype(np.int64))


@dataclass(frozen=True)
class BodyMode:
    """How one mode moves.

    Args:
        energy: share (3,) of the kinetic energy in motion along x, y, z.
        parts: share (r,) of the kinetic energy in each region.
    """

    energy: tuple[float, float, float]
    parts: tuple[float, ...]

    @property
    def label(self) -> str:
        """The directions that matter, the strongest first: such as "z 93%, x 6%"."""
        order = sorted(range(3), key=lambda axis: -self.energy[axis])
        return ", ".join(f"{'xyz'[axis]} {self.energy[axis]:.0%}" for axis in order if self.energy[axis] >= NAMED)


@dataclass(frozen=True, repr=False)
class BodyModes(Presented):
    """What ``python -m fasbody.cell modes`` reports.

    Args:
        body: mesh and names.
        support: "free", "base" or "region".
        model: matrices.
        modes: frequencies and shapes, without the rigid motions of a free body.
        errors: estimated relative error (c,) of each frequency, from the rough mesh.
        descriptions: one for each mode.
        held: the region that is, None for another support.
    """

    body: Body
    support: str
    model: CellModel
    modes: Modes
    errors: NDArray[np.float64]
    descriptions: tuple[BodyMode, ...]
    held: Held | None = None

    figures: ClassVar[str] = "fasbody.cell.figures"
    plots: ClassVar[tuple[str, ...]] = ("mode_shapes",)

    @property
    def frequencies_hz(self) -> NDArray[np.float64]:
        """Natural frequencies (c,) above the rigid motions [Hz]."""
        return self.modes.frequencies_hz

    @property
    def title(self) -> str:
        """Name, size and support."""
        size = np.ptp(self.model.assembly.nodes_um, axis=0) / UNITS[self.body.unit]
        held = {"free": "free", "base": "held at its base", "region": f"held at {self.held}"}[self.support]
        return f"{Path(self.body.name).name}, {size[0]:.4g} x {size[1]:.4g} x {size[2]:.4g} {self.body.unit}, {held}"

    @property
    def unit(self) -> tuple[str, float]:
        """The length unit of the file, and its micrometres."""
        return self.body.unit, UNITS[self.body.unit]

    @property
    def remark(self) -> str:
        """The sentence on rigid motions; empty for a held body."""
        if not len(self.modes.rigid_hz):
            return ""
        highest = f"at most {self.modes.rigid_hz.max():.1g} Hz"
        return f"six rigid motions of the free body, {highest}, are skipped: mode 1 is the first that deforms it"

    @property
    def flatness(self) -> str:
        """The sentence on what the error holds of the shape; empty where that is nothing."""
        share = self.body.changed
        return f"{share:.2%} of each error is for a shape of flat triangles" if share > ROUND else ""

    def sheet(self) -> Sheet:
        """Frequency and directions of each mode."""
        modes = zip(self.frequencies_hz, self.errors, self.descriptions, strict=True)
        rows = [
            (str(i), f"{f:.5g}", f"{100 * error:.2g}", d.label, " ".join(f"{share:.0%}" for share in d.parts))
            for i, (f, error, d) in enumerate(modes, start=1)
        ]
        parts = ", ".join(map(str, self.body.tags))
        columns = ("mode", "frequency [Hz]", "estimated error [%]", "moves along", f"kinetic energy in {parts}")
        notes = [f"{text}." for text in (self.remark, self.flatness) if text]
        return Sheet(f"{self.title}: {self.model.assembly.dof} degrees of freedom", columns, rows, notes)

    def records(self) -> list[dict[str, Any]]:
        """One row a mode."""
        modes = self.document()["modes"]
        return [{"frequency_hz": f, **mode} for f, mode in zip(self.frequencies_hz, modes, strict=True)]

    def document(self) -> dict[str, Any]:
        """Everything but the shapes, ready for JSON."""
        regions = zip(self.body.tags, self.model.materials, self.model.assembly.regions, strict=False)
        return {
            "body": self.body.name,
            "support": self.support,
            "held": None if self.held is None else asdict(self.held),
            "size_m": np.ptp(self.model.assembly.nodes_um, axis=0) * 1e-6,
            "volume_m3": self.model.assembly.volume_um3 * 1e-18,
            "mass_kg": self.model.mass_kg,
            "regions": [
                {"tag": tag, "E_pa": m.E, "nu": m.nu, "rho_kg_m3": m.rho, "volume_m3": region.volume_um3 * 1e-18}
                for tag, m, region in regions
            ],
            "dof": self.model.assembly.dof,
            "rigid_hz": self.modes.rigid_hz,
            "frequencies_hz": self.frequencies_hz,
            "estimated_error": self.errors,
            "shape_error": self.body.changed,
            "modes": [
                {"label": d.label, "energy_xyz": d.energy, "energy_of_regions": d.parts, "participation_xyz": p,
                 "residual": r}
                for d, p, r in zip(self.descriptions, self.modes.participation, self.modes.residuals, strict=True)
            ],
            "orthogonality": self.modes.orthogonality,
            "solver": self.modes.way,
        }  # fmt: skip

    def __str__(self) -> str:
        volume = self.model.assembly.volume_um3 * 1e-12
        lines = [f"{self.title}: {volume:.4g} cm^3, {1e3 * self.model.mass_kg:.4g} g, "
                 f"{self.model.assembly.dof} unknowns"]  # fmt: skip
        lines += [f"  {text}" for text in (self.remark, self.flatness) if text]
        rows = zip(self.frequencies_hz, self.errors, self.descriptions, strict=True)
        for i, (f, error, d) in enumerate(rows, start=1):
            parts = ", ".join(f"{tag}: {share:.0%}" for tag, share in zip(self.body.tags, d.parts, strict=True))
            lines.append(
                f"  mode {i:2d}  {f:10.5g} Hz +-{error:.2%}  moves along {d.label}"
                + (f"; energy in {parts}" if "," in parts else "")
            )
        return "\n".join(lines)


def body_modes(
    body: Body, materials: Mapping[str | None, Material], support: str = "free", *, part: str | None = None,
    count: int = 10, way: str | None = None,
) -> BodyModes:  # fmt: skip
    """The lowest modes of a body.

    Args:
        body: of `read_body`.
        materials: by number or name of a region, None for the others.
        support: "free", "base" or "region".
        part: the region that is held.
        count: number of modes, rigid motions not counted.
        way: solver, None is the fastest.
    """
    model, held = body_model(body, materials, support, part)
    modes = solve(model, count, way=way)
    rough, _ = body_model(replace(body, mesh=body.rough), materials, support, part)
    coarse = solve(rough, count).frequencies_hz
    errors = body.changed + richardson(coarse, modes.frequencies_hz, rough.assembly.dof, model.assembly.dof, ORDER)
    phi = modes.vectors
    moving = model.M @ phi
    along = np.stack([np.einsum("ij,ij->j", phi[axis::3], moving[axis::3]) for axis in range(3)], axis=1)
    parts = np.stack([np.einsum("ij,ij->j", phi, model.mass(r) @ phi) for r in range(len(body.tags))], axis=1)
    descriptions = tuple(
        BodyMode((float(x), float(y), float(z)), tuple(map(float, shares)))
        for (x, y, z), shares in zip(along, parts, strict=True)
    )
    return BodyModes(body, support, model, modes, errors, descriptions, held)


def body_model(
    body: Body, materials: Mapping[str | None, Material], support: str, part: str | None = None
) -> tuple[CellModel, Held | None]:
    """Matrices of a supported body, and of a region that is held what it is."""
    chosen = body.materials(materials)
    try:
        faces, held = body.holding(support, part)
        return CellModel(assemble(body.mesh, held=faces), chosen), held
    except MeshError as error:
        raise InputFileError(Path(body.name), str(error).rstrip(".")) from error


@dataclass(frozen=True)
class ShakenBody(Tabled):
    """What ``python -m fasbody.cell response`` reports.

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
        head = f"{self.elastic.title}: elastic frequencies within {self.elastic.errors.max():.2%}"
        return f"{head}\n{self.damped}\n{self.response}"


def shaken_body(
    body: Body, materials: Mapping[str | None, Material], solids: Mapping[str | None, StandardLinearSolid],
    support: str = "base", *, part: str | None = None, count: int = 20,
) -> ShakenBody:  # fmt: skip
    """Damping and response of a body, from a hundredth of its first frequency to its last; see `body_modes`.

    Args:
        body: of `read_body`.
        materials: by number or name of a region, None for the others.
        solids: relaxation, likewise.
        support: what is shaken; "free" is driven by a force.
        part: the region that is held.
        count: modes in the basis.
    """
    relaxing = body.by_region("--relaxation", solids)
    elastic = body_modes(body, materials, support, part=part, count=count)
    reduced = ReducedCell.of(elastic.model, count, elastic.modes)
    damped = damped_modes(reduced, relaxing)
    grid = damped.grid(elastic.frequencies_hz[0] / 100, reduced.reach_hz)
    if elastic.model.assembly.flies:
        return ShakenBody(elastic, damped, force_response(reduced, relaxing, grid))
    return ShakenBody(elastic, damped, base_response(reduced, relaxing, grid, inner=None))
