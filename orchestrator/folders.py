"""Folders of results, written whole or not at all, never over anything else."""

from __future__ import annotations

import secrets
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from rotordx.orchestrator.errors import UserError


@contextmanager
def whole_folder(folder: str | Path, files: Collection[str]) -> Iterator[Path]:
    """An empty folder to fill, which in the end takes the place of `folder` and of an earlier result there.

    It lies beside `folder` and is renamed into place, so that an error or Ctrl-C at any time leaves either the whole
    new result or what was there before.

    Raises:
        UserError: the folder cannot be written, or holds other things than `files`.
    """
    folder = Path(folder).absolute()
    check_folder(folder, files)
    partial = folder.with_name(f".{folder.name}.{secrets.token_hex(4)}.partial")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        partial.mkdir()
        yield partial
        _move_into_place(partial, folder)
    except OSError as error:
        raise UserError(_cannot_write(folder, error.strerror or str(error))) from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def check_folder(folder: str | Path, files: Collection[str]) -> None:
    """Find out before a long run whether its result could not be put there.

    Raises:
        UserError: something else than `files`, the names in a result, is in the place of the folder.
    """
    folder = Path(folder).absolute()
    try:
        if not folder.exists():
            return
        if not folder.is_dir():
            raise UserError(_cannot_write(folder, "a file of that name is in its place"))
        foreign = sorted({path.name for path in folder.iterdir()} - set(files))
    except OSError as error:
        raise UserError(_cannot_write(folder, error.strerror or str(error))) from error
    if foreign:
        raise UserError(_cannot_write(folder, f"it holds other things than a result, such as {foreign[0]}"))


def _move_into_place(partial: Path, folder: Path) -> None:
    """Rename, keeping an earlier result until the new one stands."""
    earlier = partial.with_suffix(".earlier")
    try:
        if folder.exists():
            folder.rename(earlier)
        partial.rename(folder)
    except BaseException:
        if earlier.exists() and not folder.exists():
            earlier.rename(folder)
        raise
    shutil.rmtree(earlier, ignore_errors=True)


def _cannot_write(folder: Path, reason: str) -> str:
    reason = reason[:1].lower() + reason[1:]
    return f"The result folder {folder} cannot be written: {reason}. Choose another one with --out."
