"""What an FMU's refusals become."""


class FmuError(ValueError):
    """An FMU refused a call, or asks to end the simulation.

    Attributes
    ----------
    status : int
        What it answered: 2 Discard, 3 Error, 4 Fatal, 5 Pending.
    """

    def __init__(self, message: str, status: int = 3) -> None:
        super().__init__(message, status)
        self.status = status

    def __str__(self) -> str:
        return str(self.args[0])
