"""``python -m tests.docs``: how many commands the pages hold, and what the tests do with them."""

from __future__ import annotations

from tests.docs.doing import FOLLOWED, shortened
from tests.docs.test_blocks import ALL as BLOCKS
from tests.docs.test_blocks import ELSEWHERE
from tests.docs.test_commands import ALL, OF_HELP, RUN

followed = [each for each in ALL if each.page in FOLLOWED and each.block and shortened(each.words)]
blocks = [each for each in ALL if each.block]
print(
    f"{len(ALL)} commands in pages, {len(blocks)} of them in blocks, {len(OF_HELP)} in help pages"
)
print(
    f"parsed: {len(ALL) + len(OF_HELP)}; {len({c.words for c in (*ALL, *OF_HELP)})} different ones"
)
print(f"run as they stand: {len(RUN)} different ones")
print(f"run with fewer steps and episodes: {len(followed)}, of {', '.join(FOLLOWED)}")
python = [block for block in BLOCKS if block.language == "python"]
elsewhere = sum(block.page in ELSEWHERE for block in python)
print(f"{len(python)} blocks of Python, all run, {elsewhere} of them by tests of their own")
print(f"{len(BLOCKS) - len(python)} blocks of files and texts, read by what they are for")
