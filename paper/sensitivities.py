"""What the paper's results depend on: omega, horizon, perturbation, optimiser, R, form and step."""

from collections.abc import Callable
from types import ModuleType

from paper import forms, literal_weight, optimisers, perturbation, trade_offs
from paper.study import Study

FIGURES = ()
PARTS: tuple[ModuleType, ...] = (trade_offs, perturbation, optimisers, literal_weight, forms)


def study(quick: bool, progress: Callable[[str], None]) -> Study:
    """Return all parts as one section."""
    parts = [part.study(quick, progress) for part in PARTS]
    return Study(
        title="What the results depend on",
        text="\n\n".join(f"**{part.title}.** {part.text}" for part in parts),
        figures=[figure for part in parts for figure in part.figures],
        tables=[table for part in parts for table in part.tables],
        claims=[claim for part in parts for claim in part.claims],
    )
