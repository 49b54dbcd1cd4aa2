"""Components with the mistakes that a first one has."""

# ruff: noqa: D102  (the methods are the contract's)

from plant.variables import Execution, Variable, model_description


class NoComponent:
    """Nothing of a component but when it runs."""

    execution = Execution("sampled", 20.0)


class Constructor:
    """Fails when it is made."""

    def __init__(self) -> None:
        raise KeyError("a")


class Refusal:
    """Refuses to be made, not for a parameter."""

    def __init__(self) -> None:
        raise ValueError("no such thing, got 1")


class Holding:
    """A whole component."""

    execution = Execution("sampled", 20.0)
    rows = (Variable("u", "input", "m", ""),)

    def describe(self):
        return model_description("Holding", "", self.rows)

    def initialize(self, *, start_time, stop_time, seed):
        pass

    def set(self, values):
        pass

    def get(self, names):
        return dict.fromkeys(names, 0.0)

    def step(self, time, step_size):
        return 0

    def terminate(self):
        pass


class NoExecution(Holding):
    """Does not say when it runs."""

    execution = None


class Described(Holding):
    """Cannot describe itself."""

    def describe(self):
        return {}["x"]


class Twice(Holding):
    """Has two variables of one name."""

    rows = (*Holding.rows, *Holding.rows)


class Dependent(Holding):
    """Has an output that depends on an input that is not there."""

    rows = (*Holding.rows, Variable("y", "output", "m", "", depends_on=("v",)))


class Arguments(Holding):
    """Wants an argument that nobody has."""

    def __init__(self, *_, **__) -> None:
        self._take(1)

    def _take(self, a, b):
        pass
