"""`fasbody cell sweep | verify`: the figures of section 5.4, and known bodies."""

from fasbody.cell.dome import Dome, shape
from fasbody.cell.materials import MODULI_PA, preset
from fasbody.cell.options import (
    JsonOption,
    ModesOption,
    OutOption,
    PresetOption,
    ShapeOption,
    SizeOption,
    report,
)
from fasbody.console import console, progress_bar, to_json, write_whole


def sweep(
    preset_name: PresetOption = "as-reproduced",
    shape_text: ShapeOption = "100x40",
    modes: ModesOption = 10,
    size: SizeOption = 3.5,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Figures 5.9 (four shapes), 5.10 (seven moduli) and 5.11 (power law with both ways of fitting).

    Examples:
      fasbody cell sweep --preset as-printed --out results/cell
    """
    chosen = preset(preset_name)
    dome = Dome(*shape(shape_text), chosen.height_um)
    from fasbody.cell.dome import SHAPES
    from fasbody.cell.mesh import MeshSize
    from reproduction.cell.sweep import YEAST_PA, summarise, sweep_moduli, sweep_shapes

    with progress_bar() as progress:
        task = progress.add_task("cells", total=len(SHAPES) + len(MODULI_PA) + 1)

        def advance() -> None:
            progress.advance(task)

        sizes, moduli = MeshSize.of(size), (*MODULI_PA, YEAST_PA)
        by_shape = sweep_shapes(chosen, size=sizes, count=modes, advance=advance)
        by_modulus = sweep_moduli(chosen, dome, moduli=moduli, size=sizes, count=modes, advance=advance)
    summary = summarise(by_shape, by_modulus)
    printed, direct = by_modulus.without_last(), by_modulus.analyses[-1]
    document = {
        "summary": summary.document(),
        "shapes": by_shape.document(),
        "moduli": by_modulus.document(),
    }
    if out is not None:
        from fasbody.cell.figures import mode_shapes
        from fasbody.presentation import write_figure
        from reproduction.cell import figures

        write_whole(out / "sweep.json", to_json(document))
        for name, figure in (
            ("figure_5_9", figures.shapes(by_shape)),
            ("figure_5_10", figures.moduli(printed)),
            ("figure_5_11", figures.power_law(printed, summary.laws, summary.direct_hz)),
        ):
            write_figure(figure, out / f"{name}.png")
        for number, analysis in enumerate(by_shape.analyses, start=5):
            write_figure(mode_shapes(analysis, 5), out / f"figure_5_{number}.png")
        console.print(f"written: {out}")
    report(document, f"{by_shape}\n{printed}\n{summary}, {direct.descriptions[0].label}", as_json)


def verify(preset_name: PresetOption = "as-reproduced", as_json: JsonOption = False) -> None:
    """Known bodies: free sphere, beams, plates, scaling laws; and the cell's mesh convergence. Takes about a minute.

    Examples:
      fasbody cell verify
    """
    from fasbody.cell.mesh import MeshSize
    from reproduction.cell.verification import (
        check_beams,
        check_plates,
        check_scaling,
        check_sphere,
        convergence,
    )

    chosen = preset(preset_name)
    dome = Dome(height=chosen.height_um)
    with console.status("solving known bodies"):
        checks = [
            *check_sphere(),
            *check_beams(),
            *check_plates(),
            *check_scaling(chosen, dome, MeshSize.of(6.0)),
        ]
        study = convergence(chosen, dome)
    document = {"checks": [check.document() for check in checks], "convergence": study.document()}
    report(document, "\n".join([*map(str, checks), str(study)]), as_json)
    if not all(check.passed for check in checks):
        raise SystemExit(1)
