"""In how many virtual studies does each finding of section 2.3 come out? `python -m benchmarks.findings_by_seed`.

The studies are those of reproduction/virtual_transfer.py: a hundred of twenty subjects take a minute or two.
"""

from collections import Counter
from typing import Annotated

import typer

from fasbody.console import command_line, progress_bar
from fasbody.transmissibility.findings import findings
from reproduction.virtual_transfer import study

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def main(studies: Annotated[int, typer.Argument(help="Studies, with seeds from 0.", min=1)] = 100) -> None:
    """Print how often each finding holds.

    Examples:
      python -m benchmarks.findings_by_seed 20
    """
    held: Counter[str] = Counter()
    rules: dict[str, tuple[Counter[str], Counter[str]]] = {}
    best: list[tuple[int, int]] = []
    with progress_bar() as bar:
        for seed in bar.track(range(studies), description="studies"):
            table = study(seed)
            made = findings(table)
            for c in table.each():
                by_thesis, by_equivalence = rules.setdefault(f"{c.pair}, {c.condition}", (Counter(), Counter()))
                by_thesis[str(c.resonance.kind)] += 1
                by_equivalence[str(c.resonance_by_tests.kind)] += 1
            held.update({f.says: int(f.holds is True) for f in made})
            best.append((sum(f.holds is True for f in made), seed))
    typer.echo(f"share of {studies} virtual studies of 20 subjects in which each statement comes out")
    for says, n in held.items():
        typer.echo(f"{100 * n / studies:5.0f} %  {says}")
    typer.echo("what the rule of section 2.3.1 finds, and what is shown beyond chance (resonance.py), % of studies")
    for title, counts in rules.items():
        cells = (", ".join(f"{kind} {100 * n / studies:.0f}" for kind, n in c.most_common()) for c in counts)
        typer.echo(f"{title:26} {next(cells):36} | {next(cells)}")
    most = ", ".join(f"{n} with seed {seed}" for n, seed in sorted(best, reverse=True)[:5])
    typer.echo(f"most statements at once: {most}")


if __name__ == "__main__":
    command_line(app)
