"""Tasks by name."""

from __future__ import annotations

from benchmark.tasks.clear import Clear
from benchmark.tasks.insert import Insert
from benchmark.tasks.look_only import LookOnly
from benchmark.tasks.pick import Pick
from benchmark.tasks.task import Task

_ALL: tuple[Task, ...] = (Pick(), Clear(), Insert(), LookOnly())


def make_task(name: str) -> Task:
    """The task of that name, one of ``benchmark.config.TASKS``."""
    return {task.name: task for task in _ALL}[name]
