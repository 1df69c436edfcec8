"""Errors that are also errors of files."""

from __future__ import annotations

import errno as numbers
import os

from ._lightpath import Error


class FileError(OSError, Error):
    """A file that cannot be read or written.

    `errno` and `filename` are those of the first problem, None where they are not known. It is also
    an instance of the class that Python has for `errno`, such as PermissionError.
    """

    __module__ = "lightpath"

    def __init__(self, text: str, errno: int | None = None,
                 filename: str | os.PathLike[str] | None = None) -> None:
        super().__init__(text)
        self.errno, self.filename = errno, None if filename is None else os.fspath(filename)

    def __str__(self):
        return str(self.args[0])

    def __reduce__(self):
        return type(self), (self.args[0], self.errno, self.filename), self.__dict__


class MissingFileError(FileError, FileNotFoundError):
    """A file that does not exist."""

    __module__ = "lightpath"


class NotAFileError(FileError, IsADirectoryError):
    """A folder where a file is needed."""


class NotAFolderError(FileError, NotADirectoryError):
    """A file where a folder is needed."""


class ForbiddenFileError(FileError, PermissionError):
    """A file that the user may not read or write."""


class ExistingFileError(FileError, FileExistsError):
    """A file that exists already."""


_CLASSES: dict[int | None, type[FileError]] = {
    numbers.ENOENT: MissingFileError,
    numbers.EISDIR: NotAFileError,
    numbers.ENOTDIR: NotAFolderError,
    numbers.EACCES: ForbiddenFileError,
    numbers.EPERM: ForbiddenFileError,
    numbers.EEXIST: ExistingFileError,
}


def of_file(text: str, errno: int | None, filename: str | os.PathLike[str] | None,
            specific: bool = True) -> FileError:
    """Return the exception for a file: of the class of `errno` if it is `specific`."""
    kind = _CLASSES.get(errno, FileError) if specific else FileError
    return kind(text, errno, filename)


def cannot_write(path: str | os.PathLike[str], errno: int | None, reason: object) -> FileError:
    """Return the exception for an output file."""
    message = f"cannot write {os.fspath(path)!r}: {reason}"
    error = of_file(f"path: {message}", errno, path)
    error.problems = [("path", message, None)]
    return error
