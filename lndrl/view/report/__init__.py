"""One self-contained HTML page about a run or about results: parts, pictures within, the page."""
