"""An episode as a video file, encoded by FFmpeg: a program of its own, on PATH or from the extra
``video``.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from lndrl.errors import UserError
from lndrl.view.pictures.film import FIGURE_WIDTH, HOLD_LAST, image_of

ENCODING = ("-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "22", "-movflags", "+faststart")
"""H.264 as browsers, slides and phones play it."""


def save_mp4(
    figure: Callable[[int], Figure],
    count: int,
    path: Path | str,
    fps: float = 10.0,
    pixels: int = 1200,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Write a video of ``count`` figures, ``FIGURE_WIDTH`` inches wide; it rests on the last.

    ``progress`` is told how many are drawn. Raises UserError where FFmpeg is missing or refuses, or
    there is nothing to show; OSError where ``path`` cannot be written.
    """
    program = ffmpeg()
    if not count:
        raise UserError(f"{path}: there is nothing to show; an animation needs a snapshot")
    Path(path).touch()  # what is wrong with it is then said as of any file
    first = _pixels(figure(0), pixels)
    rows, columns = first.shape[:2]
    source = ("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{columns}x{rows}", "-r", f"{fps:g}")
    command = [program, "-y", "-loglevel", "error", *source, "-i", "-", *ENCODING, str(path)]
    with (
        tempfile.TemporaryFile() as said,
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=said, stderr=said) as process,
    ):
        assert process.stdin is not None
        try:
            for k in range(count):
                drawn = first if k == 0 else _pixels(figure(k), pixels)
                for _ in range(1 if k < count - 1 else 1 + round(HOLD_LAST * fps)):
                    process.stdin.write(drawn.tobytes())
                if progress is not None:
                    progress(k + 1)
            process.stdin.close()
        except BrokenPipeError:
            pass  # it has ended, and says why
        except BaseException:
            process.kill()
            raise
        if process.wait() != 0:
            said.seek(0)
            lines = said.read().decode(errors="replace").strip().splitlines()
            raise UserError(f"{path}: ffmpeg cannot write it ({lines[-1] if lines else 'silent'})")


def ffmpeg() -> str:
    """Where FFmpeg's program is; raises UserError where there is none."""
    if (found := shutil.which("ffmpeg")) is not None:
        return found
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return str(get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        raise UserError(
            'an .mp4 needs the program ffmpeg; install it, or: pip install "lndrl[video]" (in a '
            'clone pip install ".[video]"); or write a .gif'
        ) from None


def _pixels(figure: Figure, pixels: int) -> np.ndarray:
    """RGB, cut to even numbers of rows and columns: two times two pixels share their colour."""
    drawn = np.asarray(image_of(figure, pixels / FIGURE_WIDTH))
    rows, columns = (n - n % 2 for n in drawn.shape[:2])
    return np.ascontiguousarray(drawn[:rows, :columns])
