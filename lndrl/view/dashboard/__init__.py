"""The terminal dashboard: news (``feed``), its picture (``screen``), that over time (``live``)."""
