"""What a user can get wrong, told in one line."""


class UserError(Exception):
    """An argument, a file or a run folder is not as it must be; the message names it."""
