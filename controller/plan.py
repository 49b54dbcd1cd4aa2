"""What a plan is on the wire: the variables that the MPC publishes and the sequencer plays."""

from typing import Literal

from controller.variables import Causality, Variable

PlanForm = Literal["actuator", "attitude"]
CHANNELS: dict[PlanForm, tuple[str, ...]] = {
    "actuator": ("thrust", "pitch", "roll", "tail"),
    "attitude": ("thrust", "pitch", "roll", "heading"),
}


def plan_variables(
    channels: tuple[str, ...], capacity: int, causality: Causality
) -> list[Variable]:
    """Return the rows of a plan: its stamp and one array per channel, the end filled with trim.

    Sequence 0 is no plan yet. All are discrete: they change at updates only.
    """
    rows = [
        Variable("plan.sequence", causality, "1", "number of the plan, from 1", 0, (), "discrete"),
        Variable(
            "plan.start_time", causality, "s", "when sample 0 takes effect", 0.0, (), "discrete"
        ),
        Variable(
            "plan.sample_period", causality, "s", "period of the samples", 0.05, (), "discrete"
        ),
    ]
    rows += [
        Variable(
            f"plan.{name}",
            causality,
            "G" if name in ("thrust", "tail") else "rad",
            f"commanded {name}, held over each sample",
            1.0 if name == "thrust" else 0.0,
            (capacity,),
            "discrete",
        )
        for name in channels
    ]
    return rows
