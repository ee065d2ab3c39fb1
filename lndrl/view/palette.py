"""One palette for terminal, charts and drawings, safe for colour-blind eyes (Okabe and Ito).

The same thing has the same colour everywhere: green is arriving, vermillion is colliding, blue is
the true robot, orange is what the robot believes.
"""

from __future__ import annotations

GREEN = "#009E73"
VERMILLION = "#D55E00"
BLUE = "#0072B2"
ORANGE = "#E69F00"
PINK = "#CC79A7"
SKY = "#56B4E9"
SLATE = "#7A869A"
INK = "#2B303A"
PAPER = "#FFFFFF"
FLOOR = "#F6F7F9"
WALL = "#3C4350"

OUTCOME = {"arrived": GREEN, "collided": VERMILLION, "lost": PINK, "timeout": SLATE}
"""Colour of each way an episode ends."""

OUTCOME_WORD = {"arrived": "arrived", "collided": "collided", "lost": "lost", "timeout": "stuck"}
"""The paper calls an episode that runs out of time stuck."""

TRUTH = BLUE
BELIEF = ORANGE
BELIEF_DARK = "#B06A00"
"""The one estimated pose, which must stand out from the cloud around it."""
ECHO = "#1C86C4"
LEG = "#6B2E57"
GOAL = GREEN
LASER = SKY
PERSON = {"orca": PINK, "sfm": "#8C6BB1", "": PINK}
"""Pedestrians by the model that moves them."""

GOOD = GREEN
WARNING = ORANGE
BAD = VERMILLION
QUIET = SLATE

SERIES = (BLUE, VERMILLION, GREEN, PINK, ORANGE, SKY, SLATE)
"""Colours for anything else, in this order."""
