"""A run as a GIF, read back by pillow."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from deploy.exchange.video import FRAMES, write_video
from protocol.errors import InputError
from tests.deploy.test_report import write_run

BLUE = (0x00, 0x72, 0xB2)  # r1


def test_robots_move_and_maps_grow(tmp_path: Path) -> None:
    (file,) = write_video(write_run(tmp_path / "run"), tmp_path / "out")
    with Image.open(file) as film:
        frames = [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(film)]
    assert len(frames) == FRAMES and file.stat().st_size < 3_000_000
    blue = [(frame == BLUE).all(2).sum() for frame in (frames[0], frames[FRAMES // 2], frames[-1])]
    assert 0 < blue[0] < blue[1] < blue[2]
    again = write_video(tmp_path / "run", tmp_path / "again")
    assert again[0].read_bytes() == file.read_bytes()


def test_without_a_world_there_is_nothing_to_draw(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text("{}")
    with pytest.raises(InputError, match="no world"):
        write_video(tmp_path, tmp_path / "out")
    with pytest.raises(InputError, match="no run directory"):
        write_video(tmp_path / "absent", tmp_path / "out")
