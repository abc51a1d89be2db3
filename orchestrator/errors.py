"""The two ways in which a command ends without a result, each with a plain sentence for its user."""


class UserError(Exception):
    """Something the user asked for is impossible; the message says what and what to do (exit code 2)."""


class RunError(Exception):
    """A run failed although what was asked for was possible (exit code 1)."""
