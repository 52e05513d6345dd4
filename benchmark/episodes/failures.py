"""What becomes of an episode that fails: a record that says why, or the end of the sweep."""

from __future__ import annotations

import errno
import os
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmark.config import EpisodeConfig
from benchmark.localizers.errors import LocalizerError
from benchmark.records.episode_record import EpisodeRecord
from vision.errors import FileFormatError, ResourceError

RunEpisode = Callable[[EpisodeConfig], EpisodeRecord]

_OF_ALL = (ResourceError, FileFormatError)
"""Errors of the machine and of files, which every further episode would meet too."""
_REMEDIES = {
    errno.EMFILE: "raise the limit of open files, ulimit -n 1024",
    errno.ENFILE: "close other programs, or use fewer --workers",
    errno.ENOSPC: "make room",
    errno.EDQUOT: "make room",
}
_NO_MEMORY = ("insufficient memory", "allocate memory", "bad_alloc", "out of memory")


def attempt(config: EpisodeConfig, run_episode: RunEpisode) -> EpisodeRecord:
    """The record of an episode, whether it finished or not.

    Raises:
        ResourceError: the machine lacks what every episode needs.
        FileFormatError: a file is corrupt.
    """
    try:
        return run_episode(config)
    except _OF_ALL:
        raise
    except Exception as error:
        if (lack := _lack(error)) is not None:
            raise lack from error
        return failed_episode(config, error)


def failed_episode(config: EpisodeConfig, error: BaseException) -> EpisodeRecord:
    """The record of an episode that did not finish, with the kind, text and place of its error in one line."""
    text, place = " ".join(f"{type(error).__name__}: {error}".split()), ""
    frames = traceback.extract_tb(error.__traceback__)
    if frames and not isinstance(error, LocalizerError):  # which names a place of the user's by itself
        place = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})"
    advice = ". The memory ran out: use fewer --workers" if any(map(_is_of_memory, _chain(error))) else ""
    return unfinished(config, f"{text}{place}{advice}")


def unfinished(config: EpisodeConfig, reason: str) -> EpisodeRecord:
    """The record of an episode that did not finish, with a reason in one line."""
    return EpisodeRecord(
        key=config.key,
        parts=config.parts,
        scene=config.scene,
        seed=config.seed,
        config_hash=config.config_hash,
        error=reason,
    )


def _lack(error: Exception) -> ResourceError | None:
    """What the machine has run out of, where that is why an episode failed, and it is not memory."""
    if isinstance(error, LocalizerError):  # the user's own code may leave its files open
        return None
    for cause in _chain(error):
        for number, remedy in _REMEDIES.items():
            told = isinstance(cause, ImportError) and os.strerror(number) in str(cause)  # a library was not opened
            if told or (isinstance(cause, OSError) and cause.errno == number):
                return ResourceError(
                    f"episode: got {os.strerror(number)}; {remedy}, and run the same command again, "
                    "what is recorded stays"
                )
    return None


def _is_of_memory(error: BaseException) -> bool:
    """Whether memory ran out; OpenCV and MuJoCo say so in errors of their own."""
    return isinstance(error, MemoryError) or any(words in str(error).lower() for words in _NO_MEMORY)


def _chain(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__
