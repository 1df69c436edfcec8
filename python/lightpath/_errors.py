"""Errors that are also errors of files."""

from ._lightpath import Error


class FileError(Error, OSError):
    """A file that cannot be read or written."""

    __module__ = "lightpath"


class MissingFileError(FileError, FileNotFoundError):
    """A file that does not exist."""

    __module__ = "lightpath"
