"""What goes wrong because of what was asked: one sentence for people, exit status 2 on the command line."""


class SidestepError(ValueError):
    """Bad input. The message is one sentence that says what is wrong and where."""
