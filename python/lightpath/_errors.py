"""Errors that are also errors of files."""

import errno as numbers
import os

from ._lightpath import Error


class FileError(Error, OSError):
    """A file that cannot be read or written.

    `errno` and `filename` are those of the first problem, None where they are not known.
    """

    __module__ = "lightpath"

    def __init__(self, text, errno=None, filename=None):
        super().__init__(text)
        self.errno, self.filename = errno, None if filename is None else os.fspath(filename)

    def __str__(self):
        return str(self.args[0])

    def __reduce__(self):
        return type(self), (self.args[0], self.errno, self.filename), self.__dict__


class MissingFileError(FileError, FileNotFoundError):
    """A file that does not exist."""

    __module__ = "lightpath"


def cannot_write(path, errno, reason):
    """Return the exception for an output file."""
    kind = MissingFileError if errno == numbers.ENOENT else FileError
    message = f"cannot write {os.fspath(path)!r}: {reason}"
    error = kind(f"path: {message}", errno, path)
    error.problems = [("path", message, None)]
    return error
