"""Errors that a user's input causes: one sentence for people, exit status 2 on the command line."""


class SidestepError(ValueError):
    """Bad input. The message is one sentence that says what is wrong, where, and what to do about it.

    Parameters
    ----------
    message
        The sentence.
    field
        Name of the option, field or column at fault, where one is; nested fields are joined by dots.
    line
        Line of the file at fault, counted from 1, where it is known.
    """

    def __init__(self, message: str, *, field: str | None = None, line: int | None = None) -> None:
        super().__init__(message)
        self.field = field
        self.line = line
