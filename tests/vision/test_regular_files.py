"""What is no regular file is refused at once, for reading it might never end."""

from __future__ import annotations

import os

import pytest

from benchmark.report.gate import read_thresholds
from vision.errors import InputError
from vision.files.picture import read_picture
from vision.files.regular import check_regular
from vision.files.views import load_views
from vision.model.model_file import load_model
from vision.teaching.session_file import load_session


@pytest.mark.parametrize("read", [read_thresholds, read_picture, load_model, load_session])
@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_pipes_and_devices_are_not_waited_for(read, kind, tmp_path):
    path = tmp_path / "pipe"
    os.mkfifo(path)
    if kind == "device":
        path = "/dev/zero"
    with pytest.raises(InputError, match="a directory, a pipe or a device; expected a regular file"):
        read(type(tmp_path)(path))


def test_a_pipe_in_the_place_of_the_views_is_refused(tmp_path):
    os.mkfifo(tmp_path / "views.json")
    with pytest.raises(InputError, match="a regular file"):
        load_views(tmp_path)


def test_regular_and_missing_files_pass(tmp_path):
    (tmp_path / "file").touch()
    assert check_regular(tmp_path / "file").is_file()
    assert not check_regular(tmp_path / "missing").exists()
