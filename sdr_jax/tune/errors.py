"""What a user can put right."""


class TuneError(Exception):
    """One line that names the file or the field, and what would be right."""
