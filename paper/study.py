"""What a study leaves: figures with their data, and claims with a verdict."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

Verdict = Literal["holds", "holds in part", "does not hold", "not comparable"]


@dataclass(frozen=True)
class Figure:
    """A picture and the numbers in it.

    Attributes
    ----------
    name : str
        Of its files, as ``fig6_minimum_cost``.
    title, caption : str
        The caption states the regime: plant, weights, horizon, form, how S was identified.
    table : mapping
        The data, columns of equal length, written as CSV. Names carry units (``time_s``).
    draw : callable
        Draws on an empty matplotlib figure; called with the project's style.
    size_in : tuple of float
        Width and height, inches.
    """

    name: str
    title: str
    caption: str
    table: Mapping[str, Sequence[Any]]
    draw: Callable[[Any], None]
    size_in: tuple[float, float] = (7.0, 4.0)


@dataclass(frozen=True)
class Claim:
    """A statement of the paper (or a bar of this project) and what became of it.

    Attributes
    ----------
    where : str
        In the paper, as ``IV.B, fig. 6``; ``ours`` for a bar of this project.
    statement : str
        What is claimed, in our words.
    verdict : str
    theirs, ours : str
        The numbers side by side; ``theirs`` may be empty.
    reason : str
        Why, in one or two sentences, with the evidence.
    """

    where: str
    statement: str
    verdict: Verdict
    theirs: str
    ours: str
    reason: str


@dataclass(frozen=True)
class Table:
    """Rows to be printed in the report and written as CSV; columns of equal length."""

    name: str
    title: str
    caption: str
    columns: Mapping[str, Sequence[Any]]


@dataclass(frozen=True)
class Study:
    """One section of the report.

    ``text`` is Markdown: what was done and what is seen, figures by number, in a few paragraphs.
    """

    title: str
    text: str
    figures: Sequence[Figure] = ()
    tables: Sequence[Table] = ()
    claims: Sequence[Claim] = ()
